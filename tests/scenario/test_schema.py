"""The JSON schema describes every key, its meaning, unit and default, and knows the gains of every law."""

from __future__ import annotations

import json
import operator
import re
import tomllib
from typing import Any

import pytest

from platoontraffic import shipped
from platoontraffic.controllers.described import in_words
from platoontraffic.controllers.registry import law_names
from platoontraffic.scenario import Spec
from platoontraffic.scenario.driver_tables import SHORT
from platoontraffic.scenario.obstacle_tables import KINDS
from platoontraffic.scenario.schema import scenario_schema

UNITS = {
    "m_per_m": "m/m", "m": "m", "s": "s", "hz": "Hz", "deg": "deg", "degps": "deg/s", "radps": "rad/s",
    "mps": "m/s", "mps2": "m/s2", "mps3": "m/s3", "wpkg": "W/kg",
}  # fmt: skip


def tables() -> dict[str, dict[str, Any]]:
    """Every table of the schema, by name."""
    schema = Spec.model_json_schema()
    named = {"Spec": schema, **schema["$defs"]}
    return {
        name: next((one for one in table.get("anyOf", ()) if "properties" in one), table)
        for name, table in named.items()
    }


TABLES = tables()
KEYS = {f"{name}.{key}": value for name, table in TABLES.items() for key, value in table["properties"].items()}


def description(key: str) -> str:
    """The key's description. Where it equals that of the table which the key holds, the schema omits it."""
    held = KEYS[key].get("$ref", "").rpartition("/")[2]
    return KEYS[key].get("description") or TABLES[held]["description"]


def unit(key: str) -> str | None:
    """The unit that a key's name ends with."""
    return next((UNITS[suffix] for suffix in UNITS if key.endswith(f"_{suffix}")), None)


def test_the_schema_has_the_tables_and_keys_of_scenarios():
    assert {"Run.step_s", "Lidar.fov_deg", "NoiseTable.sigma_m_per_m", "CutIn.share", "Spec.title"} <= set(KEYS)
    assert {f"{kind.__name__}.kind" for kind in KINDS.values()} <= set(KEYS)
    assert {f"Platoon.{key}" for key in SHORT if key in ("leader", "follower", "vehicle")} <= set(KEYS)


@pytest.mark.parametrize("key", KEYS)
def test_every_key_is_described_with_its_unit_and_default(key):
    text = description(key)
    assert text.endswith(".")
    if unit(key):
        assert f"[{unit(key)}]" in text
    if KEYS[key].get("default", 0) is None:  # any other default is in the schema itself
        assert "Default: " in text


@pytest.mark.parametrize("table", TABLES)
def test_every_table_is_described(table):
    assert TABLES[table]["description"].endswith(".")


# ---- the gains of laws

SCHEMA = json.loads(json.dumps(scenario_schema()))
OF_LAWS = {name: SCHEMA["$defs"][f"law {name}"] for name in law_names()}
TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}
LIMITS = {
    "minimum": operator.ge,
    "exclusiveMinimum": operator.gt,
    "maximum": operator.le,
    "exclusiveMaximum": operator.lt,
}
SILENT = {
    "title", "description", "default", "format", "$defs", "discriminator",
    "type", "required", "properties", "patternProperties", "additionalProperties", "items", "prefixItems",
}  # fmt: skip


def is_type(value: Any, name: str) -> bool:
    if name in ("number", "integer"):
        return isinstance(value, int if name == "integer" else int | float) and not isinstance(value, bool)
    return isinstance(value, TYPES[name])


def allowed(value: Any, schema: dict[str, Any]) -> bool:
    """Whether a value of TOML is as a JSON schema says; a keyword that this does not know is an error."""
    return all(of_keyword(value, key, content) for key, content in schema.items()) and within(value, schema)


def of_keyword(value: Any, key: str, content: Any) -> bool:
    number, text = is_type(value, "number"), isinstance(value, str)
    match key:
        case "$ref":
            return allowed(value, SCHEMA["$defs"][content.removeprefix("#/$defs/")])
        case "anyOf" | "oneOf":
            holding = sum(allowed(value, one) for one in content)
            return holding == 1 if key == "oneOf" else holding > 0
        case "not":
            return not allowed(value, content)
        case "const":
            return value == content
        case "enum":
            return value in content
        case "pattern":
            return not text or bool(re.search(content, value))
        case "minLength":
            return not text or len(value) >= content
        case "minItems" | "maxItems":
            bound = operator.ge if key == "minItems" else operator.le
            return not isinstance(value, list) or bound(len(value), content)
        case "propertyNames":
            return not isinstance(value, dict) or all(allowed(name, content) for name in value)
        case _ if key in LIMITS:
            return not number or LIMITS[key](value, content)
    assert key in SILENT, key
    return True


def within(value: Any, schema: dict[str, Any]) -> bool:
    if "type" in schema and not is_type(value, schema["type"]):
        return False
    if isinstance(value, list):
        first = schema.get("prefixItems", [])
        rest = schema.get("items", {}) or {}
        kinds = [*first, *[rest] * (len(value) - len(first))]
        return all(allowed(one, kind) for one, kind in zip(value, kinds, strict=False))
    if not isinstance(value, dict):
        return True
    known, patterns, more = (schema.get(k, {}) for k in ("properties", "patternProperties", "additionalProperties"))
    for name, inner in value.items():
        kinds = [known[name]] if name in known else [kind for text, kind in patterns.items() if re.search(text, name)]
        if not kinds and more is False:
            return False
        if not all(allowed(inner, kind) for kind in kinds or [more if isinstance(more, dict) else {}]):
            return False
    return set(schema.get("required", ())) <= value.keys()


@pytest.mark.parametrize("name", shipped.scenarios())
def test_every_shipped_scenario_is_as_the_schema_says(name):
    assert allowed(tomllib.loads(shipped.scenarios()[name].read_text(encoding="utf-8")), SCHEMA)


@pytest.mark.parametrize(
    ("follower", "right"),
    [
        ("tracking", True),
        ({"law": "tracking", "time_headway_s": 1.0, "odometry": "car"}, True),
        ({"law": "tracking", "time_hedway_s": 1.0}, False),
        ({"law": "tracking", "time_headway_s": -1.0}, False),
        ({"law": "tracking", "policy": "obay"}, False),
        ({"law": "trakcing"}, False),
        ({"law": "mine:Law", "gain": 1.0}, True),
        ({"gain_of_the_default": 1.0}, True),
    ],
)
def test_the_gains_of_a_driver_are_those_of_its_law(follower, right):
    scenario = tomllib.loads(shipped.scenarios()["corridor_tracking"].read_text(encoding="utf-8"))
    scenario["platoon"][0]["follower"] = follower
    assert allowed(scenario, SCHEMA) == right


@pytest.mark.parametrize("law", OF_LAWS)
def test_every_gain_has_a_type_and_a_description_with_its_unit(law):
    for key, gain in OF_LAWS[law]["properties"].items():
        if key != "law":
            assert gain["description"].startswith(in_words(key)), key
            assert gain.keys() & {"type", "anyOf", "$ref", "enum", "const"}, key
            assert key in OF_LAWS[law]["required"] or gain.keys() & {"default", "$ref"} or gain["type"] == "object", key
