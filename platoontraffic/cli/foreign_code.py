"""Plug-ins of a scenario are code: the commands say so before they run it, or refuse it."""

from __future__ import annotations

import sys
from pathlib import Path

from platoontraffic.errors import InputError
from platoontraffic.results.provenance import sha256
from platoontraffic.scenario.named_code import BeforeCode, NamedCode


def refuse(_: str, codes: list[tuple[str, NamedCode]]) -> None:
    """raises: InputError, one fault for each plug-in"""
    faults = (f"{at}: {code.name!r}: runs code of {code.where}, which --no-plugins forbids" for at, code in codes)
    raise InputError(*faults)


def say(results: Path | None = None) -> BeforeCode:
    """Say on stderr, once, which files a scenario runs code of.

    results: the folder of results; a file that an earlier run there has used is not named. None: all are named
    """
    said: set[str] = set()

    def before(name: str, codes: list[tuple[str, NamedCode]]) -> None:
        new = {c.where for _, c in codes if not (results and c.file and _has_run(c.file, results / name))} - said
        if new:
            print(f"{name}: its plug-ins run code, of {', '.join(sorted(new))}", file=sys.stderr)
        said.update(new)

    return before


def _has_run(file: Path, folder: Path) -> bool:
    """Whether a run in `folder` was made with a plug-in of the same bytes."""
    digest = sha256(file)
    return any(
        digest in facts.read_text(encoding="utf-8", errors="replace") for facts in folder.glob("*/provenance.json")
    )
