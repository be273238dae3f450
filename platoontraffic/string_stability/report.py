"""Tables and the figure of a law's string stability."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w

from platoontraffic.analysis.writing import write
from platoontraffic.results.recorder import as_json
from platoontraffic.scenario import Scenario
from platoontraffic.string_stability.experiment import Norms, Swept


def frequency_table(swept: Swept) -> pd.DataFrame:
    """A row for each frequency and place: gain and phase of a follower's speed over its predecessor's."""
    rows = []
    for i, frequency in enumerate(swept.frequency):
        for k in range(swept.gain.shape[1]):
            expected = np.nan if swept.theory is None else swept.theory[i, k]
            found = swept.gain[i, k]
            rows.append((k + 1, frequency, abs(found), swept.error[i, k], abs(expected),
                         np.degrees(np.angle(found)), np.degrees(np.angle(expected))))  # fmt: skip
    columns = ["place", "frequency_hz", "gain", "gain_error", "gain_theory", "phase_deg", "phase_theory_deg"]
    return pd.DataFrame(rows, columns=columns)


def norm_table(found: Sequence[Norms]) -> pd.DataFrame:
    """A row for each profile of the leader and each place."""
    rows = [
        (one.profile, k + 1, one.l2[k], one.linf[k], one.least_gap[k], one.l2[: k + 1].prod(), one.linf[: k + 1].prod())
        for one in found
        for k in range(len(one.l2))
    ]
    columns = ["profile", "place", "accel_gain_l2", "accel_gain_linf", "least_gap_m", "to_leader_l2", "to_leader_linf"]
    return pd.DataFrame(rows, columns=columns)


def lines(swept: Swept, found: Sequence[Norms]) -> Iterator[str]:
    """Both tables for people."""
    places = range(1, swept.gain.shape[1] + 1)
    head = "".join(f"{f'|G|{k}':>8}{'theory':>8}" for k in places)
    yield f"{'Hz':>6}{head}{'phase 1':>9}{'theory':>8}"
    for i, frequency in enumerate(swept.frequency):
        theory = [np.nan] * len(places) if swept.theory is None else swept.theory[i]
        pairs = "".join(f"{abs(g):8.3f}{_number(abs(t), '8.3f')}" for g, t in zip(swept.gain[i], theory, strict=True))
        phases = f"{np.degrees(np.angle(swept.gain[i, 0])):9.1f}{_number(np.degrees(np.angle(theory[0])), '8.1f')}"
        yield f"{frequency:6.2f}{pairs}{phases}"
    yield ""
    head = "".join(f"{f'L2 {k}':>8}{f'Linf {k}':>8}" for k in places)
    yield f"{'leader':9}{head}{'tail L2':>8}{'Linf':>8}{'least gap m':>13}"
    for one in found:
        pairs = "".join(f"{a:8.3f}{b:8.3f}" for a, b in zip(one.l2, one.linf, strict=True))
        tail = "".join(f"{value:8.3f}" for value in one.head_to_tail)
        yield f"{one.profile:9}{pairs}{tail}{one.least_gap.min():13.2f}"


def deviation(swept: Swept) -> float | None:
    """Greatest |G / theory - 1| where |theory| is above 0.1; None without a theory."""
    if swept.theory is None:
        return None
    counts = np.abs(swept.theory) > 0.1
    return float(np.abs(np.abs(swept.gain[counts]) / np.abs(swept.theory[counts]) - 1).max(initial=0.0))


def deviation_place(swept: Swept) -> str:
    """Where the deviation is greatest, and how much of the leader's swing is left there.

    Where that is little, gains are mostly of something else: errors of sensors, harmonics of slower swings.
    """
    counts = np.abs(swept.theory) > 0.1
    off = np.where(counts, np.abs(np.abs(swept.gain) / np.abs(swept.theory) - 1), -1.0)
    i, k = np.unravel_index(off.argmax(), off.shape)
    left = np.abs(swept.gain[i, :k]).prod()
    return f"at {swept.frequency[i]:.2f} Hz in place {k + 1}, whose predecessor has {left:.2%} of the leader's swing"


def touched(swept: Swept, found: Sequence[Norms]) -> dict[str, list[int]]:
    """Places whose vehicle drove into or past its predecessor, by manoeuvre; those without any are left out."""
    gaps = {"multi-sine": swept.least_gap} | {one.profile: one.least_gap for one in found}
    return {name: (np.flatnonzero(gap <= 0) + 1).tolist() for name, gap in gaps.items() if (gap <= 0).any()}


def touch_line(places: Mapping[str, Sequence[int]]) -> str:
    """What `touched` says, for people."""
    each = "; ".join(f"{name}: {', '.join(map(str, of_one))}" for name, of_one in places.items())
    return f"members drive into their predecessors, so their gains there do not count. Places by manoeuvre: {each}"


def write_report(folder: Path, title: str, swept: Swept, found: Sequence[Norms]) -> list[Path]:
    """Write frequency.csv, norms.csv and string.png into a folder. raises: OSError"""
    folder.mkdir(parents=True, exist_ok=True)
    tables = {"frequency.csv": frequency_table(swept), "norms.csv": norm_table(found)}
    written = [write(folder / name, table.to_csv(index=False).encode()) for name, table in tables.items()]
    return [*written, write(folder / "string.png", _figure(title, swept, found))]


def write_origin(folder: Path, scenario: Scenario, facts: Mapping[str, Any]) -> None:
    """Write config.toml and provenance.json into the folder of a report, as a run has them. raises: OSError"""
    write(folder / "config.toml", tomli_w.dumps(scenario.resolved(folder)).encode())
    write(folder / "provenance.json", as_json(facts).encode())


def _number(value: float, form: str) -> str:
    return f"{'-':>{form.split('.')[0]}}" if np.isnan(value) else f"{value:{form}}"


def _figure(title: str, swept: Swept, found: Sequence[Norms]) -> bytes:
    """Gain and phase over frequency, and norms by place, as PNG."""
    from matplotlib.figure import Figure  # here, since it takes a second

    figure = Figure(figsize=(13, 4.2), layout="constrained")
    gain, phase, norms = figure.subplots(1, 3)
    figure.suptitle(title)
    places = range(swept.gain.shape[1])
    for k in places:
        colour = f"C{k}"
        size, angle = np.abs(swept.gain[:, k]), np.unwrap(np.angle(swept.gain[:, k]))
        gain.errorbar(swept.frequency, size, 2 * swept.error[:, k], fmt="o", ms=4, color=colour, label=f"place {k + 1}")
        phase.plot(swept.frequency, np.degrees(angle), "o", ms=4, color=colour)
        if swept.theory is not None:
            gain.plot(swept.frequency, np.abs(swept.theory[:, k]), color=colour, lw=1)
            phase.plot(swept.frequency, np.degrees(np.unwrap(np.angle(swept.theory[:, k]))), color=colour, lw=1)
    gain.axhline(1, color="0.6", lw=1)
    gain.set(xscale="log", xlabel="frequency [Hz]", ylabel="|G|, speed over the predecessor's", ylim=(0, None))
    gain.legend(title="dots: measured; lines: theory" if swept.theory is not None else None, fontsize=8)
    phase.set(xscale="log", xlabel="frequency [Hz]", ylabel="phase [deg]")
    for one, colour in zip(found, ("C0", "C1", "C2", "C3"), strict=False):
        place = np.arange(len(one.l2) + 1)
        norms.plot(place, np.append(1, one.l2.cumprod()), "o-", ms=4, color=colour, label=f"{one.profile}, L2")
        norms.plot(place, np.append(1, one.linf.cumprod()), "o--", ms=4, mfc="w", color=colour, label="L∞")
    for axes in (gain, phase):
        axes.set_xticks(ticks := [0.02, 0.05, 0.1, 0.2, 0.5], [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
    norms.axhline(1, color="0.6", lw=1)
    norms.set(xlabel="place", ylabel="acceleration over the leader's", ylim=(0, None), xticks=range(len(places) + 1))
    norms.legend(fontsize=8, ncols=2)
    file = BytesIO()
    figure.savefig(file, format="png", dpi=120)
    return file.getvalue()
