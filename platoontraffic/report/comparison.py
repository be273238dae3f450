"""The report of runs beside each other as one HTML file: first what differs, then each run's own answer."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from platoontraffic.analysis.comparison import cells, compared, difference_figure
from platoontraffic.analysis.outcome import headline
from platoontraffic.analysis.reading import inside, read_table
from platoontraffic.analysis.results import Results, ResultsError, load_run
from platoontraffic.analysis.writing import write
from platoontraffic.report.markup import details, document, figure_files, read_json, table


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
    drawn = difference_figure(runs[0], runs[1:], names[1:])
    body = f"""{table("The runs", ("run", "folder", "did it hold?"), _answers(runs, names))}
<h2>What differs</h2>
{figure_files(drawn, Path(to), "differences", f"Gap and speed minus those of {names[0]}, over time")}
{_differences("The whole run", metrics[metrics.scope == "run"], names)}
{_of_members(metrics, names)}
<p>Metrics that are equal in all runs are left out; what they mean is in each run's own report.</p>"""
    return write(Path(to), document(f"{title}: {len(runs)} runs", title, body).encode())


def _names(runs: Sequence[Results]) -> list[str]:
    """What changes in each run: its branch, or else the name of its folder, which also tells equal ones apart."""
    branches, folders = list(map(_branch, runs)), [run.folder.resolve().name for run in runs]
    alone = "without a branch" if branches.count("") == 1 else ""
    names = [branch or alone or folder for branch, folder in zip(branches, folders, strict=True)]
    return [
        name if names.count(name) == 1 else f"{name}, {folder}" for name, folder in zip(names, folders, strict=True)
    ]


def _branch(run: Results) -> str:
    """The keys that change at a run's branch, by the row of its summary; "" if it has none."""
    branch = tomllib.loads(inside(run.folder, "config.toml").read_text(encoding="utf-8")).get("branch")
    if not branch:
        return ""
    prefix, values = "branch.then.", read_table(inside(run.folder, "summary.csv")).iloc[0].items()
    changes = [f"{name.removeprefix(prefix)} = {value}" for name, value in values if name.startswith(prefix)]
    return f"from {branch['at_s']:g} s {', '.join(changes) or 'on'}"


def _answers(runs: Sequence[Results], names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    for run, name in zip(runs, names, strict=True):
        yield name, run.folder.resolve().name, headline(run.events, run.metrics)


def _differences(caption: str, metrics: pd.DataFrame, names: Sequence[str]) -> str:
    headings = ("metric", "unit", *(f"{name}: difference" for name in names[1:]), names[0])
    lines = [(row.metric, row.unit if isinstance(row.unit, str) else "", *cells(row)) for row in metrics.itertuples()]
    return table(caption, headings, lines)


def _of_members(metrics: pd.DataFrame, names: Sequence[str]) -> str:
    members = metrics[metrics.scope == "vehicle"]
    tables = (_differences(vehicle, rows, names) for vehicle, rows in members.groupby("vehicle_id", sort=False))
    return details("Each member", "".join(tables))
