"""Pictures of a run, for files, its folder and its report: named figures, each with title, scenario and seed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from platoontraffic.analysis import crowd, figures
from platoontraffic.analysis.reading import inside
from platoontraffic.analysis.results import Results, ResultsError, load_so_far
from platoontraffic.analysis.writing import replacing

FORMATS = ("png", "svg", "pdf")


class Picture(NamedTuple):
    """A figure that can be asked for by name."""

    title: str
    draw: Callable[[Axes, Results], object]
    size: tuple[float, float] = (9, 3.4)  # [inch]


def picture(folder: Path | str, to: Path | str, what: str = "sheet") -> Path:
    """Draw a run into a file (.png, .svg or .pdf), its largest platoon in colours.

    what: a name in NAMES, or "sheet": the road, the gaps and the lock losses; of a crowd, the map

    raises: ResultsError (also: the run has no values for it), OSError (it cannot be written)
    """
    results = load_so_far(Path(folder))
    what = "map" if what == "sheet" and crowd.is_crowd(results.trajectories) else what
    return _saved(_sheet(results) if what == "sheet" else figure(results, what), Path(to))


def pictures(folder: Path | str, names: Sequence[str], format: str = "png") -> list[Path]:
    """Draw several pictures of a run, each into the file plot-NAME in its folder.

    names: in NAMES; none: all of which the run has values

    raises: as `picture`
    """
    results = load_so_far(Path(folder))
    drawn = {name: figure(results, name) for name in names} or there(results)
    return [_saved(one, results.folder / f"plot-{name}.{format}") for name, one in drawn.items()]


def there(results: Results, names: Iterable[str] = ()) -> dict[str, Figure]:
    """Those of some NAMES, or of all, of which a run has values."""
    drawn = {}
    for name in names or NAMES:
        try:
            drawn[name] = figure(results, name)
        except ResultsError:
            continue
    return drawn


def figure(results: Results, name: str) -> Figure:
    """One of PICTURES, or of OF_CROWDS if there are too many members to tell apart.

    raises: ResultsError if the run has no values for it, or too many members
    """
    known = (OF_CROWDS if (many := crowd.is_crowd(results.trajectories)) else PICTURES).get(name)
    if known is None:
        raise ResultsError(f"{name}: is drawn of {'up to' if many else 'more than'} {crowd.MOST} members")
    made = _figure(*known.size)
    axes = made.subplots()
    known.draw(axes, results)
    if axes.get_aspect() == 1:  # a map: as high as what it shows
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        made.set_size_inches(9, min(max(8.6 * (high - low) / (right - left), 1.2), 7.5) + 1.0)
    _entitle(made, known.title, results)
    _name(made, axes)
    return made


OVER_STRIPS = {  # word and column
    "gaps": ("gap", "gap_m"),
    "speeds": ("speed", "speed_mps"),
    "errors": ("spacing error", "gap_error_m"),
}


def _strips(results: Results) -> list[str]:
    """The strips of `strips_figure` that have something to show."""
    table = results.trajectories
    main = table[table.platoon_id == figures.main_platoon(table)]
    strips = [name for name, (_, column) in OVER_STRIPS.items() if main[column].notna().any()]
    if (main.place > 0).any():
        strips.append("locks")
    events = results.events[results.events.vehicle_id.isin(main.vehicle_id)]
    states = events.kind.isin([begin for begin, *_ in figures.STATES.values()]).any()
    if states or any(figures.splits(events, main).values()):
        strips.append("states")
    return strips


def _strips_title(strips: Sequence[str]) -> str:
    words = [word for name, (word, _) in OVER_STRIPS.items() if name in strips]
    listed = " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
    return f"{listed[0].upper()}{listed[1:]} over time"


def strips_caption(results: Results) -> str:
    """What `strips_figure` shows, in words."""
    strips = _strips(results)
    periods = {
        "locks": "in which a follower had lost its predecessor",
        "states": "in which a member was held at a stop line, split off or broken down",
    }
    there = [what for name, what in periods.items() if name in strips]
    return "; periods ".join([_strips_title(strips), ", and ".join(there)] if there else [_strips_title(strips)])


def strips_figure(results: Results) -> Figure:
    """Gap, speed, spacing error, lock losses and `figures.states` of the main platoon over time."""
    table, strips = results.trajectories, _strips(results)
    main = table[table.platoon_id == figures.main_platoon(table)]
    events = results.events[results.events.vehicle_id.isin(main.vehicle_id)]
    drawn = [name for name in strips if name in OVER_STRIPS]
    heights = [4 if name in drawn else 1.5 for name in strips]
    made = _figure(9, 0.8 + 0.53 * sum(heights))
    parts = made.subplot_mosaic([[name] for name in strips], height_ratios=heights, sharex=True)
    for name in drawn:
        figures.over_time(table, OVER_STRIPS[name][1], parts[name])
        figures.marks(events, parts[name], main.vehicle_id.unique())
        parts[name].tick_params(labelbottom=name == strips[-1])
        parts[name].set_xlabel("")
    if "gaps" in drawn:
        parts["gaps"].set_ylabel("gap [m]")  # the strip is too low for the long label
    if "locks" in strips:
        figures.losses(results.events, parts["locks"], results.trajectories)
        parts["locks"].set_xlabel("")
    if "states" in strips:
        figures.states(events, parts["states"], results.trajectories)
    parts[strips[-1]].set_xlabel("time [s]")
    _entitle(made, _strips_title(strips), results)
    _name(made, parts["speeds"])
    return made


def _sheet(results: Results) -> Figure:
    """The road, and where there are followers, their gaps and lock losses."""
    table = results.trajectories
    follows = bool(table.gap_m[table.platoon_id == figures.main_platoon(table)].notna().any())
    across, up = figures.extent(results.scene)
    wide = across > 2.5 * up
    made = _figure(*((11, 6) if wide else (11, 5)) if follows else (6.5, 5))
    if follows:
        beside, below = [["road", "gaps"], ["road", "locks"]], [["road"], ["gaps"], ["locks"]]
        parts = made.subplot_mosaic(below if wide else beside, height_ratios=[4, 5, 1] if wide else [6, 1])
        _over_time("gap_m")(parts["gaps"], results)
        parts["gaps"].set_xlabel("")
        parts["gaps"].tick_params(labelbottom=False)
        figures.losses(results.events, parts["locks"], results.trajectories)
        parts["locks"].sharex(parts["gaps"])
        road = parts["road"]
    else:
        road = made.subplots()
    _map(road, results)
    _entitle(made, "Paths and gaps" if follows else "Paths", results)
    _name(made, *made.axes[: 2 if follows else 1])
    return made


def _over_time(column: str) -> Callable[[Axes, Results], object]:
    """A column of the main platoon over time, with marks."""

    def draw(axes: Axes, results: Results) -> None:
        table = results.trajectories
        figures.over_time(table, column, axes)
        vehicles = table.vehicle_id[table.platoon_id == figures.main_platoon(table)].unique()
        figures.marks(results.events, axes, vehicles)

    return draw


def _of_all(column: str) -> Callable[[Axes, Results], object]:
    """A column of all members over time."""
    return lambda axes, results: crowd.over_time(results.trajectories, column, axes)


def _density(axes: Axes, results: Results) -> None:
    crowd.density(results.trajectories, axes, results.scene)
    figures.show_part(axes, results.trajectories)


def _speeds(axes: Axes, results: Results) -> None:
    crowd.speeds(results.trajectories, axes, results.scene)
    figures.show_part(axes, results.trajectories)


def _map(axes: Axes, results: Results) -> None:
    figures.paths(results.trajectories, axes, results.scene, results.events)
    figures.obstacles(results.events, axes, results.traffic)
    figures.show_part(axes, results.trajectories)


def _time_space(axes: Axes, results: Results) -> None:
    table = results.trajectories
    main = table[table.platoon_id == figures.main_platoon(table)]
    line = figures.driven_line(table)
    if line is not None and results.traffic is not None:
        figures.time_space(results.traffic, axes, line)
    figures.time_space(main, axes, line, events=results.events)
    figures.from_to(axes, main.time_s.min(), main.time_s.max())


def _amplification(axes: Axes, results: Results) -> None:
    if results.metrics.empty and not results.finished:
        raise ResultsError(f"{results.folder}: an unfinished run, which has no metrics")
    figures.gains(results.metrics, axes, figures.main_platoon(results.trajectories))


OVER_TIME = {  # title and column
    "speed": ("Speed", "speed_mps"),
    "acceleration": ("Acceleration", "accel_mps2"),
    "gap": ("Gap to the member ahead", "gap_m"),
    "error": ("Spacing error", "gap_error_m"),
    "ttc": ("Time to collision", "ttc_s"),
}
LETTER, HANDLE = 0.065, 0.55  # width of a letter in a legend, and of what is beside a label [inches]
PICTURES: Mapping[str, Picture] = {
    "map": Picture("Paths on the road", _map),
    "unrolled": Picture(
        "The road along the leader's path",
        lambda axes, results: figures.unrolled(results.trajectories, axes, results.scene),
    ),
    "timespace": Picture("Time-space diagram", _time_space, (9, 5)),
    **{name: Picture(title, _over_time(column)) for name, (title, column) in OVER_TIME.items()},
    "lateral": Picture(
        "Lateral offset along the path", lambda axes, results: figures.offsets(results.trajectories, axes)
    ),
    "amplification": Picture("String amplification", _amplification),
    "distribution": Picture(
        "Distribution of gaps in the platoon",
        lambda axes, results: figures.gap_distribution(results.trajectories, axes, results.events),
    ),
    "lanes": Picture("Lane over time", lambda axes, results: figures.lanes(results.trajectories, axes)),
}


OF_CROWDS: Mapping[str, Picture] = {
    "map": Picture("Where the members were", _density),
    "slow": Picture("Where the members were slow", _speeds),
    "number": Picture("Members on the road", lambda axes, results: crowd.number(results.trajectories, axes)),
    "timespace": Picture(
        "Time-space diagram",
        lambda axes, results: crowd.time_space(results.trajectories, axes, results.traffic),
        (9, 5),
    ),
    **{name: Picture(title, _of_all(column)) for name, (title, column) in OVER_TIME.items()},
}

NAMES = tuple(dict.fromkeys([*PICTURES, *OF_CROWDS]))


def of_run(results: Results) -> str:
    """Scenario, seed and run: the second line of every title."""
    folder = results.folder.resolve()
    try:
        seed = json.loads(inside(results.folder, "provenance.json").read_text(encoding="utf-8")).get("seed")
    except (OSError, ValueError, AttributeError):
        seed = None
    parts = [folder.parent.name, *([] if seed is None else [f"seed {seed}"]), f"run {folder.name}"]
    if not results.finished:
        parts.append(f"unfinished: until {results.trajectories.time_s.max():g} s")
    return " · ".join(parts)


def _entitle(made: Figure, title: str, results: Results) -> None:
    made.suptitle(f"{title}\n{of_run(results)}".replace("$", r"\$"), x=0.01, ha="left", fontsize=10)


def _name(made: Figure, *axes: Axes) -> None:
    """A legend below, of all lines and marks, each once."""
    found = {}
    for one in axes:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if found:
        widest = max(map(len, found)) * LETTER + HANDLE
        columns = min(max(int(made.get_figwidth() / widest), 1), 8)
        made.legend(found.values(), found.keys(), loc="outside lower center", ncols=columns, frameon=False, fontsize=8)


def _figure(width: float, height: float) -> Figure:
    made = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made


def _saved(made: Figure, to: Path) -> Path:
    if to.is_dir():
        raise ResultsError(f"{to}: is a folder; must be a picture file: .png, .svg or .pdf")
    try:
        with replacing(to) as new:
            made.savefig(new, dpi=150, metadata={"Software": None} if to.suffix == ".png" else None)
    except ValueError as error:  # no such kind of picture
        raise ResultsError(f"{to}: cannot be written: {error}") from error
    return to
