"""Gaps along the paths of predecessors by whole arrays: the second implementation of `gaps_kernel.locate`."""

from __future__ import annotations

import numpy as np

from platoontraffic.observation.gaps import Gaps
from platoontraffic.observation.gaps_kernel import DETOUR, SIDEWAYS
from platoontraffic.observation.step import Step


class GapsByArrays(Gaps):
    def observe(self, step: Step) -> None:
        fleet, members, x, y = step.fleet, step.fleet.number, step.x, step.y
        self._paths.drive(members, x, y, fleet.motion.speed < 0)
        rows = (fleet.predecessor >= 0).nonzero()[0]
        ahead, length, axle = fleet.predecessor[rows], fleet.model.length, fleet.model.axle
        number, number_ahead = members[rows], members[ahead]
        driven = self._paths.end(number) - self._end[number]
        near, reach = self._station[number], 2 * (length[rows] + np.abs(driven))
        away = np.hypot(x[ahead] - x[rows], y[ahead] - y[rows])
        anew = self._ahead[number] != number_ahead
        near = np.where(anew, self._paths.end(number_ahead) - away, near)
        reach = np.where(anew, DETOUR * (away + length[rows]), reach)
        self._ahead[members] = -1
        self._ahead[number] = number_ahead
        station, offset = self._paths.project(number_ahead, x[rows], y[rows], near, reach)
        front = station + length[rows] / 2 - axle[rows]
        rear = self._paths.end(number_ahead) - length[ahead] / 2 - axle[ahead]
        self.gap[members] = self.cross_track[members] = np.nan
        gap, width = rear - front, fleet.model.width
        around = (station < 0) & (np.abs(offset) > width[rows] + width[ahead] - SIDEWAYS * station)
        beside = np.abs(offset) > (width[rows] + width[ahead]) / 2
        passes = (gap < 0) & (beside | (station > self._paths.end(number_ahead)))
        passes |= self._passed[number] & ~anew & (beside | (gap < 0))
        self._passed[members] = False
        self._passed[number] = passes
        elsewhere = around | passes | fleet.native[rows] & (beside | (gap < 0))
        self.beside[members] = False
        self.beside[number] = beside
        self.gap[number] = np.where(elsewhere, np.nan, gap)
        self.cross_track[number] = np.where(elsewhere, np.nan, offset)
        forgotten = np.isnan(station)
        self._station[number] = np.where(forgotten, self._station[number] + driven, station)
        self._end[members] = self._paths.end(members)
