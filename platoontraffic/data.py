"""Where the shipped networks and scenarios lie."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent


def shipped(folder: str) -> Path:
    """`sumo_nets` or `scenarios`: a checkout's own folder comes first, else the copy inside the installed package.

    An editable install copies the folders too; there the checkout's are the ones that netedit edits.
    """
    beside = _PACKAGE.parent / folder
    return beside if (_PACKAGE.parent / "pyproject.toml").is_file() else _PACKAGE / "_data" / folder


def networks() -> dict[str, Path]:
    """Shipped networks by name."""
    return {net.parent.name: net for net in sorted(shipped("sumo_nets").glob("*/*.net.xml"))}


def scenarios() -> dict[str, Path]:
    """Shipped scenarios by name."""
    return {file.stem: file for file in sorted(shipped("scenarios").glob("*.toml"))}


def studies() -> dict[str, Path]:
    """Shipped studies by name."""
    return {file.stem: file for file in sorted(shipped("scenarios").glob("studies/*.toml"))}
