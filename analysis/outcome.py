"""The answer to "did it hold?": one sentence on a run, by its events and metrics."""

from __future__ import annotations

import pandas as pd

# Kinds of events with which a platoon did not hold, and those that are wrong although it did; each is said of its
# vehicle.
BROKEN = {
    "split": "was split off from {other}",
    "collision": "touched {other}",
    "stranded": "was stranded behind {other}",
    "never_departed": "never departed",
    "stuck": "was stuck",
}
WRONG = {
    "lock_lost": "lost its lock on its predecessor",
    "off_road": "left the road",
    "red_light": "ran a red light",
    "failed_to_yield": "failed to yield",
    "near_miss": "had a near miss with {other}",
    "near_miss_other": "had a near miss with {other}",
}


def headline(events: pd.DataFrame, metrics: pd.DataFrame) -> str:
    """Whether every follower stayed in its platoon, without contact, and what broke it first, or was irregular.

    events, metrics: the tables of a run
    """
    events = events[~_by_order(events)]
    number = {kind: int((events.kind == kind).sum()) for kind in BROKEN}
    number["stuck"] = events.vehicle_id[events.kind == "stuck"].nunique()  # one may be twice
    found = [_counted(number["collision"], "contact", "contacts"), _counted(number["split"], "split", "splits")]
    if left := number["stranded"] + number["never_departed"]:
        found.append(_counted(left, "member left out", "members left out"))
    if number["stuck"]:
        found.append(_counted(number["stuck"], "member stuck", "members stuck"))
    least = metrics.loc[(metrics.scope == "run") & (metrics.metric == "gap_min"), "value"].dropna()
    found += [f"smallest gap {gap:.2f} m" for gap in least]
    held = not any(number.values())
    wrong = events[events.kind.isin(WRONG if held else BROKEN)]
    what = "first irregularity" if held else "what went wrong first"
    first = f"; {what}, {_said(wrong.iloc[0])}" if len(wrong) else ""
    ends = events[events.kind == "end"].to_dict("records")
    locked = [end["time_s"] for end in ends if end.get("detail") == "gridlock"]
    stood = "".join(f" It ended at {time:g} s in gridlock: nobody had moved for ten minutes." for time in locked)
    return f"{'Held' if held else 'Did not hold'}: {', '.join(found)}{first}.{stood}"


def _by_order(events: pd.DataFrame) -> pd.Series:
    """Which lock losses come at the instant of an order, and which splits are from a predecessor that an order gave."""
    ordered = events.time_s[events.kind == "told"]
    found = (events.kind == "lock_lost") & events.time_s.isin(ordered)
    locks = events[events.kind.isin(["locked", "lock_regained"])]
    for i, split in events[events.kind == "split"].iterrows():
        earlier = locks[(locks.vehicle_id == split.vehicle_id) & (locks.time_s <= split.time_s)]
        found[i] = len(earlier) > 0 and earlier.other_id.iloc[-1] != split.other_id
    return found


def _said(event: pd.Series) -> str:
    """`at 11.70 s: platoon.2 was split off from platoon.1 (cut_in.0 between)`."""
    words = (BROKEN | WRONG)[event.kind].format(other=event.other_id)
    why = event.get("detail", "") if event.kind in ("split", "lock_lost") else ""
    return f"at {event.time_s:.2f} s: {event.vehicle_id} {words}{f' ({why})' if pd.notna(why) and why else ''}"


def _counted(n: int, one: str, several: str) -> str:
    return f"{n or 'no'} {one if n == 1 else several}"
