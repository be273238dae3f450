"""One HTML file: pictures, metrics and what they mean, events; made from the run's files."""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.results import Results, ResultsError, load

HERE = Path(__file__).parent
MOST_EVENTS = 1000  # in the page; all are in events.csv
PICTURES = {
    "road": "The road, every member's path, and where it was last",
    "strips": "Gap, speed and spacing error over time, and when a follower had lost its predecessor",
}
# What one asks first of a run.
FIRST = ("duration", "members", "collisions", "near_misses", "lock_on_ratio_min", "lock_losses", "gap_mean", "gap_min")


def page(folder: Path, to: Path) -> Path:
    """Make the page of a finished run, and beside it its pictures as PNG and SVG.

    raises: ResultsError
    """
    results = load(folder)
    if results.trajectories.empty:
        raise ResultsError(f"{results.folder}: nobody was ever on the road")
    to = Path(to)
    package, facts = _json(results, "datapackage.json"), _json(results, "provenance.json")
    resources = {resource.get("name"): resource for resource in package.get("resources", [])}
    title = package.get("title") or results.folder.resolve().parent.name
    style = (HERE / "style.css").read_text(encoding="utf-8")
    text = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<link rel="icon" href="data:,">
<title>Report of {_text(_name(results))}</title>
<style>
{style}
</style>
</head>
<body>
<h1>{_text(title)}</h1>
<p class="facts">{_text(" · ".join(_facts(results, facts)))}</p>
{_first(results)}
<h2>Pictures</h2>
{"".join(_pictures(results, to))}
<h2>Metrics</h2>
{_metrics(results, resources.get("metrics", {}).get("metrics", {}))}
<h2>Events</h2>
{_events(results, resources.get("events", {}).get("kinds", {}))}
<h2>Files of the run</h2>
{_files(results, resources)}
</body>
</html>
"""
    _write(to, text.encode())
    return to


def _name(results: Results) -> str:
    folder = results.folder.resolve()
    return f"{folder.parent.name}, run {folder.name}"


def _json(results: Results, name: str) -> dict[str, Any]:
    try:
        return json.loads((results.folder / name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _facts(results: Results, facts: dict[str, Any]) -> Iterable[str]:
    yield _name(results)
    for key, words in (
        ("seed", "seed {}"),
        ("version", "platoontraffic {}"),
        ("simulated_s", "{:g} s simulated"),
        ("real_time_factor", "{:g} times as fast as real time"),
    ):
        if facts.get(key) is not None:
            yield words.format(facts[key])
    yield "again: platoontraffic run config.toml"


def _first(results: Results) -> str:
    """The run's first figures."""
    run = results.metrics[results.metrics.scope == "run"].set_index("metric")
    there = [name for name in FIRST if name in run.index and pd.notna(run.value[name])]
    units = run.unit.fillna("") if "unit" in run else pd.Series("", index=run.index)
    figures = (
        f"<div><dt>{_text(name.replace('_', ' '))}</dt><dd>{run.value[name]:.4g} {_text(units[name])}</dd></div>"
        for name in there
    )
    return f'<dl class="first">{"".join(figures)}</dl>'


def _pictures(results: Results, to: Path) -> Iterable[str]:
    """The pictures as parts of the page, each also written beside it."""
    import matplotlib as mpl

    from analysis.pictures import road_figure, strips_figure

    with mpl.rc_context({"svg.hashsalt": "platoontraffic"}):  # the same run gives the same bytes
        for name, figure in (("road", road_figure(results)), ("strips", strips_figure(results))):
            png, svg = io.BytesIO(), io.BytesIO()
            figure.savefig(png, format="png", dpi=150, metadata={"Software": None})
            figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
            files = [to.with_name(f"{to.stem}-{name}.{kind}") for kind in ("png", "svg")]
            for file, content in zip(files, (png, svg), strict=True):
                _write(file, content.getvalue())
            shown = base64.b64encode(png.getvalue()).decode()
            caption = f"{PICTURES[name]}. Also as {' and '.join(file.name for file in files)}."
            yield (
                f'<figure><img alt="{_text(PICTURES[name])}" src="data:image/png;base64,{shown}">'
                f"<figcaption>{_text(caption)}</figcaption></figure>"
            )


def _metrics(results: Results, meanings: dict[str, dict[str, str]]) -> str:
    """The run's and the traffic's values; then a table a platoon, a column a member."""
    table = results.metrics.dropna(subset="value")
    table = table.assign(unit=table.unit.fillna("") if "unit" in table else "")
    parts = []
    for scope, caption in (("run", "The run"), ("traffic", "Other traffic")):
        rows = table[table.scope == scope]
        if len(rows):
            lines = [
                (m.metric, m.unit, f"{m.value:.4g}", meanings.get(scope, {}).get(m.metric, ""))
                for m in rows.itertuples()
            ]
            parts.append(_table(caption, ("metric", "unit", "value", "meaning"), lines))
    of_members = table[table.scope == "vehicle"]
    for n, (platoon, rows) in enumerate(of_members.groupby("platoon_id", sort=False)):
        vehicles, own = rows.vehicle_id.unique().tolist(), meanings.get("vehicle", {})
        values = rows.pivot_table(index="metric", columns="vehicle_id", values="value", sort=False)
        units = rows.drop_duplicates("metric").set_index("metric").unit
        lines = [
            (name, units[name], *(_number(values.at[name, v]) for v in vehicles), own.get(name, ""))
            for name in values.index
        ]
        inside = _table(f"Members of {platoon}", ("metric", "unit", *vehicles, "meaning"), lines)
        opened = " open" if n == 0 else ""
        parts.append(f"<details{opened}><summary>Members of {_text(platoon)}</summary>{inside}</details>")
    return "".join(parts)


def _number(value: float) -> str:
    return "" if pd.isna(value) else f"{value:.4g}"


def _events(results: Results, kinds: dict[str, str]) -> str:
    events = results.events
    counts = events.kind.value_counts(sort=False)
    columns = {
        "time_s": "time [s]",
        "kind": "kind",
        "vehicle_id": "vehicle",
        "other_id": "other",
        "edge_id": "edge",
        "duration_s": "lasted [s]",
        "detail": "detail",
    }
    there = [name for name in columns if name in events]
    rows = events[there].head(MOST_EVENTS).astype(object)
    lines = [
        tuple("" if pd.isna(v) else f"{v:g}" if isinstance(v, float) else v for v in row) for row in rows.to_numpy()
    ]
    more = f"<p>{len(events) - MOST_EVENTS} more are in events.csv.</p>" if len(events) > MOST_EVENTS else ""
    told = _table(
        "How often", ("kind", "number", "meaning"), [(k, str(n), kinds.get(k, "")) for k, n in counts.items()]
    )
    each = _table("Each", [columns[name] for name in there], lines)
    opened = " open" if len(events) <= 40 else ""
    return f"{told}<details{opened}><summary>Each of them</summary>{each}{more}</details>"


def _files(results: Results, resources: dict[str, dict]) -> str:
    lines = []
    for file in sorted(results.folder.iterdir()):
        described = next((r for r in resources.values() if r.get("path") == file.name), {})
        fields = described.get("schema", {}).get("fields", [])
        what = described.get("description") or ", ".join(field["name"] for field in fields)
        if described:
            lines.append((file.name, f"{file.stat().st_size / 1e6:.2f} MB", what))
    return _table("Columns with unit and meaning are in datapackage.json", ("file", "size", "what is in it"), lines)


def _table(caption: str, headings: Iterable[str], rows: Iterable[tuple[str, ...]]) -> str:
    """A table whose rows are headed by their first cell; the last cell of each is prose."""
    head = "".join(f'<th scope="col">{_text(heading)}</th>' for heading in headings)
    body = "".join(
        f'<tr><th scope="row">{_text(first)}</th>{"".join(f"<td>{_text(cell)}</td>" for cell in rest)}</tr>'
        for first, *rest in rows
    )
    table = f"<table><caption>{_text(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="wide" tabindex="0" role="region" aria-label="{_text(caption)}">{table}</div>'


def _text(value: object) -> str:
    return html.escape(str(value))


def _write(to: Path, content: bytes) -> None:
    try:
        to.write_bytes(content)
    except OSError as error:
        raise ResultsError(f"{to}: cannot be written: {error.strerror}") from error
