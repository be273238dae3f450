"""Finding laws by name: shipped ones, those of installed packages, and those in a file beside the scenario."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
import traceback
from importlib.metadata import entry_points
from pathlib import Path

from platoontraffic.errors import did_you_mean

LAWS = "platoontraffic.laws"  # entry point group


def law_names() -> list[str]:
    return sorted(point.name for point in entry_points(group=LAWS))


def law_class(name: str, folder: Path) -> type:
    """The class of a law.

    name   : an entry point's name, or `module:Class` with the module in `folder` or importable
    raises : LookupError with one line that says what is wrong and what there is
    """
    if ":" not in name:
        found = [point for point in entry_points(group=LAWS) if point.name == name]
        if not found:
            raise LookupError(f"no law {name!r}{did_you_mean(name, law_names())}; or module:Class")
        return found[0].load()
    module_name, class_name = name.rsplit(":", 1)
    file = plug_in_file(name, folder)
    try:
        module = _load(file) if file else importlib.import_module(module_name)
    except Exception as error:
        where = next((f for f in reversed(traceback.extract_tb(error.__traceback__)) if f.filename == str(file)), None)
        line = error.lineno if isinstance(error, SyntaxError) else where and where.lineno
        place = f"{file.name}:{line}" if file and line else module_name
        raise LookupError(f"{place}: cannot be imported: {type(error).__name__}: {error}") from error
    law = getattr(module, class_name, None)
    if not isinstance(law, type) or not callable(getattr(law, "__call__", None)):  # noqa: B004 (the class's own)
        classes = [n for n, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
        raise LookupError(f"{module_name} has no law {class_name!r}{did_you_mean(class_name, classes)}")
    return law


def plug_in_file(name: str, folder: Path) -> Path | None:
    """The file in `folder` that `module:Class` names, if it is there."""
    module = name.rsplit(":", 1)[0]
    file = folder / (module if module.endswith(".py") else module.replace(".", "/") + ".py")
    return file if ":" in name and file.is_file() else None


def _load(file: Path):
    """The module in a file, afresh when the file has changed; its folder is importable meanwhile."""
    tag = hashlib.sha256(bytes(file.resolve()) + file.read_bytes()).hexdigest()[:12]
    name = f"{file.stem}_{tag}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up while they are made
    sys.path.insert(0, str(file.parent.resolve()))
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        sys.path.remove(str(file.parent.resolve()))
    return module
