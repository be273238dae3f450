"""Laws by name: shipped ones, those of installed packages, and those in a file beside the scenario."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import sys
import traceback
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from platoontraffic.controllers.law import Law
from platoontraffic.errors import did_you_mean

LAWS = "platoontraffic.laws"  # entry point group


def law_names() -> list[str]:
    return sorted(point.name for point in _installed())


class FoundLaw(NamedTuple):
    kind: type[Law]
    sources: tuple[Path, ...]  # its module and those of the same folder that it imports; none for shipped laws


def find_law(name: str, folder: Path) -> FoundLaw:
    """The class of a law.

    name   : an entry point's name, or `module:Class` with the module in `folder` or importable
    raises : LookupError with one line that says what is wrong and what there is
    """
    if ":" not in name:
        return _installed_law(name)
    module_name, class_name = name.rsplit(":", 1)
    if not module_name or not class_name:
        raise LookupError(f"{name!r}: must be module:Class")
    file = plug_in_file(name, folder)
    if file is None and module_name.endswith(".py"):
        raise LookupError(f"{name!r}: there is no file {folder / module_name}")
    module, sources = _imported(module_name, file)
    kind = getattr(module, class_name, None)
    if not _is_law(kind):
        own = [n for n, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
        hint = did_you_mean(class_name, own)
        raise LookupError(f"{module_name} has no law {class_name!r}, a class with __call__{hint}")
    return FoundLaw(_with_defaults(kind), sources or (Path(inspect.getfile(kind)),))


def plug_in_file(name: str, folder: Path) -> Path | None:
    """The file in `folder` that `module:Class` names, if it is there."""
    module = name.rsplit(":", 1)[0]
    file = folder / (module if module.endswith(".py") else module.replace(".", "/") + ".py")
    return file if ":" in name and file.is_file() else None


@cache
def _installed() -> EntryPoints:
    return entry_points(group=LAWS)  # this reads a file of every installed package


def _installed_law(name: str) -> FoundLaw:
    found = [point for point in _installed() if point.name == name]
    if not found:
        raise LookupError(f"no law {name!r}{did_you_mean(name, law_names())}; or module:Class")
    kind = found[0].load()
    shipped = kind.__module__.startswith("platoontraffic.")
    return FoundLaw(_with_defaults(kind), () if shipped else (Path(inspect.getfile(kind)),))


def _is_law(kind: object) -> bool:
    """Whether it is a class with a `__call__` of its own, or of a class that it derives from."""
    return isinstance(kind, type) and any("__call__" in base.__dict__ for base in kind.__mro__ if base is not Law)


def _with_defaults(kind: type) -> type[Law]:
    """The class of a law that derives from Law; a class that does not is given Law's defaults by a subclass of both.

    The subclass goes by the name and place of the class, so errors and listings name the user's own.
    """
    if issubclass(kind, Law):
        return kind
    own = ("__module__", "__qualname__", "__doc__", "__firstlineno__")  # the last since Python 3.13
    return type(kind.__name__, (kind, Law), {name: vars(kind)[name] for name in own if name in vars(kind)})


def _imported(module_name: str, file: Path | None) -> tuple[ModuleType, tuple[Path, ...]]:
    """A module from a file, or else an importable one, and the files that it consists of if it is from a file.

    raises: LookupError with the place of the error if it cannot be imported
    """
    try:
        return _loaded(file) if file else (importlib.import_module(module_name), ())
    except (Exception, SystemExit) as error:  # whatever a user's module may raise
        where = next((f for f in reversed(traceback.extract_tb(error.__traceback__)) if f.filename == str(file)), None)
        line = error.lineno if isinstance(error, SyntaxError) else where and where.lineno
        place = f"{file.name}:{line}" if file and line else module_name
        raise LookupError(f"{place}: cannot be imported: {type(error).__name__}: {error}") from error


def _loaded(file: Path) -> tuple[ModuleType, tuple[Path, ...]]:
    """The module in a file, read anew, and the files it consists of; its folder is importable meanwhile."""
    folder = str(file.parent.resolve())
    name = f"{file.stem}_{hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    before = set(sys.modules)
    sys.modules[name] = module  # dataclasses look up their module while they are made
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
        # Modules beside it are forgotten: another scenario may bring one of the same name, or the file may change.
        beside = {
            other: Path(path)
            for other in set(sys.modules) - before - {name}
            if (path := getattr(sys.modules[other], "__file__", None))
            and Path(path).is_relative_to(folder)
            and "site-packages" not in Path(path).parts
        }
        for other in beside:
            del sys.modules[other]
    return module, (file, *sorted(beside.values()))
