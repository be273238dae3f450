"""The report of a batch as one HTML file: varied keys, metrics at each point, failed and missing runs."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from platoontraffic.analysis.limits import ENOUGH
from platoontraffic.analysis.results import Batch, load_batch
from platoontraffic.analysis.tables import are_identical
from platoontraffic.analysis.writing import write
from platoontraffic.errors import InputError, did_you_mean
from platoontraffic.report.figures import heat_map, lines, values_of
from platoontraffic.report.markup import (
    details,
    document,
    figure_files,
    first_figures,
    read_json,
    repeating,
    table,
    text,
)

MOST_ROWS = 500  # rows of a table in the page; runs.csv and summary.csv have all
MOST_VALUES = 12  # values of a key that are listed
# Metrics that are listed; the first of them that differ between runs are drawn.
FIRST = (
    "everybody_delay_mean_finished_s",  # in studies of shares: at each share the non-members are other vehicles
    "collisions",
    "lock_on_ratio_min",
    "gap_mean_m",
    "gap_min_m",
    "gap_error_rms_max_m",
    "accel_gain_l2_max",
    "cross_track_max_m",
    "near_misses",
    "ttc_min_s",
    "everybody_depart_delay_mean_finished_s",
    "traffic_delay_mean_finished_s",
)
DRAWN = 2
MOST_LINES = 7  # in a figure


def page(folder: Path, to: Path, metric: str | None = None) -> Path:
    """Make the page of a batch, finished or not, and beside it its pictures as PNG and SVG.

    metric: the columns of summary.csv that are drawn, with commas between; default: two that differ between runs

    raises: ResultsError, OSError (a file cannot be written), InputError if there is no such metric
    """
    with warnings.catch_warnings(action="ignore"):  # about missing runs, which the page lists
        batch = load_batch(Path(folder))
    to, name = Path(to), batch.folder.resolve().name
    metrics = _metrics(batch)
    asked = [name.strip() for name in metric.split(",")] if metric is not None else []
    if unknown := [name for name in asked if name not in metrics]:
        raise InputError(*(f"--metric: {n!r}: no metric in summary.csv{did_you_mean(n, metrics)}" for n in unknown))
    drawn = asked or _drawn(batch, metrics)
    pictures = "".join(_pictures(batch, drawn, to))
    chosen = "<p>The first metrics that differ between runs; --metric NAME,NAME draws others.</p>"
    listed = list(dict.fromkeys([*drawn, *(m for m in FIRST if m in metrics)]))
    points = batch.runs.drop_duplicates(batch.varied) if batch.varied else batch.runs.head(1)
    body = f"""{_facts(batch, name, len(points))}
<h2>Varied keys</h2>
{_varied(batch)}
<h2>Pictures</h2>
{chosen if pictures and not asked else ""}
{pictures or f"<p>None, because {_no_picture(batch)}.</p>"}
<h2>Metrics by point</h2>
{"".join(_by_point(batch, points, listed)) or "<p>No run is done.</p>"}
<h2>Failed runs</h2>
{_runs(batch, "failed", ("error",))}
<h2>Not done yet</h2>
{_runs(batch, "waiting", ())}"""
    title = read_json(batch.folder, "datapackage.json").get("title") or name
    return write(to, document(f"Report of {name}", title, body).encode())


def _facts(batch: Batch, name: str, points: int) -> str:
    """Line below the title, and key figures."""
    states = batch.runs.status.value_counts()
    repeated = repeating("batch", batch.folder, "study.toml", above=1)
    facts = [name, *(f"{n} {kind}" for kind, n in states.items()), f"repeat it: {repeated}"]
    counts = {
        "runs": len(batch.runs),
        "done": len(batch.summary),
        "points": points,
        "seeds": batch.runs.seed.nunique(),
    }
    figures = first_figures((what, str(count)) for what, count in counts.items())
    return f"""<p class="facts">{text(" · ".join(facts))}</p>
{figures}
{_seeds(batch)}"""


def _seeds(batch: Batch) -> str:
    """A sentence if the seed changes nothing."""
    points = batch.summary.groupby(batch.varied) if batch.varied else [((), batch.summary)]
    several = [rows for _, rows in points if len(rows) > 1]
    if not several or not all(are_identical(rows) for rows in several):
        return ""
    return "<p>Runs of a point are equal to the last digit: the seed changes nothing here, and one would do.</p>"


def _metrics(batch: Batch) -> list[str]:
    columns = batch.summary.columns.drop(["id", "seed", *batch.varied])
    return [name for name in columns if pd.api.types.is_numeric_dtype(batch.summary[name])]


def _drawn(batch: Batch, metrics: list[str]) -> list[str]:
    there = [name for name in (*FIRST, *metrics) if name in metrics and batch.summary[name].notna().any()]
    differ = [name for name in there if batch.summary[name].nunique() > 1]
    return list(dict.fromkeys(differ or there))[:DRAWN]


def _keys(batch: Batch) -> list[str]:
    """The varied keys with several values; of keys that always change together, the first."""
    points = batch.runs[batch.varied].astype(str)
    values = points.nunique()

    def together(key: str, other: str) -> bool:
        return points.groupby([key, other]).ngroups == values[key] == values[other]

    keys: list[str] = []
    for key in batch.varied:
        if values[key] > 1 and not any(together(key, other) for other in keys):
            keys.append(key)
    return keys


def _varied(batch: Batch) -> str:
    rows = []
    for key in batch.varied:
        values = batch.runs[key].astype(str).unique()
        more = f" … ({len(values)} in all)" if len(values) > MOST_VALUES else ""
        rows.append((key, str(len(values)), ", ".join(values[:MOST_VALUES]) + more))
    return (
        table("Keys of the scenario", ("key", "number of values", "values"), rows) if rows else "<p>Only the seed.</p>"
    )


def _no_picture(batch: Batch) -> str:
    if batch.summary.empty:
        return "no run is done"
    if not _metrics(batch):
        return "there are no metrics"
    return "only the seed varies" if batch.runs.seed.nunique() > 1 else "no key of the scenario varies"


def _pictures(batch: Batch, drawn: list[str], to: Path) -> Iterable[str]:
    keys = sorted(_keys(batch), key=lambda key: -batch.runs[key].astype(str).nunique())
    pooled = f"; mean over all values of {', '.join(keys[2:])}" if len(keys) > 2 else ""
    numbered = "".join(f". {meaning}" for key in keys[:2] if (meaning := values_of(batch, key).meaning))
    for metric in drawn if keys else ():
        if batch.summary[metric].isna().all():
            yield f"<p>{text(metric)}: no run has a value of it.</p>"
            continue
        unit = batch.summary.attrs["units"].get(metric, "")
        joined = "a line" if values_of(batch, keys[0]).numeric else "a colour"
        dots = "each run, and " if len(keys) == 1 else f"{joined} for each {keys[1]}, "
        fewest = batch.summary.dropna(subset=[metric]).groupby(keys[:2])["seed"].nunique().min()
        counts = metric in batch.summary.attrs.get("counts", ())  # their limits are exact, also with one seed
        few = f", too narrow with fewer than {ENOUGH} seeds" if fewest < ENOUGH and not counts else ""
        means = f"means with their 95 % intervals{few}"
        if batch.summary.seed.nunique() == 1 and not counts:
            dots, means = dots.replace("each run, and ", ""), "one seed, so without intervals"
        caption = f"{metric} over {keys[0]}: {dots}{means}{pooled}{numbered}"
        many = len(keys) > 1 and batch.runs[keys[1]].astype(str).nunique() > MOST_LINES
        if not many:
            yield figure_files(lines(batch, keys, metric, unit), to, metric, caption)
        if len(keys) > 1:
            caption = f"Mean of {metric} over {keys[0]} and {keys[1]}{pooled}; empty: no value{numbered}"
            name = metric if many else f"{metric}-map"
            yield figure_files(heat_map(batch, keys[0], keys[1], metric, unit), to, name, caption)


def _by_point(batch: Batch, points: pd.DataFrame, metrics: list[str]) -> Iterable[str]:
    shown = points.head(MOST_ROWS)
    names, of_runs = _named(batch, shown), _named(batch, batch.summary)
    more = len(points) - len(shown)
    left = f"<p>{more} more points are in summary.csv.</p>" if more else ""
    spreads = ["mean", "std", "min", "max"]
    for i, metric in enumerate(metrics):
        values = batch.summary[metric].groupby(of_runs).agg(["count", *spreads]).reindex(names)
        rows = [
            (*point, f"{n:.0f}", *("" if pd.isna(value) else f"{value:.4g}" for value in spread))
            for point, n, *spread in zip(
                shown[batch.varied].astype(str).to_numpy().tolist(),
                values["count"].fillna(0),
                *(values[name] for name in spreads),
                strict=True,
            )
        ]
        unit = batch.summary.attrs["units"].get(metric, "")
        what = f"{metric} [{unit}]" if unit else metric
        headings = (*batch.varied, "n", "mean", "standard deviation", "minimum", "maximum")
        yield details(what, table(what, headings, rows) + left, opened=i == 0)


def _named(batch: Batch, rows: pd.DataFrame) -> pd.Series:
    """The point of each row, as one text."""
    values = rows[batch.varied].astype(str).to_numpy().tolist()
    return pd.Series(["\0".join(point) for point in values], index=rows.index, dtype=str)


def _runs(batch: Batch, status: str, columns: tuple[str, ...]) -> str:
    runs = batch.runs[batch.runs.status == status]
    if runs.empty:
        return "<p>None.</p>"
    shown = runs[["id", "seed", *batch.varied, *columns]].head(MOST_ROWS).astype(str)
    more = len(runs) - len(shown)
    left = f"<p>{more} more are in runs.csv.</p>" if more else ""
    rows = [tuple(row) for row in shown.to_numpy().tolist()]
    return details(
        f"{len(runs)} of {len(batch.runs)}", table(status, shown.columns, rows) + left, opened=len(runs) <= 40
    )
