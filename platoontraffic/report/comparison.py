"""The report of runs beside each other as one HTML file: first what differs, then each run's own answer."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from platoontraffic.analysis.comparison import cells, compared, difference, difference_figure, shared_platoon
from platoontraffic.analysis.outcome import headline
from platoontraffic.analysis.reading import inside, read_table
from platoontraffic.analysis.results import Results, ResultsError, load_run
from platoontraffic.analysis.writing import write
from platoontraffic.report.figures import leaves
from platoontraffic.report.markup import details, document, figure_files, read_json, table, text


def page(folders: Sequence[Path], to: Path) -> Path:
    """Make the page of finished runs, the first of which the others are compared with; its picture is beside it.

    raises: ResultsError, OSError (a file cannot be written)
    """
    runs = [load_run(Path(folder)) for folder in folders]
    for run in runs:
        if run.trajectories.empty:
            raise ResultsError(f"{run.folder}: no member was ever on the road")
    names = _names(runs)
    metrics = compared(folders)
    title = read_json(runs[0].folder, "datapackage.json").get("title") or runs[0].folder.resolve().parent.name
    body = f"""{table("The runs", ("run", "folder", "did it hold?"), _answers(runs, names))}
<h2>What differs</h2>
{_keys(runs, names)}
{_picture(runs, names, Path(to))}
{_metrics(metrics, names)}"""
    return write(Path(to), document(f"{title}: {len(runs)} runs", title, body).encode())


def _keys(runs: Sequence[Results], names: Sequence[str]) -> str:
    """The keys of the scenario in which the runs differ; those of branches are in their names."""
    scenarios = [dict(leaves(_config(run))) for run in runs]
    keys = dict.fromkeys(key for scenario in scenarios for key in scenario if not key.startswith("branch."))
    values = {key: [scenario.get(key) for scenario in scenarios] for key in keys}
    differ = {key: row for key, row in values.items() if len(set(map(_value, row))) > 1}
    of_all = [(key, *map(_value, row)) for key, row in differ.items() if None not in row]
    of_some = [(key, *map(_value, row)) for key, row in differ.items() if None in row]
    heading = ("key", *names)
    shown = table("Keys of the scenario", heading, of_all) if of_all else ""
    others = "Keys that not all of them have, such as gains of their laws"
    return shown + (details(f"{others} ({len(of_some)})", table(others, heading, of_some)) if of_some else "")


def _value(value: Any) -> str:
    """A value as in TOML; "" if there is none."""
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else str(value)


def _picture(runs: Sequence[Results], names: Sequence[str], to: Path) -> str:
    """Differences over time to the runs that share a platoon with the first one; the others are named."""
    first, *others = runs
    shares = [shared_platoon(first, other) is not None for other in others]
    alone = [name for name, shared in zip(names[1:], shares, strict=True) if not shared]
    drawn = [(other, name) for other, name, shared in zip(others, names[1:], shares, strict=True) if shared]
    parts = []
    if drawn and all(_are_equal(first, other) for other, _ in drawn):
        parts.append("<p>No picture: at the instants that they share, the runs have equal gaps and speeds.</p>")
    elif drawn:
        figure = difference_figure(first, *zip(*drawn, strict=True))
        parts.append(figure_files(figure, to, "differences", f"Gap and speed minus those of {names[0]}, over time"))
    if alone:
        parts.append(f"<p>Not drawn, without a member that {text(names[0])} has too: {text(', '.join(alone))}.</p>")
    return "".join(parts)


def _are_equal(first: Results, other: Results) -> bool:
    """Whether gaps and speeds are equal wherever both runs have them."""
    tables = first.trajectories, other.trajectories
    return all(not difference(*tables, column)[column].any() for column in ("gap_m", "speed_mps"))


def _metrics(metrics: pd.DataFrame, names: Sequence[str]) -> str:
    """Tables of the metrics that differ."""
    of_run, of_members = (metrics[metrics.scope == scope] for scope in ("run", "vehicle"))
    if of_run.empty and of_members.empty:
        return "<p>No metric differs.</p>"
    whole = "" if of_run.empty else _differences("The whole run", of_run, names)
    return f"""{whole or "<p>No metric of the whole run differs.</p>"}
{_of_members(metrics, names)}
<p>Metrics that are equal in all runs are left out; what they mean is in each run's own report.</p>"""


def _names(runs: Sequence[Results]) -> list[str]:
    """What changes in each run: its branch, or else the name of its folder, which also tells equal ones apart.

    Runs with the same name are numbered.
    """
    branches, folders = list(map(_branch, runs)), [run.folder.resolve().name for run in runs]
    alone = "without a branch" if branches.count("") == 1 else ""
    names = [branch or alone or folder for branch, folder in zip(branches, folders, strict=True)]
    names = [
        name if names.count(name) == 1 or name == folder else f"{name}, {folder}"
        for name, folder in zip(names, folders, strict=True)
    ]
    return [
        name if names.count(name) == 1 else f"{name} ({names[: i + 1].count(name)})" for i, name in enumerate(names)
    ]


def _branch(run: Results) -> str:
    """The keys that change at a run's branch, by the row of its summary; "" if it has none."""
    branch = _config(run).get("branch")
    if not branch:
        return ""
    prefix, values = "branch.then.", read_table(inside(run.folder, "summary.csv")).iloc[0].items()
    changes = [f"{name.removeprefix(prefix)} = {value}" for name, value in values if name.startswith(prefix)]
    return f"from {branch['at_s']:g} s {', '.join(changes) or 'on'}"


def _config(run: Results) -> dict[str, Any]:
    return tomllib.loads(inside(run.folder, "config.toml").read_text(encoding="utf-8"))


def _answers(runs: Sequence[Results], names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    for run, name in zip(runs, names, strict=True):
        yield name, run.folder.resolve().name, headline(run.events, run.metrics)


def _differences(caption: str, metrics: pd.DataFrame, names: Sequence[str]) -> str:
    headings = ("metric", "unit", *(f"{name}: difference" for name in names[1:]), names[0])
    lines = [(row.metric, row.unit if isinstance(row.unit, str) else "", *cells(row)) for row in metrics.itertuples()]
    return table(caption, headings, lines)


def _of_members(metrics: pd.DataFrame, names: Sequence[str]) -> str:
    members = metrics[metrics.scope == "vehicle"]
    if members.empty:
        return ""
    tables = (_differences(vehicle, rows, names) for vehicle, rows in members.groupby("vehicle_id", sort=False))
    return details("Each member", "".join(tables))
