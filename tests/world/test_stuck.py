"""Members from the traffic that stand for too long."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.scenario import Equip
from platoontraffic.world.stuck import Stuck


def fleet(speeds, equip="equip"):
    members = [SimpleNamespace(id=f"m{i}", platoon="equip.3", equip=equip) for i in range(len(speeds))]
    return SimpleNamespace(ids=[m.id for m in members], members=members, motion=SimpleNamespace(speed=np.array(speeds)))


def table(**keys):
    return Equip.model_validate({"share": 1.0, "stuck_after_s": 10.0, **keys})


@pytest.mark.parametrize("remedy", ["wait", "remove", "sumo_drives"])
def test_a_member_is_stuck_once_it_has_stood_for_the_time(remedy):
    stuck = Stuck([table(stuck=remedy)])
    for time in np.arange(0, 10, 0.5):
        assert stuck.observe(fleet([0.0, 1.0]), time) == ([], {})
    events, remedies = stuck.observe(fleet([0.0, 1.0]), 10.0)
    assert [(one.row, one.kind, one.what) for one in events] == [(0, "stuck", remedy)]
    assert remedies == ({} if remedy == "wait" else {"m0": remedy})
    assert stuck.observe(fleet([0.0, 1.0]), 10.5) == ([], {})  # once a standstill


def test_a_member_that_moves_between_is_not_stuck():
    stuck = Stuck([table()])
    for time in np.arange(0, 40, 0.5):
        assert stuck.observe(fleet([0.0 if time % 5 else 1.0]), time) == ([], {})


def test_members_of_platoon_tables_are_not_observed():
    stuck = Stuck([table()])
    for time in (0.0, 20.0):
        assert stuck.observe(fleet([0.0], equip=""), time) == ([], {})


def test_the_time_must_be_ten_seconds_or_more():
    with pytest.raises(ValueError, match="greater than or equal to 10"):
        table(stuck_after_s=5.0)
