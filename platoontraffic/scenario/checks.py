"""Faults of a scenario in which each table alone is sound: one check per table, which yields faults."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from platoontraffic import shipped
from platoontraffic.controllers.law import NEEDS, Law
from platoontraffic.controllers.native import MOST_IN_CONSENSUS
from platoontraffic.errors import InputError, did_you_mean, no_file
from platoontraffic.lidar import LidarModel
from platoontraffic.lidar.noise import DEFAULT_NAME
from platoontraffic.road.sumo_files import TRAFFIC, id_clashes
from platoontraffic.scenario.base import is_multiple
from platoontraffic.scenario.driver_tables import Driver
from platoontraffic.scenario.drivers import Found, Role, default_preset, drivers_of, key_of
from platoontraffic.scenario.equip_tables import Equip
from platoontraffic.scenario.faults import Fault, KeyPath
from platoontraffic.scenario.files import Files
from platoontraffic.scenario.obstacle_tables import Car, CutIn, Pedestrian, name_of
from platoontraffic.scenario.tables import Breakdown, Channel, Manoeuvre, Platoon, Spec, Sumo
from platoontraffic.scenario.vehicle_tables import Lidar

OF_CHANNEL = "needs messages; the scenario must have a [channel]: channel.latency_s=0.1 makes one"
SOME = 8  # names are enough to say what is allowed


class _Names(NamedTuple):
    """Ids, each with the number of its table."""

    members: dict[str, int]
    obstacles: dict[str, int]


def faults_of(spec: Spec, files: Files, laws: Mapping[Role, Found], folder: Path) -> Iterator[Fault]:
    """All faults. folder: the scenario file's, which its file names are relative to"""
    names = _Names(
        {f"{platoon.id}.{place}": i for i, platoon in enumerate(spec.platoon) for place in range(platoon.size)},
        {name_of(spec.obstacle, i): i for i in reversed(range(len(spec.obstacle)))},
    )
    return chain(
        _sumo(spec.sumo, files.net, folder),
        _times(spec),
        _platoons(spec),
        _equip(spec),
        _obstacles(spec, names),
        _traffic(spec, files, names),
        _drivers(spec, laws),
        _breakdowns(spec, names, laws),
        _channel(spec, names, laws),
        _manoeuvres(spec, names, laws),
    )


def faults_of_branch(
    at: float, before: Spec, laws: Mapping[Role, Law], then: Spec, laws_then: Mapping[Role, Law]
) -> list[Fault]:
    """Faults of what changes at time `at` [s], each scenario being sound by itself."""
    faults = []
    for role, law in laws_then.items():
        if law != laws[role] and (law.native or laws[role].native):
            what = "SUMO drives it, or would; such a law does not change at a branch"
            faults.append(Fault((*key_of(then, role), "law"), what))
    begun = [[one for one in spec.breakdown if one.time_s <= at] for spec in (before, then)]
    for i, one in enumerate(then.breakdown):
        if one in begun[1] and one not in begun[0]:
            what = f"{one.time_s:g}: is new, and begins before the branch; must be after branch.at_s = {at:g}"
            faults.append(Fault(("breakdown", i, "time_s"), what))
    if any(one not in begun[1] for one in begun[0]):
        what = f"leaves out or changes one that begins by branch.at_s = {at:g}; must repeat it as it is"
        faults.append(Fault(("breakdown",), what))
    return faults


def _sumo(sumo: Sumo, net: Path, folder: Path) -> Iterator[Fault]:
    if absent := no_file(net):
        hint = did_you_mean(sumo.net, shipped.networks())
        absent = absent.replace("no such file", f"no such file or shipped network{hint}")
        absent = absent.replace("is a folder", "is a folder; must be a network (.net.xml) or a shipped name")
        yield Fault(("sumo", "net"), f"{sumo.net!r}: {absent}")
    for key, names in (("routes", sumo.routes), ("additional", sumo.additional)):
        for i, name in enumerate(names):
            if absent := no_file(folder / name):
                yield Fault(("sumo", key, i), f"{name!r}: {absent}; {TRAFFIC}")
            elif "," in str(folder / name):  # SUMO would take it for two
                yield Fault(("sumo", key, i), f"{name!r}: has a comma in its path; must have none")


def _times(spec: Spec) -> Iterator[Fault]:
    """Times that must be multiples of the step."""
    times = [(("run", "duration_s"), spec.run.duration_s), (("sumo", "warm_up_s"), spec.sumo.warm_up_s)]
    record, step = spec.record, spec.run.step_s
    times += [(("record", key), getattr(record, key)) for key in ("every_s", "traffic_every_s", "scans_every_s")]
    times += [(("platoon", i, "start", "time_s"), platoon.start.time_s) for i, platoon in enumerate(spec.platoon)]
    if spec.branch:
        times.append((("branch", "at_s"), spec.branch.at_s))
        yield from _before_end(("branch", "at_s"), spec.branch.at_s, spec)
    for path, time in times:
        if time and not is_multiple(time, step):
            yield Fault(path, f"{time}: must be a multiple of run.step_s = {step}")


def _platoons(spec: Spec) -> Iterator[Fault]:
    ids = [platoon.id for platoon in spec.platoon]
    for i, platoon in enumerate(spec.platoon):
        yield from _before_end(("platoon", i, "start", "time_s"), platoon.start.time_s, spec)
        if platoon.id in ids[:i]:
            what = f"{platoon.id!r}: platoon.{ids.index(platoon.id)} has the same id; must be another"
            yield Fault(("platoon", i, "id"), what)


def _equip(spec: Spec) -> Iterator[Fault]:
    ids = [platoon.id for platoon in spec.platoon]
    for i, equip in enumerate(spec.equip):
        yield from _before_end(("equip", i, "begin_s"), equip.begin_s, spec)
        if equip.id in ids:
            yield Fault(("equip", i, "id"), f"{equip.id!r}: another table has the same id; must be another")
        ids.append(equip.id)
    for i, equip in enumerate(spec.equip if len(spec.equip) > 1 else ()):
        if equip.mode == "platoons":
            yield Fault(("equip", i, "mode"), "'platoons': there is another [[equip]] table; must be the only one")
    if spec.equip and spec.branch:
        yield Fault(("branch",), "changes members of [[platoon]] tables only; must be left out beside [[equip]]")


def _obstacles(spec: Spec, names: _Names) -> Iterator[Fault]:
    for i, obstacle in enumerate(spec.obstacle):
        at, name = ("obstacle", i), name_of(spec.obstacle, i)
        if names.obstacles[name] != i:
            yield Fault((*at, "id"), f"{name!r}: obstacle.{names.obstacles[name]} has the same id; must be another")
        if name in names.members:
            yield Fault((*at, "id"), f"{name!r}: is a member of a platoon; must be another")
        yield from _before_end((*at, "time_s"), obstacle.time_s, spec)
        if isinstance(obstacle, Car):
            yield from _before_end((*at, "brakes_at_s"), obstacle.brakes_at_s, spec)
        elif isinstance(obstacle, CutIn):
            yield from _member((*at, "ahead_of"), obstacle.ahead_of, names)
            yield from _has_gap_ahead((*at, "ahead_of"), obstacle.ahead_of, names)
        elif isinstance(obstacle, Pedestrian) and obstacle.when:
            yield from _member((*at, "when", "member"), obstacle.when.member, names)


def _has_gap_ahead(path: KeyPath, name: str, names: _Names) -> Iterator[Fault]:
    if name in names.members and _role(name) == "leader":
        followers = [member for member in names.members if _role(member) == "follower"]
        some = f": {', '.join(followers[:SOME])}" if followers else ""
        yield Fault(path, f"{name!r}: leads, there is no gap before it; must be a follower{some}")


def _traffic(spec: Spec, files: Files, names: _Names) -> Iterator[Fault]:
    """Background vehicles with the id of a member or of an obstacle."""
    for path, file in files.of_traffic(spec.sumo):
        if no_file(file):  # reported above
            continue
        try:
            clashes = id_clashes(file, names.members | names.obstacles)
        except InputError as error:
            yield from (Fault(path, fault) for fault in error.faults)
            continue
        yield from _clashes(clashes, spec, names)


def _clashes(clashes: list[tuple[str, str]], spec: Spec, names: _Names) -> Iterator[Fault]:
    """clashes: id and `file:line: what`; the first one of a platoon is enough"""
    said: set[int] = set()
    for name, clash in clashes:
        if name in names.obstacles:
            what = f"{name!r}: {clash}, the id of this obstacle; must be another"
            yield Fault(("obstacle", names.obstacles[name], "id"), what)
        elif (i := names.members[name]) not in said:
            said.add(i)
            yield Fault(("platoon", i, "id"), f"{spec.platoon[i].id!r}: {clash}, the id of a member; must be another")


def _drivers(spec: Spec, laws: Mapping[Role, Found]) -> Iterator[Fault]:
    for role, driver in drivers_of(spec):
        found, at, group = laws[role], key_of(spec, role), spec.groups[role[0]]
        yield from found.faults
        if found.law is not None:
            if isinstance(group, Equip):
                yield from _alone(at, driver, found.law, group, spec.channel)
            else:
                yield from _needs(at, driver, found.law, group, spec.channel)
            yield from _sensors((*at, "sensors"), driver, found, spec.run.step_s)
        if found.kind is None:
            continue
        if not found.kind.native:
            preset = default_preset(role[1], found.kind, group.model(0))
            coarsest = found.law.coarsest if found.law else math.inf
            yield from _lidars(at, driver, preset, group, spec.run.step_s, coarsest)


def _needs(at: KeyPath, driver: Driver, law: Law, platoon: Platoon, channel: Channel | None) -> Iterator[Fault]:
    if not {"route", "signals"}.isdisjoint(law.needs) and not platoon.route and not platoon.to:
        key = f"platoon.{at[1]}"
        what = f"{driver.law!r} needs {key}.route, the edges to drive, or {key}.to, the last of them"
        yield Fault((*at, "law"), what)
    if law.controller == "CONSENSUS" and platoon.size > MOST_IN_CONSENSUS:
        what = f"'CONSENSUS': a size of {platoon.size}; SUMO has it for up to {MOST_IN_CONSENSUS}"
        yield Fault((*at, "controller"), what)
    if "messages" in law.needs and channel is None:
        yield Fault((*at, "law"), f"{driver.law!r} {OF_CHANNEL}")


def _alone(at: KeyPath, driver: Driver, law: Law, equip: Equip, channel: Channel | None) -> Iterator[Fault]:
    """Members from the traffic have a route; alone or when routes part, they have no predecessor."""
    if "messages" in law.needs and equip.mode == "single":
        yield Fault((*at, "law"), f"{driver.law!r} needs messages; in mode 'single' no other member sends to it")
    elif "messages" in law.needs and channel is None:
        yield Fault((*at, "law"), f"{driver.law!r} {OF_CHANNEL}")
    elif law.vehicle_type:
        what = "vehicles of the traffic keep the car-following model of their type; must be left out"
        yield Fault((*at, "model"), f"{law.model!r}: {what}")
    elif at[-1] == "leader" and not law.native and "route" not in law.needs:
        yield Fault((*at, "law"), f"{driver.law!r} does not need its route, so it would never arrive")
    elif not (law.native or law.drives_alone or at[-1] == "leader"):
        what = 'cannot drive alone; must be a law that declares drives_alone, such as "tracking" with on_loss = "drive"'
        yield Fault((*at, "law"), f"{driver.law!r} {what}")


def _sensors(at: KeyPath, driver: Driver, found: Found, step: float) -> Iterator[Fault]:
    for name in driver.sensors:
        if name in NEEDS:
            yield Fault((*at, name), f"{name!r}: every law can be given this; the sensor must have another name")
        elif name not in found.law.needs:
            yield Fault((*at, name), f"{driver.law!r} does not declare {name!r} in its needs, so it would not get it")
    for (name, sensor), _ in found.sensors:
        if not is_multiple(1 / sensor.rate, step):
            what = f"its interval must be a multiple of run.step_s = {step}, as at {1 / step:g} Hz"
            yield Fault((*at, name), f"rate = {sensor.rate:g} Hz: {what}")


def _lidars(
    at: KeyPath, driver: Driver, preset: str, group: Platoon | Equip, step: float, coarsest: float
) -> Iterator[Fault]:
    """coarsest: as of `Law`"""
    main = _lidar((*at, "lidar"), driver.lidar, preset, group)
    if isinstance(main, Fault):
        yield main
        return
    if not is_multiple(1 / main.rate, step):
        what = f"the scan interval must be a multiple of run.step_s = {step}, as at {1 / step:g} Hz"
        yield Fault((*at, "lidar", "rate_hz"), f"{main.rate:g}: {what}")
    if main.angle_increment >= coarsest:
        apart, most = math.degrees(main.angle_increment), math.degrees(coarsest)
        what = f"beams {apart:.3g} deg apart; must be nearer than {most:.3g} deg for {driver.law!r}"
        yield Fault((*at, "lidar", "samples"), f"{main.samples}: {what}")
    for name, table in driver.lidars.items():
        path = (*at, "lidars", name)
        further = _lidar(path, table, preset, group)
        if isinstance(further, Fault):
            yield further
        elif not is_multiple(1 / further.rate, 1 / main.rate):
            what = f"the scan interval must be a multiple of that of lidar, as at {main.rate:g} Hz"
            yield Fault((*path, "rate_hz"), f"{further.rate:g}: {what}")
        if name == DEFAULT_NAME:
            yield Fault(path, f"{name!r}: is the name of the scanner of the key `lidar`; must be another")


def _lidar(at: KeyPath, table: Lidar, preset: str, group: Platoon | Equip) -> LidarModel | Fault:
    try:
        return table.model(preset, group.model(0).length)
    except ValueError as error:
        return Fault(at, str(error))


def _breakdowns(spec: Spec, names: _Names, laws: Mapping[Role, Found]) -> Iterator[Fault]:
    for i, breakdown in enumerate(spec.breakdown):
        at, name = ("breakdown", i), breakdown.vehicle
        yield from _affects(at, breakdown, spec, names)
        law = _law(name, names, laws)
        if breakdown.what == "laser" and law is not None and law.native:
            yield Fault((*at, "what"), f"'laser': {name} has none, because SUMO drives it; must be 'drive'")
        if breakdown.lasts_s is not None and breakdown.lasts_s < spec.run.step_s:
            what = f"{breakdown.lasts_s:g}: must be at least a step, run.step_s = {spec.run.step_s:g}"
            yield Fault((*at, "lasts_s"), what)
        for k, other in enumerate(spec.breakdown[:i]):
            yield from _overlap((*at, "time_s"), breakdown, k, other)


def _channel(spec: Spec, names: _Names, laws: Mapping[Role, Found]) -> Iterator[Fault]:
    channel, step = spec.channel, spec.run.step_s
    if channel is None:
        return
    found = [one.law for one in laws.values() if one.law is not None]
    if spec.branch is None and len(found) == len(laws) and not any("messages" in law.needs for law in found):
        yield Fault(("channel",), "no law needs messages, so nobody receives them; must be left out")
    if not is_multiple(1 / channel.rate_hz, step):
        what = f"the interval must be a multiple of run.step_s = {step}, as at {1 / step:g} Hz"
        yield Fault(("channel", "rate_hz"), f"{channel.rate_hz:g}: {what}")
    least = 1 / channel.rate_hz + channel.latency_s
    if channel.lost_after_s is not None and channel.lost_after_s < least:
        what = f"{channel.lost_after_s:g}: a message is that old when the next arrives; must be at least {least:g}"
        yield Fault(("channel", "lost_after_s"), what)
    for i, one in enumerate(channel.blackout):
        at = ("channel", "blackout", i)
        yield from _before_end((*at, "time_s"), one.time_s, spec)
        for key in ("sender", "receiver"):
            if (name := getattr(one, key)) is not None:
                yield from _member((*at, key), name, names)


def _overlap(path: KeyPath, breakdown: Breakdown, k: int, other: Breakdown) -> Iterator[Fault]:
    same = (breakdown.vehicle, breakdown.what) == (other.vehicle, other.what)
    if same and breakdown.begins_before_end_of(other) and other.begins_before_end_of(breakdown):
        until = "to the end" if other.lasts_s is None else f"until {other.time_s + other.lasts_s:g}"
        yield Fault(path, f"{breakdown.time_s:g}: breakdown.{k} breaks the same {breakdown.what} {until}")


def _manoeuvres(spec: Spec, names: _Names, laws: Mapping[Role, Found]) -> Iterator[Fault]:
    for i, order in enumerate(spec.manoeuvre):
        at, name = ("manoeuvre", i), order.vehicle
        yield from _affects(at, order, spec, names)
        if order.behind is not None:
            yield from _member((*at, "behind"), order.behind, names)
        if order.behind == name:
            yield Fault((*at, "behind"), f"{name!r}: cannot follow itself; must be another member")
        if name not in names.members:
            continue
        law = _law(name, names, laws)
        if order.kind == "split" and _role(name) == "leader":
            yield Fault((*at, "vehicle"), f"{name!r}: leads already; must be a follower")
        elif law is not None and not law.drives_alone:
            driver = f"platoon.{names.members[name]}.{_role(name)}"
            what = f"{driver} cannot drive alone; must be a law that declares drives_alone, such as "
            what += '"tracking" with on_loss = "drive"'
            yield Fault((*at, "vehicle"), f"{name!r}: {what}")


def _affects(at: KeyPath, one: Breakdown | Manoeuvre, spec: Spec, names: _Names) -> Iterator[Fault]:
    """A breakdown or an order must name a member that has departed by then."""
    yield from _member((*at, "vehicle"), one.vehicle, names)
    yield from _before_end((*at, "time_s"), one.time_s, spec)
    if one.vehicle in names.members:
        departs = spec.platoon[names.members[one.vehicle]].start.time_s
        if one.time_s < departs:
            what = f"{one.time_s:g}: {one.vehicle} departs at {departs:g}; must not be earlier"
            yield Fault((*at, "time_s"), what)


def _member(path: KeyPath, name: str, names: _Names) -> Iterator[Fault]:
    if name not in names.members:
        yield Fault(path, f"{name!r}: no such member{did_you_mean(name, names.members)}")


def _before_end(path: KeyPath, time: float | None, spec: Spec) -> Iterator[Fault]:
    if time is not None and time >= spec.run.duration_s:
        yield Fault(path, f"{time:g}: must be before the end, run.duration_s = {spec.run.duration_s:g}")


def _law(member: str, names: _Names, laws: Mapping[Role, Found]) -> Any:
    """The law of a member; None if there is no such member, or if its law could not be made."""
    role = names.members.get(member, -1), _role(member)
    return laws[role].law if role in laws else None


def _role(member: str) -> str:
    return "leader" if member.endswith(".0") else "follower"
