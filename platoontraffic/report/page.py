"""The report of a run as one HTML file: pictures, metrics with their meanings, events."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from platoontraffic.analysis import crowd
from platoontraffic.analysis.figures import main_platoon, with_followers
from platoontraffic.analysis.outcome import headline
from platoontraffic.analysis.results import Results, ResultsError, load_run
from platoontraffic.analysis.writing import write
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

MOST_EVENTS = 1000  # listed in the page; events.csv has all
CAPTIONS_OF_SCOPES = {
    "run": "The run",
    "everybody": "All trips of the traffic",
    "equipped": "Trips of members from the traffic",
    "traffic": "Trips of other vehicles",
}
CAPTIONS = {  # of the pictures of `analysis.pictures`
    "map": "The road, the path of every member, and its last position",
    "unrolled": "The road straightened along the leader's path, with kerbs and lanes; lateral scale enlarged",
    "timespace": "Time-space diagram: position along the road over time; background traffic, if recorded, in grey",
    "acceleration": "Acceleration over time",
    "ttc": "Time to collision with the predecessor while closing in on it",
    "lateral": "Lateral offset from the path of the predecessor, over the distance driven",
    "amplification": "String amplification: norms of each follower's acceleration over those of its predecessor's",
    "distribution": "Gaps in the platoon: median, quartiles, and the range of 90 % of the recorded instants",
    "lanes": "Index of the lane over time; members on one lane are drawn beside each other",
}
CAPTIONS_OF_CROWDS = {
    "map": "Where the members were: their mean number, by place",
    "slow": "Where the members were slow: their mean speed, by place",
    "number": "Members on the road over time, and those of them that stand",
    "timespace": "Time-space diagram along the path of the member that drove farthest, of all that drive along it; "
    "background traffic, if recorded, in grey",
    "speed": "Speed over time",
    "acceleration": "Acceleration over time",
    "gap": "Gap to the member ahead, in platoons",
}
MOST_PLATOONS = 12  # of which each has a table with a column a member; of more, there is one table by platoon
OF_PLATOONS = (  # metrics in that table, where the platoons have them
    "arrived", "collisions", "splits", "in_platoon_share_mean", "gap_mean", "gap_min", "gap_error_rms_max",
    "lock_on_ratio_min", "standstill_share_mean", "accel_rms_max",
)  # fmt: skip
# Metrics of the run at the top of the page; the line above has the time that was simulated.
FIRST = ("members", "collisions", "near_misses", "lock_on_ratio_min", "lock_losses", "gap_mean", "gap_min")


def page(folder: Path, to: Path) -> Path:
    """Make the page of a finished run, and beside it its pictures as PNG and SVG.

    raises: ResultsError, OSError (a file cannot be written)
    """
    results = load_run(Path(folder))
    if results.trajectories.empty:
        raise ResultsError(f"{results.folder}: no member was ever on the road")
    to = Path(to)
    package, facts = read_json(results.folder, "datapackage.json"), read_json(results.folder, "provenance.json")
    resources = {resource.get("name"): resource for resource in package.get("resources", [])}
    title = package.get("title") or results.folder.resolve().parent.name
    body = f"""<p class="facts">{text(" · ".join(_facts(results, facts)))}</p>
<p class="headline">{text(headline(results.events, results.metrics))}</p>
{_first(results)}
<h2>Pictures</h2>
{"".join(_pictures(results, to))}
<h2>Metrics</h2>
{_metrics(results, resources.get("metrics", {}).get("metrics", {}))}
<h2>Events</h2>
{_events(results, resources.get("events", {}).get("kinds", {}))}
<h2>Files of the run</h2>
{_files(results, resources)}"""
    return write(to, document(f"Report of {_name(results)}", title, body).encode())


def _name(results: Results) -> str:
    folder = results.folder.resolve()
    return f"{folder.parent.name}, run {folder.name}"


def _facts(results: Results, facts: dict[str, Any]) -> Iterable[str]:
    yield _name(results)
    for key, words in (
        ("seed", "seed {}"),
        ("version", "platoontraffic {}"),
        ("simulated_s", "{:g} s simulated"),
        ("real_time_factor", "{:g} times real time"),
    ):
        if facts.get(key) is not None:
            yield words.format(facts[key])
    yield f"repeat it: {repeating('run', results.folder, 'config.toml', above=2)} --force"


def _first(results: Results) -> str:
    """Key figures of the run."""
    run = results.metrics[results.metrics.scope == "run"].set_index("metric")
    there = [name for name in FIRST if name in run.index and pd.notna(run.value[name])]
    units = run.unit.fillna("") if "unit" in run else pd.Series("", index=run.index)
    return first_figures((name.replace("_", " "), f"{run.value[name]:.4g} {units[name]}") for name in there)


def _pictures(results: Results, to: Path) -> Iterable[str]:
    """The pictures as parts of the page; each is also written beside it."""
    from platoontraffic.analysis import pictures

    many = crowd.is_crowd(results.trajectories)
    captions = CAPTIONS_OF_CROWDS if many else CAPTIONS
    drawn = pictures.there(results, captions)
    which = "" if many else _which(results)
    yield figure_files(drawn.pop("map"), to, "road", f"{captions['map']}{which and '; the other members in grey'}")
    if not many:
        yield figure_files(pictures.strips_figure(results), to, "strips", pictures.strips_caption(results) + which)
    for name, figure in drawn.items():
        yield figure_files(figure, to, name, captions[name] + which)


def _which(results: Results) -> str:
    """The platoon that pictures show, as words for captions; "" if there is only one."""
    table = results.trajectories
    every, platoons = table.platoon_id.nunique(), len(with_followers(table))
    if every == 1:
        return ""
    if platoons in (0, every):
        which = f"the largest of {every} platoons"
    else:  # the others are leaders alone, or stand for members that are in no platoon
        which = f"the largest of {platoons} platoons with followers" if platoons > 1 else "the only one with followers"
    return f"; shows {main_platoon(table)}, {which}"


def _metrics(results: Results, meanings: dict[str, dict[str, str]]) -> str:
    """Tables of the run and of the background traffic; then of platoons and members."""
    metrics = results.metrics.dropna(subset="value")
    metrics = metrics.assign(unit=metrics.unit.fillna("") if "unit" in metrics else "")
    parts = []
    for scope, caption in CAPTIONS_OF_SCOPES.items():
        rows = metrics[metrics.scope == scope]
        if len(rows):
            lines = [(m.metric, m.unit, f"{m.value:.4g}") for m in rows.itertuples()]
            parts.append(table(caption, ("metric", "unit", "value"), lines))
            parts.append(_meanings(caption, rows.metric, meanings.get(scope, {})))
    of_members = metrics[metrics.scope == "vehicle"]
    parts += _of_many(metrics) if _are_many(of_members) else _of_each(of_members)
    parts.append(_meanings("Members", of_members.metric.unique(), meanings.get("vehicle", {})))
    return "".join(parts)


def _are_many(of_members: pd.DataFrame) -> bool:
    sizes = of_members.groupby("platoon_id").vehicle_id.nunique()
    return len(sizes) > MOST_PLATOONS or sizes.max() > crowd.MOST


def _of_many(metrics: pd.DataFrame) -> Iterable[str]:
    """A table with a row a platoon, if there are several, and the distribution of each metric over all members."""
    of_platoons = metrics[(metrics.scope == "platoon") & metrics.metric.isin(OF_PLATOONS)]
    of_members = metrics[metrics.scope == "vehicle"]
    if of_platoons.platoon_id.nunique() > 1:
        values = of_platoons.pivot_table(index="platoon_id", columns="metric", values="value", sort=False)
        units = of_platoons.drop_duplicates("metric").set_index("metric").unit
        names = [name for name in OF_PLATOONS if name in values]
        sizes = of_members.groupby("platoon_id").vehicle_id.nunique()
        lines = [
            (platoon, str(sizes[platoon]), *(_number(values.at[platoon, n]) for n in names)) for platoon in values.index
        ]
        headings = [f"{name} [{units[name]}]" if units[name] else name for name in names]
        yield details("By platoon", table("By platoon", ("platoon", "members", *headings), lines))
    lines = []
    for name, rows in of_members.groupby("metric", sort=False):
        ends = (rows.loc[getattr(rows.value, end)()] for end in ("idxmin", "idxmax"))
        extremes = [f"{_number(one.value)} ({one.vehicle_id})" for one in ends]
        middle = map(_number, rows.value.quantile([0.05, 0.5, 0.95]))
        lines.append((name, rows.unit.iloc[0], str(len(rows)), extremes[0], *middle, extremes[1]))
    headings = ("metric", "unit", "members", "least", "5 %", "median", "95 %", "greatest")
    yield table("Members", headings, lines)


def _of_each(of_members: pd.DataFrame) -> Iterable[str]:
    """A table a platoon with a column a member."""
    for n, (platoon, rows) in enumerate(of_members.groupby("platoon_id", sort=False)):
        vehicles = rows.vehicle_id.unique().tolist()
        values = rows.pivot_table(index="metric", columns="vehicle_id", values="value", sort=False)
        units = rows.drop_duplicates("metric").set_index("metric").unit
        lines = [(name, units[name], *(_number(values.at[name, v]) for v in vehicles)) for name in values.index]
        inside = table(f"Members of {platoon}", ("metric", "unit", *vehicles), lines)
        yield details(f"Members of {platoon}", inside, opened=n == 0)


def _meanings(of: str, names: Iterable[str], meanings: dict[str, str]) -> str:
    """What metrics mean, folded away."""
    rows = [(name, meanings[name]) for name in names if name in meanings]
    return details(f"{of}: meaning of each metric", table("Meanings", ("metric", "meaning"), rows)) if rows else ""


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
        "duration_s": "duration [s]",
        "detail": "detail",
    }
    there = [name for name in columns if name in events]
    rows = events[there].head(MOST_EVENTS).astype(object)
    lines = [
        tuple("" if pd.isna(v) else f"{v:g}" if isinstance(v, float) else v for v in row) for row in rows.to_numpy()
    ]
    more = f"<p>{len(events) - MOST_EVENTS} more are in events.csv.</p>" if len(events) > MOST_EVENTS else ""
    counted = table(
        "Number by kind", ("kind", "number", "meaning"), [(k, str(n), kinds.get(k, "")) for k, n in counts.items()]
    )
    each = table("All events", [columns[name] for name in there], lines)
    return counted + details("All events", each + more, opened=len(events) <= 40)


def _files(results: Results, resources: dict[str, dict]) -> str:
    lines = []
    for file in sorted(results.folder.iterdir()):
        described = next((r for r in resources.values() if r.get("path") == file.name), {})
        fields = described.get("schema", {}).get("fields", [])
        what = described.get("description") or ", ".join(field["name"] for field in fields)
        if described and file.is_file():
            lines.append((file.name, f"{file.stat().st_size / 1e6:.2f} MB", what))
    return table("Columns with unit and meaning are in datapackage.json", ("file", "size", "content"), lines)
