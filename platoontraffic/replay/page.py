"""The replay page: markup, style, scripts and data in one HTML file."""

from __future__ import annotations

import base64
import html
import re
from pathlib import Path

from platoontraffic.analysis.results import Results, load_run
from platoontraffic.analysis.writing import write
from platoontraffic.replay.content import packed

HERE = Path(__file__).parent
SCRIPTS = ("run.js", "camera.js", "map.js", "strips.js", "player.js")  # each uses those before it


def page(folder: Path, to: Path, vehicle: str | None = None) -> Path:
    """Make the page of a finished run.

    vehicle: the member that is selected at first; default: the first follower

    raises: ResultsError, OSError (it cannot be written), InputError if there is no such member
    """
    return write(to, _page(load_run(folder), vehicle).encode())


def page_of_two(folder: Path, other: Path, to: Path, vehicle: str | None = None) -> Path:
    """Make a page of two finished runs side by side, which play together. Parameters and errors as of `page`."""
    runs = [load_run(Path(one)) for one in (folder, other)]
    names = [_name(run) for run in runs]
    first, second = (html.escape(_page(run, vehicle)) for run in runs)
    parts = {
        "TITLE": html.escape(f"Replay of {names[0]} and {names[1]}"),
        "FIRST": html.escape(names[0]),
        "SECOND": html.escape(names[1]),
        "FIRST_PAGE": first,
        "SECOND_PAGE": second,
    }
    return write(to, _filled("beside.html", parts).encode())


def _page(results: Results, vehicle: str | None) -> str:
    parts = {
        "TITLE": html.escape(f"Replay of {_name(results)}"),
        "STYLE": (HERE / "style.css").read_text(encoding="utf-8"),
        "SCRIPT": "\n".join((HERE / script).read_text(encoding="utf-8") for script in SCRIPTS),
        "DATA": base64.b64encode(packed(results, vehicle)).decode(),
    }
    return _filled("page.html", parts)


def _filled(template: str, parts: dict[str, str]) -> str:
    text = (HERE / template).read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], text)


def _name(results: Results) -> str:
    folder = results.folder.resolve()
    return f"{folder.parent.name}, run {folder.name}"
