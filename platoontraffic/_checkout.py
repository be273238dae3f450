"""The subpackages `lidar` and `analysis`, which lie beside this package in a checkout and inside it when installed."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

PACKAGE = Path(__file__).parent
SUBPACKAGES = {f"{__package__}.{name}": PACKAGE.parent / name for name in ("lidar", "analysis")}


class SubpackageFinder(MetaPathFinder):
    """Finds the subpackages at the top of the repository, each under its one name."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in SUBPACKAGES:
            return None
        folder = SUBPACKAGES[fullname]
        return spec_from_file_location(fullname, folder / "__init__.py", submodule_search_locations=[str(folder)])


def add_subpackages() -> None:
    """Let Python find them in a checkout, or in an editable install of one; a wheel needs nothing."""
    if not (PACKAGE / "lidar").is_dir():
        sys.meta_path.append(SubpackageFinder())
