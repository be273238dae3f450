"""The JSON schema of scenario files, for editors: every key, and the gains of every law that is installed."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

from platoontraffic.controllers.described import schema_of
from platoontraffic.controllers.registry import find_law, law_names
from platoontraffic.scenario.tables import Spec


def scenario_schema() -> dict[str, Any]:
    """The schema of `Spec` in which the table of a driver has the gains of its law as keys."""
    schema = Spec.model_json_schema()
    driver = next(one for one in schema["$defs"]["Driver"]["anyOf"] if "properties" in one)
    laws = []
    for name in law_names():
        kind = find_law(name, Path()).kind
        gains = schema_of(kind, f"#/$defs/{name}.{{model}}")
        schema["$defs"] |= {f"{name}.{table}": content for table, content in gains.pop("$defs", {}).items()}
        keys = {"law": {"const": name, "description": inspect.getdoc(kind)}, **gains["properties"]}
        schema["$defs"][f"law {name}"] = {
            "title": name,
            "properties": keys,
            "required": ["law", *gains.get("required", ())],
            "propertyNames": {"enum": [*driver["properties"], *gains["properties"]]},
        }
        laws.append({"$ref": f"#/$defs/law {name}"})
    own = {"title": "law of your own", "properties": {"law": {"pattern": ":"}}, "required": ["law"]}
    driver["anyOf"] = [*laws, own, {"title": "default law", "not": {"required": ["law"]}}]
    return schema
