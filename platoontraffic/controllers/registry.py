"""Laws by name: entry points of the group `platoontraffic.laws`, or `module:Class` beside a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from platoontraffic.controllers.law import Law
from platoontraffic.lidar import PRESETS
from platoontraffic.plug_ins import find_class, installed_names

LAWS = "platoontraffic.laws"  # entry point group


class FoundLaw(NamedTuple):
    kind: type[Law]
    sources: tuple[Path, ...]  # its module and those of the same folder that it imports; none for shipped laws


def law_names() -> list[str]:
    return installed_names(LAWS)


def find_law(name: str, folder: Path) -> FoundLaw:
    """The class of a law, and the files that it consists of; see `find_class`. raises: LookupError"""
    found = find_class(name, folder, LAWS, "law", abstract=Law)
    kind = _with_defaults(found.kind)
    _check_lidars(kind)
    return FoundLaw(kind, found.sources)


def _check_lidars(kind: type[Law]) -> None:
    """raises: LookupError if a law declares a lidar that there is not"""
    further = kind.further_lidars if isinstance(kind.further_lidars, Mapping) else {}  # else a property of each law
    declared = {"lidar": kind.lidar} | {f"further_lidars[{name!r}]": preset for name, preset in further.items()}
    for key, preset in declared.items():
        if isinstance(preset, property):  # of each law, not of the class
            continue
        if (preset is None and key == "lidar") or (isinstance(preset, str) and preset in PRESETS):
            continue
        known = ", ".join(PRESETS)
        raise LookupError(f"{kind.__qualname__} declares {key} = {preset!r}; must be one of: {known}")


def _with_defaults(kind: type) -> type[Law]:
    """The class of a law that derives from Law; a class that does not is given Law's defaults by a subclass of both.

    The subclass goes by the name and place of the class, so errors and listings name the user's own.
    """
    if issubclass(kind, Law):
        return kind
    own = ("__module__", "__qualname__", "__doc__", "__firstlineno__")  # the last since Python 3.13
    return type(kind.__name__, (kind, Law), {name: vars(kind)[name] for name in own if name in vars(kind)})
