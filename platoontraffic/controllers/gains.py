"""From the keys of a scenario file to a law's gains, and back."""

from __future__ import annotations

import typing
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from platoontraffic.controllers.law import NEEDS, Law


def with_files(kind: type[Law], gains: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The keys of a law, those of its fields that are a Path with the whole path of a file in `folder`."""
    keys = keys_of(kind) if is_dataclass(kind) else {}
    hints = typing.get_type_hints(kind) if keys else {}
    files = {key for name, key in keys.items() if Path in (hints[name], *typing.get_args(hints[name]))}
    return {key: folder / value if key in files and isinstance(value, str) else value for key, value in gains.items()}


def law_of(kind: type[Law], gains: dict[str, Any], fault: Callable, fault_of: Callable) -> Law | None:
    """An instance of a law's class from the keys of a scenario file; None if `fault` was called for some of them.

    fault    : fault(key, text) takes a fault of a key
    fault_of : fault_of(error, model) is the text of one of pydantic's errors
    raises   : LookupError if the class is no law, whatever the keys are, or refuses the gains as a whole
    """
    model = _model_of(kind)
    # TOML has no tuples, and a gain must be hashable.
    gains = {key: tuple(value) if isinstance(value, list) else value for key, value in gains.items()}
    try:
        checked = model.model_validate(gains)
        law = kind(**{f.name: getattr(checked, f.name) for f in fields(kind)})
        hash(law)
        _check_declared(law)
    except ValidationError as error:
        for e in error.errors():
            fault(e["loc"][0] if e["loc"] else "law", fault_of(e, model))
        return None
    except ValueError as error:  # of a law's own checks
        raise LookupError(str(error)) from error
    except Exception as error:  # whatever a user's __post_init__ may raise
        raise LookupError(f"{kind.__qualname__}: {type(error).__name__}: {error}") from error
    return law


def keys_of(kind: type[Law]) -> dict[str, str]:
    """Field name -> key in a scenario file."""
    hints = typing.get_type_hints(kind, include_extras=True)
    keys = {}
    for f in fields(kind):
        notes = getattr(hints[f.name], "__metadata__", ())
        keys[f.name] = next((a for n in notes if (a := getattr(n, "alias", None))), f.name)
    return keys


def _model_of(kind: type[Law]) -> type[BaseModel]:
    """A pydantic model with the fields of a law's class.

    raises: LookupError if it is no frozen dataclass, or if pydantic cannot check its fields
    """
    if not (is_dataclass(kind) and kind.__dataclass_params__.frozen):
        raise LookupError(f"{kind.__qualname__} must be a frozen dataclass, of its gains")
    try:
        hints = typing.get_type_hints(kind, include_extras=True)
        return create_model(
            kind.__name__,
            __config__=ConfigDict(extra="forbid", strict=True),
            **{f.name: (hints[f.name], _default(f)) for f in fields(kind)},
        )
    except Exception as error:  # whatever a user's annotations may come to
        raise LookupError(f"{kind.__qualname__}: its fields cannot be keys: {error}") from error


def _default(field: Any) -> Any:
    """A dataclass field's default as pydantic wants it: `...` for none."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    return ... if field.default is MISSING else field.default


def _check_declared(law: Law) -> None:
    """raises: ValueError if what a law declares beside its gains is not what `Law` says"""
    name, needs, known = type(law).__qualname__, law.needs, ", ".join(sorted(NEEDS))
    if not isinstance(needs, frozenset | set | list | tuple):
        raise ValueError(f"{name} declares needs = {needs!r}; must be a set of names: {known}")
    if unknown := [str(need) for need in needs if need not in NEEDS]:
        raise ValueError(f"{name} needs {', '.join(sorted(unknown))}; there is: {known}")
    if law.drives_alone and (missing := {"route", "leads"}.difference(needs)):
        raise ValueError(f"{name} declares drives_alone; then it must also need {' and '.join(sorted(missing))}")
    if not callable(law.desired_distance) or not callable(law.remembered_path):
        raise ValueError(f"{name}: desired_distance and remembered_path must be methods")
    if not isinstance(law.hardest_braking, int | float) or not law.hardest_braking > 0:
        raise ValueError(f"{name} declares hardest_braking = {law.hardest_braking!r}; must be more than 0 m/s2")
