"""Obstacles: cars, cut-ins, pedestrians, boxes and other robots, with prescribed motion; nothing is random.

To lidars, contact detection and SUMO's drivers they are vehicles like any other. World frame, SI and radians.
"""

from platoontraffic.world.obstacles.from_scenario import plans_of
from platoontraffic.world.obstacles.obstacles import Obstacles
from platoontraffic.world.obstacles.path_line import PathLine, SpeedProfile
from platoontraffic.world.obstacles.plans import (
    Braking,
    Crossing,
    CuttingIn,
    Driving,
    LaneChange,
    Lying,
    MemberNear,
    Patrol,
    Plan,
    TargetGap,
    row_of,
)

__all__ = [
    "Braking",
    "Crossing",
    "CuttingIn",
    "Driving",
    "LaneChange",
    "Lying",
    "MemberNear",
    "Obstacles",
    "PathLine",
    "Patrol",
    "Plan",
    "SpeedProfile",
    "TargetGap",
    "plans_of",
    "row_of",
]
