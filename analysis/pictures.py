"""Pictures of a run, for its folder and its report: several figures on one sheet."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from platoontraffic.analysis import figures
from platoontraffic.analysis.results import Results, ResultsError, load_run
from platoontraffic.analysis.writing import replacing


def picture(folder: Path | str, to: Path | str) -> Path:
    """Draw a finished run into a file (.png, .svg or .pdf), its largest platoon in colours.

    raises: ResultsError, OSError (it cannot be written)
    """
    results = load_run(Path(folder))
    follows = bool(results.trajectories.gap_m.notna().any())
    across, up = figures.extent(results.scene)
    wide = across > 2.5 * up
    figure = _figure(*((11, 6) if wide else (11, 5)) if follows else (6.5, 5))
    if follows:
        beside, below = [["road", "gaps"], ["road", "locks"]], [["road"], ["gaps"], ["locks"]]
        parts = figure.subplot_mosaic(below if wide else beside, height_ratios=[4, 5, 1] if wide else [6, 1])
        figures.over_time(results.trajectories, "gap_m", parts["gaps"])
        for time in results.events.loc[results.events.kind.isin(figures.ENCOUNTERS), "time_s"]:
            parts["gaps"].axvline(time, color=figures.OBSTACLE, linewidth=1, linestyle=":")
        parts["gaps"].set_xlabel("")
        parts["gaps"].tick_params(labelbottom=False)
        figures.losses(results.events, parts["locks"], results.trajectories)
        parts["locks"].sharex(parts["gaps"])
        road = parts["road"]
    else:
        road = figure.subplots()
    _paths_with_names(figure, road, results)
    to = Path(to)
    if to.is_dir():
        raise ResultsError(f"{to}: is a folder; must be a picture file: .png, .svg or .pdf")
    try:
        with replacing(to) as new:
            figure.savefig(new, dpi=150, metadata={"Software": None} if to.suffix == ".png" else None)
    except ValueError as error:  # no such kind of picture
        raise ResultsError(f"{to}: cannot be written: {error}") from error
    return to


def road_figure(results: Results) -> Figure:
    """The road with the path of every member."""
    across, up = figures.extent(results.scene)
    figure = _figure(9, min(max(9 * up / max(across, 1e-9), 2.2), 8))
    _paths_with_names(figure, figure.subplots(), results)
    return figure


def strips_figure(results: Results) -> Figure:
    """Gap, speed, spacing error, lock losses and `figures.states` of the main platoon over time."""
    table = results.trajectories
    columns = {"gaps": "gap_m", "speeds": "speed_mps", "errors": "gap_error_m"}
    main = table[table.platoon_id == figures.main_platoon(table)]
    there = [name for name, column in columns.items() if main[column].notna().any()]
    strips = [*there, "locks"] if (main.place > 0).any() else there
    events = results.events[results.events.vehicle_id.isin(main.vehicle_id)]
    if events.kind.isin([begin for begin, *_ in figures.STATES.values()]).any():
        strips = [*strips, "states"]
    heights = [4 if name in there else 1.5 for name in strips]
    figure = _figure(9, 0.4 + 0.53 * sum(heights))
    parts = figure.subplot_mosaic([[name] for name in strips], height_ratios=heights, sharex=True)
    for name in there:
        figures.over_time(table, columns[name], parts[name])
        parts[name].tick_params(labelbottom=name == strips[-1])
        parts[name].set_xlabel("")
    if "gaps" in there:
        parts["gaps"].set_ylabel("gap [m]")  # the strip is too low for the long label
    if "locks" in strips:
        figures.losses(results.events, parts["locks"], results.trajectories)
        parts["locks"].set_xlabel("")
    if "states" in strips:
        figures.states(events, parts["states"], results.trajectories)
    parts[strips[-1]].set_xlabel("time [s]")
    legend = parts["speeds"].get_legend_handles_labels()
    figure.legend(*legend, loc="outside upper center", ncols=6, frameon=False, fontsize=9)
    return figure


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _paths_with_names(figure: Figure, axes: Axes, results: Results) -> None:
    figures.paths(results.trajectories, axes, results.scene, results.events)
    figures.obstacles(results.events, axes, results.traffic)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
