"""The replay page: markup, style, scripts and data in one HTML file."""

from __future__ import annotations

import base64
import html
import re
from pathlib import Path

from platoontraffic.analysis.results import load
from platoontraffic.analysis.writing import write
from platoontraffic.replay.content import packed

HERE = Path(__file__).parent
SCRIPTS = ("run.js", "camera.js", "map.js", "strips.js", "player.js")  # each uses those before it


def page(folder: Path, to: Path, vehicle: str | None = None) -> Path:
    """Make the page of a finished run.

    vehicle: the member that is selected at first; default: the first follower

    raises: ResultsError, OSError (it cannot be written), InputError if there is no such member
    """
    results = load(folder)
    data = base64.b64encode(packed(results, vehicle)).decode()
    name = f"{results.folder.resolve().parent.name}, run {results.folder.resolve().name}"
    parts = {
        "TITLE": html.escape(f"Replay of {name}"),
        "STYLE": (HERE / "style.css").read_text(encoding="utf-8"),
        "SCRIPT": "\n".join((HERE / script).read_text(encoding="utf-8") for script in SCRIPTS),
        "DATA": data,
    }
    text = (HERE / "page.html").read_text(encoding="utf-8")
    return write(to, re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], text).encode())
