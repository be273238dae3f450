"""Finding classes by name: shipped ones, those of installed packages, and those in a file beside the scenario."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
import traceback
from functools import cache, lru_cache
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from platoontraffic.errors import did_you_mean, no_file


class PlugIn(NamedTuple):
    kind: type
    sources: tuple[Path, ...]  # its module and those of the same folder that it imports; none for shipped classes


def installed_names(group: str) -> list[str]:
    return sorted(point.name for point in _installed(group))


def find_class(name: str, folder: Path, group: str, what: str, abstract: type = object) -> PlugIn:
    """A callable class by name.

    name     : of an entry point of `group`, or `module:Class` with the module in `folder` or importable
    what     : noun for messages, such as "law"
    abstract : a base class that declares `__call__` and does not define it
    raises   : LookupError with one line that says what is wrong and what there is
    """
    if ":" not in name:
        found = [point for point in _installed(group) if point.name == name]
        if not found:
            raise LookupError(f"no {what} {name!r}{did_you_mean(name, installed_names(group))}; or module:Class")
        kind = found[0].load()
        return PlugIn(kind, () if is_shipped(kind) else (Path(inspect.getfile(kind)),))
    module_name, class_name = name.rsplit(":", 1)
    if not module_name or not class_name:
        raise LookupError(f"{name!r}: must be module:Class")
    file = plug_in_file(name, folder)
    if file is None and module_name.endswith(".py"):
        raise LookupError(f"{name!r}: there is no file {folder / module_name}")
    module, sources = _imported(module_name, file, folder)
    kind = getattr(module, class_name, None)
    if isinstance(kind, type) and not any("__call__" in vars(base) for base in kind.__mro__ if base is not abstract):
        raise LookupError(f"{module_name}: the class {class_name} has no __call__; a {what} must have one")
    if not isinstance(kind, type):
        own = [n for n, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
        hint = did_you_mean(class_name, own)
        raise LookupError(f"{module_name} has no {what} {class_name!r}, a class with __call__{hint}")
    return PlugIn(kind, sources or (Path(inspect.getfile(kind)),))


def plug_in_file(name: str, folder: Path) -> Path | None:
    """The file in `folder` that `module:Class` names, if it is there."""
    module = name.rsplit(":", 1)[0]
    file = folder / (module if module.endswith(".py") else module.replace(".", "/") + ".py")
    return file if ":" in name and not no_file(file) else None


@lru_cache
def is_shipped(kind: type) -> bool:
    return kind.__module__.startswith("platoontraffic.")


def end_copy(of: int) -> None:
    """End this process if a plug-in made it by a fork of process `of`: two simulations would write the same files."""
    if os.getpid() != of:
        os._exit(0)


def place_of(plug_in: Any, error: BaseException | None = None) -> str:
    """`file:line` of an object's class: the line of it that failed with `error`, or else that of its definition."""
    try:
        file, line = inspect.getsourcefile(type(plug_in)), inspect.getsourcelines(type(plug_in))[1]
    except (OSError, TypeError):  # no source at hand
        return type(plug_in).__module__
    frames = traceback.extract_tb(error.__traceback__) if error else []
    return f"{file}:{next((f.lineno for f in reversed(frames) if f.filename == file), line)}"


@cache
def _installed(group: str) -> EntryPoints:
    return entry_points(group=group)  # reads a file of every installed package


def _imported(module_name: str, file: Path | None, folder: Path) -> tuple[ModuleType, tuple[Path, ...]]:
    """A module and the files it consists of, which are known only if it comes from a `file`. raises: LookupError

    folder: in which there is no such file
    """
    try:
        return _load(file) if file else (importlib.import_module(module_name), ())
    except (Exception, SystemExit) as error:
        where = next((f for f in reversed(traceback.extract_tb(error.__traceback__)) if f.filename == str(file)), None)
        line = error.lineno if isinstance(error, SyntaxError) else where and where.lineno
        place = f"{file.name}:{line}" if file and line else module_name
        wanted = (folder / module_name.replace(".", "/")).with_suffix(".py")
        looked = f"; nor is there a file {wanted}" if file is None and _is_of(error, module_name) else ""
        raise LookupError(f"{place}: cannot be imported: {type(error).__name__}: {error}{looked}") from error


def _is_of(error: BaseException, module_name: str) -> bool:
    """Whether an error says that there is no such module, and not that it imports another one that is missing."""
    return isinstance(error, ModuleNotFoundError) and f"{module_name}.".startswith(f"{error.name}.")


def _load(file: Path) -> tuple[ModuleType, tuple[Path, ...]]:
    """Import a file anew, with its folder importable during that; returns the module and the files it consists of."""
    folder = str(file.parent.resolve())
    name = f"{file.stem}_{hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    before = set(sys.modules)
    sys.modules[name] = module  # dataclasses look their module up while they are made
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
        # Forget modules beside it: a changed one, or another scenario's of the same name, has to be read anew.
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
