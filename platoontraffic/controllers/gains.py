"""From the keys of a scenario file to a law's gains, and back."""

from __future__ import annotations

import math
import typing
from collections.abc import Callable, Collection, Iterator
from dataclasses import MISSING, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from platoontraffic.controllers.law import NEEDS, Law


class Keys(tuple):
    """A table of a law as a gain: pairs of key and value, so that it is hashable."""


def with_files(kind: type, gains: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The keys of a law, with whole paths where a field is a Path. Nested tables too."""
    if not is_dataclass(kind):
        return gains
    hints = typing.get_type_hints(kind)
    by_key = {key: hints[name] for name, key in keys_of(kind).items()}

    def whole(hint: Any, value: Any) -> Any:
        if isinstance(value, dict):
            return with_files(hint, value, folder)
        is_file = isinstance(value, str) and Path in (hint, *typing.get_args(hint))
        return folder / value if is_file else value

    return {key: whole(by_key.get(key), value) for key, value in gains.items()}


def files_in(gains: dict[str, Any]) -> Iterator[Path]:
    """The files that keys name, after `with_files`, nested tables included."""
    for value in gains.values():
        if isinstance(value, dict):
            yield from files_in(value)
        elif isinstance(value, Path):
            yield value


def law_of(
    kind: type, gains: dict[str, Any], fault: Callable, fault_of: Callable, sensors: Collection[str] = ()
) -> Any:
    """A law from the keys of a scenario file; arguments and errors as of `instance_of`.

    sensors: names of those that the law may need
    """
    return instance_of(kind, gains, fault, fault_of, lambda law: _check_declared(law, sensors))


def instance_of(
    kind: type,
    gains: dict[str, Any],
    fault: Callable,
    fault_of: Callable,
    check: Callable[[Any], None] = lambda instance: None,
) -> Any:
    """An instance of a plug-in's class from the keys of a scenario file; None if there are faults.

    fault    : called with the path of a key, a tuple, and what is wrong with it
    fault_of : the text of one of pydantic's errors, given that and the model
    check    : raises ValueError where the instance is not sound
    raises   : LookupError where the class, or its own checks, are at fault
    """
    if not (is_dataclass(kind) and kind.__dataclass_params__.frozen):
        raise LookupError(f"{kind.__qualname__} must be a frozen dataclass, of its gains")
    try:
        model = _model_of(kind)
    except Exception as error:  # whatever a user's annotations may come to
        raise LookupError(f"{kind.__qualname__}: its fields cannot be keys: {error}") from error
    try:
        law = _made(kind, model.model_validate(_hashable(gains)))
        hash(law)
        check(law)
    except ValidationError as error:
        for e in error.errors():
            fault(_keys_in(e["loc"], model) or ("law",), fault_of(e, model))
        return None
    except ValueError as error:  # of a law's own checks
        raise LookupError(str(error)) from error
    except Exception as error:  # whatever a user's __post_init__ may raise
        raise LookupError(f"{kind.__qualname__}: {type(error).__name__}: {error}") from error
    return law


def table_of(plug_in: Any, named: Callable[[Path], str]) -> dict[str, Any]:
    """The keys of a law or sensor with its gains, as for TOML; those that are None are left out.

    named : what a file is called there
    """

    def value_of(gain: Any) -> Any:
        if is_dataclass(gain):
            return table_of(gain, named)
        if isinstance(gain, Keys):
            return dict(gain) or None
        return named(gain) if isinstance(gain, Path) else gain

    gains = {key: getattr(plug_in, name) for name, key in keys_of(type(plug_in)).items()}
    values = {key: value_of(gain) for key, gain in gains.items()}
    return {key: value for key, value in values.items() if value is not None}


@lru_cache
def _model_of(kind: type) -> type[BaseModel]:
    return _model(kind)


def _model(kind: type, given: Any = None) -> type[BaseModel]:
    """The model of a dataclass's fields; a field that is a dataclass is a nested model.

    given : an instance, whose values are the defaults
    """
    hints, definitions = typing.get_type_hints(kind, include_extras=True), {}
    for f in fields(kind):
        hint, default = hints[f.name], _default(f) if given is None else getattr(given, f.name)
        if is_dataclass(hint):
            hint = _model(hint, None if default is ... else default)
            default = default if default is ... else hint()
        definitions[f.name] = (hint, default)
    return create_model(kind.__name__, __config__=ConfigDict(extra="forbid", strict=True), **definitions)


def _made(kind: type, checked: BaseModel) -> Any:
    """The dataclass from its model's values."""
    hints, gains = typing.get_type_hints(kind), {f.name: getattr(checked, f.name) for f in fields(kind)}
    nested = {name: _made(hints[name], value) for name, value in gains.items() if isinstance(value, BaseModel)}
    return kind(**gains | nested)


def _hashable(value: Any) -> Any:
    """TOML has no tuples, and a gain must be hashable."""
    if isinstance(value, dict):
        return {key: _hashable(inner) for key, inner in value.items()}
    return tuple(value) if isinstance(value, list) else value


def _keys_in(place: tuple, model: type[BaseModel]) -> tuple:
    """The keys in the place of a pydantic error, which also names members of unions."""
    nested = model.model_fields[place[0]].annotation if place and place[0] in model.model_fields else None
    inner = isinstance(nested, type) and issubclass(nested, BaseModel)
    return (*place[:1], *_keys_in(place[1:], nested)) if inner else place[:1]


def _default(field: Any) -> Any:
    """A dataclass field's default as pydantic wants it: `...` for none."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    return ... if field.default is MISSING else field.default


@lru_cache
def keys_of(kind: type) -> dict[str, str]:
    """Field name -> key in a scenario file."""
    hints = typing.get_type_hints(kind, include_extras=True)
    keys = {}
    for f in fields(kind):
        notes = getattr(hints[f.name], "__metadata__", ())
        keys[f.name] = next((a for n in notes if (a := getattr(n, "alias", None))), f.name)
    return keys


def _check_declared(law: Law, sensors: Collection[str]) -> None:
    """raises: ValueError if what a law declares beside its gains is not what `Law` says"""
    there = NEEDS.union(sensors)
    name, needs, known = type(law).__qualname__, law.needs, ", ".join(sorted(there))
    if not isinstance(needs, frozenset | set | list | tuple):
        raise ValueError(f"{name} declares needs = {needs!r}; must be a set of names: {known}")
    if unknown := [str(need) for need in needs if need not in there]:
        raise ValueError(f"{name} needs {', '.join(sorted(unknown))}; there is: {known}")
    if law.drives_alone and (missing := {"route", "leads"}.difference(needs)):
        raise ValueError(f"{name} declares drives_alone; then it must also need {' and '.join(sorted(missing))}")
    if not all(map(callable, (law.desired_distance, law.remembered_path, law.braking_for))):
        raise ValueError(f"{name}: desired_distance, remembered_path and braking_for must be methods")
    if not isinstance(law.hardest_braking, int | float) or not law.hardest_braking > 0:
        raise ValueError(f"{name} declares hardest_braking = {law.hardest_braking!r}; must be more than 0 m/s2")
    if law.native:
        _check_native(law)


def _check_native(law: Law) -> None:
    """raises: ValueError if a law that declares `native` lacks what SUMO's driver is given"""
    name = type(law).__qualname__
    try:
        limits = {"max_speed": law.max_speed, "speed_factor": law.speed_factor}
    except AttributeError as error:
        raise ValueError(f"{name} declares native; then it must also have max_speed and speed_factor") from error
    for limit, value in limits.items():
        if not isinstance(value, int | float) or not 0 < value < math.inf:
            raise ValueError(f"{name} declares native and {limit} = {value!r}; must be a number more than 0")
