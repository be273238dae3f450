"""From the keys of a scenario file to a law's gains, and back."""

from __future__ import annotations

import typing
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, ValidationError, create_model


def with_files(kind: type, gains: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The keys of a law, with whole paths of the files that some of them name: those of its fields that are a Path."""
    keys = keys_of(kind) if is_dataclass(kind) else {}
    hints = typing.get_type_hints(kind) if keys else {}
    files = {key for name, key in keys.items() if Path in (hints[name], *typing.get_args(hints[name]))}
    return {key: folder / value if key in files and isinstance(value, str) else value for key, value in gains.items()}


def law_of(kind: type, gains: dict[str, Any], fault: Callable, fault_of: Callable) -> Any:
    """An instance of a law's class from the keys of a scenario file."""
    if not (is_dataclass(kind) and kind.__dataclass_params__.frozen):
        raise LookupError(f"{kind.__qualname__} must be a frozen dataclass, of its gains")
    try:
        hints = typing.get_type_hints(kind, include_extras=True)
        model = create_model(
            kind.__name__,
            __config__=ConfigDict(extra="forbid", strict=True),
            **{f.name: (hints[f.name], _default(f)) for f in fields(kind)},
        )
    except Exception as error:  # whatever a user's annotations may come to
        raise LookupError(f"{kind.__qualname__}: its fields cannot be keys: {error}") from error
    # TOML has no tuples, and a gain must be hashable.
    gains = {key: tuple(value) if isinstance(value, list) else value for key, value in gains.items()}
    try:
        checked = model.model_validate(gains)
        law = kind(**{f.name: getattr(checked, f.name) for f in fields(kind)})
        hash(law)
    except ValidationError as error:
        for e in error.errors():
            fault(e["loc"][0] if e["loc"] else "law", fault_of(e, model))
        return None
    except ValueError as error:  # of a law's own checks
        raise LookupError(str(error)) from error
    except Exception as error:  # whatever a user's __post_init__ may raise
        raise LookupError(f"{kind.__qualname__}: {type(error).__name__}: {error}") from error
    return law


def _default(field: Any) -> Any:
    """A dataclass field's default as pydantic wants it: `...` for none."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    return ... if field.default is MISSING else field.default


def keys_of(kind: type) -> dict[str, str]:
    """Field name -> key in a scenario file."""
    hints = typing.get_type_hints(kind, include_extras=True)
    keys = {}
    for f in fields(kind):
        notes = getattr(hints[f.name], "__metadata__", ())
        keys[f.name] = next((a for n in notes if (a := getattr(n, "alias", None))), f.name)
    return keys
