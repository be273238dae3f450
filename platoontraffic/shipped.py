"""The networks, scenarios and studies that come with the package."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent


def folder(name: str) -> Path:
    """The folder `sumo_nets` or `scenarios`: in a checkout its own, else the copy inside the installed package."""
    beside = _PACKAGE.parent / name
    return beside if (_PACKAGE.parent / "pyproject.toml").is_file() else _PACKAGE / "_data" / name


def networks() -> dict[str, Path]:
    """Shipped networks by name."""
    return {net.parent.name: net for net in sorted(folder("sumo_nets").glob("*/*.net.xml"))}


def scenarios() -> dict[str, Path]:
    """Shipped scenarios by name."""
    return {file.stem: file for file in sorted(folder("scenarios").glob("*.toml"))}


def studies() -> dict[str, Path]:
    """Shipped studies by name."""
    return {file.stem: file for file in sorted(folder("scenarios").glob("studies/*.toml"))}
