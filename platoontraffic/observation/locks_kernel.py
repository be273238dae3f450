"""Surfaces that beams meet about the bearing of a target, and returns from a predecessor; compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar import laserscan
from platoontraffic.lidar.compiled import compiler
from platoontraffic.lidar.laserscan import NO_HIT

BEAMS_ABOUT = 3  # beams to either side that vote: a bearing may lie between beams, or on one that met nothing

NOT_SCANNED = -1  # number of beams in a row without a new scan

compiled = compiler(__file__, laserscan.__file__)


@compiled
def count_in(number, beams, alone, all_beams, occluded):
    """Fill in `Locks.beams` and `Locks.occluded`, (N,), from a `Sight` of members with these numbers, (n,).

    returns: how many of these have scanned
    """
    scanned = 0
    for i in range(len(number)):
        if beams[i] == NOT_SCANNED:
            continue
        scanned += 1
        all_beams[number[i]] = beams[i]
        occluded[number[i]] = max(1 - beams[i] / alone[i], 0.0) if alone[i] > 0 else math.nan
    return scanned


@compiled
def look_rows(places, ranges, hits, directions, fan, eye, boxes, bearing, surface, beams, alone):
    """`locks.look` for m members with scans (m, k); fills in surface, beams and alone, (n,).

    places: the members' rows in the fleet; their rows, and those of their predecessors, among all vehicles; (m,)
    fan: first angle, increment, greatest range; eye: x, y, yaw of the laser in the vehicle's frame
    boxes: x, y, heading, length, width of all vehicles
    """
    angle_min, increment, range_max = fan
    rows, own, ahead = places
    for i in range(len(rows)):
        row = rows[i]
        beam = np.rint((bearing[row] - angle_min) / increment)
        surface[row] = _most_about(beam, ranges[i], hits[i])
        beams[row] = alone[row] = 0
        if ahead[i] >= 0:
            for k in range(hits.shape[1]):
                beams[row] += (hits[i, k] == ahead[i]) & (ranges[i, k] < np.inf)
            alone[row] = _beams_across(own[i], ahead[i], boxes, eye, directions, range_max)


@compiled
def _most_about(beam, ranges, hits):
    """The surface that most beams about one beam met; of several, that of the lowest number."""
    first, last = max(beam - BEAMS_ABOUT, 0.0), min(beam + BEAMS_ABOUT, len(hits) - 1.0)
    if math.isnan(beam) or first > last:
        return NO_HIT
    found, most = NO_HIT, 0
    about = range(int(first), int(last) + 1)
    for k in about:
        votes = 0
        for other in about:
            # A lost return is NaN.
            votes += (hits[other] == hits[k]) & (ranges[k] < np.inf) & (ranges[other] < np.inf)
        if votes > most or (votes == most and votes > 0 and hits[k] < found):
            most, found = votes, hits[k]
    return found


@compiled
def _beams_across(row, other, boxes, eye, directions, range_max):
    """Number of beams from one vehicle that would meet the box of another if nothing else is there."""
    x, y, heading, length, width = boxes
    # In the frame of the box, a beam meets it where it is between rear and front and between the sides at once.
    cos, sin = math.cos(heading[row]), math.sin(heading[row])
    away_x = x[row] + cos * eye[0] - sin * eye[1] - x[other]
    away_y = y[row] + sin * eye[0] + cos * eye[1] - y[other]
    cos, sin = math.cos(heading[other]), math.sin(heading[other])
    from_x, from_y = cos * away_x + sin * away_y, cos * away_y - sin * away_x
    turned = heading[row] + eye[2] - heading[other]
    cos, sin = math.cos(turned), math.sin(turned)
    front, side = length[other] / 2, width[other] / 2
    count = 0
    for k in range(directions.shape[1]):
        per_x = 1.0 / (cos * directions[0, k] - sin * directions[1, k])
        per_y = 1.0 / (sin * directions[0, k] + cos * directions[1, k])
        a, b = (-front - from_x) * per_x, (front - from_x) * per_x
        c, d = (-side - from_y) * per_y, (side - from_y) * per_y
        enters, leaves = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))
        count += (enters <= leaves) & (leaves >= 0.0) & (enters <= range_max)
    return count
