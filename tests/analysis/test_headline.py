"""The sentence that says whether a run held."""

from __future__ import annotations

import pandas as pd

from platoontraffic.analysis import headline
from tests.results.test_metrics import events


def said(*rows: tuple) -> str:
    metrics = pd.DataFrame([("run", "gap_min", 3.0)], columns=["scope", "metric", "value"])
    return headline(events(*rows, (60.0, "end")), metrics)


LOCKED = (0.0, "locked", "p.1", "p.0")


def test_a_platoon_that_stays_together_held():
    assert said(LOCKED) == "Held: no contacts, no splits, smallest gap 3.00 m."


def test_the_first_break_is_named_and_all_are_counted():
    rows = [(9.0, "lock_lost", "p.1", "p.0"), (11.0, "split", "p.1", "p.0"), (12.0, "collision", "p.1", "wall"),
            (13.0, "split", "p.2", "p.1")]  # fmt: skip
    assert said(LOCKED, *rows) == (
        "Did not hold: 1 contact, 2 splits, smallest gap 3.00 m; what went wrong first, at 11.00 s: "
        "p.1 was split off from p.0."
    )


def test_what_went_wrong_is_named_although_the_platoon_held():
    assert said(LOCKED, (8.0, "red_light", "p.0")).endswith("; first irregularity, at 8.00 s: p.0 ran a red light.")
    assert said(LOCKED, (8.0, "red_light", "p.0")).startswith("Held")


def test_what_an_order_brings_about_is_no_fault():
    """p.1 leaves: p.2 loses its lock on it in that instant, and is far behind p.0 until it has closed up."""
    told = (50.0, "told", "p.1", "", 0.0, "leave", 1)
    rows = [(0.0, "locked", "p.2", "p.1"), told, (50.0, "lock_lost", "p.2", "p.1"), (52.0, "split", "p.2", "p.0")]
    assert said(LOCKED, *rows).startswith("Held: no contacts, no splits")
    assert said(LOCKED, *rows, (80.0, "lock_regained", "p.2", "p.0"), (90.0, "split", "p.2", "p.0")).startswith(
        "Did not hold: no contacts, 1 split, smallest gap 3.00 m; what went wrong first, at 90.00 s"
    )


def test_a_run_in_which_members_were_stuck_did_not_hold():
    stuck = [(40.0, "stuck", "p.0"), (41.0, "stuck", "p.1"), (400.0, "stuck", "p.1")]
    assert said(LOCKED, *stuck).startswith("Did not hold: no contacts, no splits, 2 members stuck")
    assert "at 40.00 s: p.0 was stuck" in said(LOCKED, *stuck)
