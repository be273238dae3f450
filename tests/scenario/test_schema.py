"""The JSON schema describes every key: its meaning, unit and default."""

from __future__ import annotations

from typing import Any

import pytest

from platoontraffic.scenario import Spec
from platoontraffic.scenario.driver_tables import SHORT
from platoontraffic.scenario.obstacle_tables import KINDS

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
