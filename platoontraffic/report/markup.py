"""Parts of report pages: one HTML file that loads nothing, with all text escaped."""

from __future__ import annotations

import base64
import html
import io
import json
import os
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from platoontraffic.analysis.reading import inside
from platoontraffic.analysis.writing import write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HERE = Path(__file__).parent


def document(name: str, heading: str, body: str) -> str:
    """body: HTML"""
    style = (HERE / "style.css").read_text(encoding="utf-8")
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<link rel="icon" href="data:,">
<title>{text(name)}</title>
<style>
{style}
</style>
</head>
<body>
<h1>{text(heading)}</h1>
{body}
</body>
</html>
"""


def table(caption: str, headings: Iterable[str], rows: Iterable[tuple[str, ...]]) -> str:
    """A table; the first cell of a row is its heading."""
    head = "".join(f'<th scope="col">{text(heading)}</th>' for heading in headings)
    body = "".join(
        f'<tr><th scope="row">{text(first)}</th>{"".join(f"<td>{text(cell)}</td>" for cell in rest)}</tr>'
        for first, *rest in rows
    )
    whole = f"<table><caption>{text(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="wide" tabindex="0" role="region" aria-label="{text(caption)}">{whole}</div>'


def repeating(command: str, folder: Path, file: str, above: int) -> str:
    """The command that repeats a run or a batch, from the present working directory, with the same --out.

    file  : in the folder; has all that was run
    above : number of folders from the folder up to that of --out
    """
    out = folder.resolve().parents[above - 1]
    if not folder.is_absolute():
        out = Path(os.path.relpath(out))
    into = [] if out == Path("results") else ["--out", str(out)]
    return shlex.join(["platoontraffic", command, str(folder / file), *into])


def details(summary: str, inside: str, opened: bool = False) -> str:
    """inside: HTML"""
    return f"<details{' open' if opened else ''}><summary>{text(summary)}</summary>{inside}</details>"


def figure_files(figure: Figure, to: Path, name: str, caption: str) -> str:
    """A picture as a part of the page `to`; also written beside it as PNG and SVG. raises: OSError"""
    import matplotlib as mpl

    png, svg = io.BytesIO(), io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "platoontraffic"}):  # the same results give the same bytes
        figure.savefig(png, format="png", dpi=150, metadata={"Software": None})
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    files = [to.with_name(f"{to.stem}-{name}.{kind}") for kind in ("png", "svg")]
    for file, content in zip(files, (png, svg), strict=True):
        write(file, content.getvalue())
    kind, least = min(("png", png.getvalue()), ("svg+xml", svg.getvalue()), key=lambda one: len(one[1]))
    shown = f"data:image/{kind};base64,{base64.b64encode(least).decode()}"
    said = f"{caption}. Also as {' and '.join(file.name for file in files)}."
    return f'<figure><img alt="{text(caption)}" src="{shown}"><figcaption>{text(said)}</figcaption></figure>'


def first_figures(figures: Iterable[tuple[str, str]]) -> str:
    """Key figures at the top of the page: name and value."""
    said = (f"<div><dt>{text(name)}</dt><dd>{text(value)}</dd></div>" for name, value in figures)
    return f'<dl class="first">{"".join(said)}</dl>'


def text(value: object) -> str:
    return html.escape(str(value))


def read_json(folder: Path, name: str) -> dict[str, Any]:
    """A JSON file of results; empty if it cannot be read, since the rest can still be reported."""
    try:
        return json.loads(inside(folder, name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
