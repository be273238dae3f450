"""A checked scenario: what its file and the arguments say, and everything that they name."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from platoontraffic import shipped
from platoontraffic.controllers.gains import table_of
from platoontraffic.plug_ins import is_shipped
from platoontraffic.road.sumo_configuration import Configuration
from platoontraffic.scenario.configurations import step_fits
from platoontraffic.scenario.drivers import FoundSensor, Role, default_preset, drivers_of, further_lidars
from platoontraffic.scenario.faults import Fault, KeyPath, dotted
from platoontraffic.scenario.metric_plug_ins import MetricPlugIns
from platoontraffic.scenario.overrides import Change
from platoontraffic.scenario.tables import Spec
from platoontraffic.scenario.vehicle_tables import Lidar

REPLAY_TRAFFIC, REPLAY_SCANS = 0.5, 0.25  # sampling intervals of a replay [s]
REPLAY_RANGES = 10e6  # most measured ranges in a replay; where there would be more, scans are recorded less often


@dataclass(frozen=True)
class Scenario:
    """Everything that a run is made from, checked but for what needs the road network to be read."""

    spec: Spec
    source: Path  # the scenario's file, or the SUMO configuration
    net: Path
    route_files: tuple[Path, ...]
    additional: tuple[Path, ...]
    configuration: Configuration | None
    laws: dict[Role, Any]
    plug_ins: dict[Role, Path]  # files beside the scenario that laws are named by
    sources: tuple[Path, ...]  # modules of all laws that are not shipped, and files that gains name
    metrics: MetricPlugIns
    sensors: dict[Role, tuple[FoundSensor, ...]]
    varied: dict[str, Any]  # values of the keys that arguments changed
    place: Callable[[KeyPath, str], str]  # where a key is, given its fault: `file:line`, or the argument that set it
    then: Scenario | None = None  # after the branch: with other laws, errors or breakdowns; None: there is no branch
    branched: Callable[[Sequence[Change]], Scenario] | None = field(default=None, repr=False, compare=False)
    """The scenario with changes of its key `branch`, in place of those that it has. raises: InputError"""

    def fault(self, path: KeyPath, what: str) -> str:
        """`file:line: key: what`."""
        return placed(Fault(path, what), self.place)

    @property
    def seed(self) -> int:
        return self.spec.seed

    @property
    def begin(self) -> float:
        """SUMO's time when it begins [s]."""
        return self.configuration.begin if self.configuration else 0.0

    @property
    def scale(self) -> float:
        """Factor on the number of vehicles in the route files."""
        of_configuration = self.configuration.options.get("scale", 1) if self.configuration else 1
        return (self.spec.sumo.demand or 1.0) * float(of_configuration)

    @property
    def start(self) -> float:
        """SUMO's time at time 0 of the run [s]; it takes two steps to place the platoons."""
        return self.begin + self.spec.sumo.warm_up_s + 2 * self.spec.run.step_s

    def files(self) -> dict[str, Path]:
        """Every input file, by a name that says its purpose."""
        config = {"config": self.configuration.path} if self.configuration else {}
        further = self.configuration.inputs if self.configuration else ()
        return {
            **config,
            f"net.{self.net.name}": self.net,
            **{f"routes.{i}.{file.name}": file for i, file in enumerate(self.route_files)},
            **{f"additional.{i}.{file.name}": file for i, file in enumerate(self.additional)},
            **{f"config.{i}.{file.name}": file for i, file in enumerate(further)},
            **{f"law.{i}.{file.name}": file for i, file in enumerate(self.sources)},
            **{f"metric.{i}.{file.name}": file for i, file in enumerate(self.metrics.sources)},
        }

    @property
    def additional_of_sumo(self) -> list[Path]:
        """The additional files but polygons, which are for lasers and pictures."""
        return [file for file in self.additional if ".poly.xml" not in file.name]

    def files_of_sumo(self) -> list[Path]:
        """The input files that SUMO reads, or that say how it runs."""
        config = (self.configuration.path, *self.configuration.inputs) if self.configuration else ()
        return [*config, self.net, *self.route_files, *self.additional]

    def remarks(self) -> list[str]:
        """Options of the SUMO configuration that the run does not use."""
        config = self.configuration
        if config is None:
            return []
        ignored = [f"options that are not used: {', '.join(config.ignored)}"] if config.ignored else []
        return [f"{config.path}: {remark}" for remark in (*ignored, *self.replaced())]

    def replaced(self) -> list[str]:
        """Seed and step of the SUMO configuration, where the run has others: one text each."""
        config, step = self.configuration, self.spec.run.step_s
        texts = []
        if config and config.seed not in (None, self.seed):
            texts.append(f"seed = {config.seed} is not used: the run has seed = {self.seed}")
        if config and config.step not in (None, step):
            why = "" if step_fits(config.step, step) else ", because every laser scan must fall on a step"
            texts.append(f"step-length = {config.step:g} is not used: SUMO has run.step_s = {step:g}{why}")
        return texts

    @property
    def random(self) -> bool:
        """Whether anything may differ between seeds: vehicles that SUMO drives, errors of sensors, messages, and laws
        that are not shipped, because they may draw numbers themselves."""
        spec, channel = self.spec, self.spec.channel
        drawn = channel is not None and any((channel.jitter_s, channel.loss, channel.burst_loss))
        of_sumo = self.configuration or self.route_files or self.additional_of_sumo or spec.equip
        driven = any(law.native or not is_shipped(type(law)) for law in self.laws.values())
        return bool(drawn or of_sumo or driven or any(map(self._errs, self.laws)) or (self.then and self.then.random))

    def _errs(self, role: Role) -> bool:
        """Whether a driver's sensors have errors that are drawn, or are those of a plug-in."""
        driver, length = getattr(self.spec.groups[role[0]], role[1]), self.spec.groups[role[0]].model(0).length
        lasers = [driver.lidar.model(self.default_preset(role), length)]
        lasers += [one.model(self.default_preset(role), length) for one in self.further_lidars(role).values()]
        return bool(self.sensors[role] or any(one.noise.random for one in lasers) or not driver.odometry.model().exact)

    def for_replay(self) -> Scenario:
        """The scenario with all tables recorded that a replay shows; intervals that are given stay.

        Scans are by far the most of it, so where there are many beams they are recorded less often.
        """
        run, record = self.spec.run, self.spec.record
        traffic, scans = (math.ceil(every / run.step_s - 1e-9) * run.step_s for every in (REPLAY_TRAFFIC, REPLAY_SCANS))
        scans *= math.ceil(run.duration_s * self._beams() / (scans * REPLAY_RANGES))
        intervals = {
            "traffic_every_s": record.traffic_every_s or round(traffic, 3),
            "scans_every_s": record.scans_every_s or round(scans, 3) or None,  # None: only vehicles of the traffic
            "sumo": [*record.sumo, *({"signals"} - set(record.sumo))],
        }
        spec = self.spec.model_copy(update={"record": record.model_copy(update=intervals)})
        return replace(self, spec=spec, branched=lambda changes: self.branched(changes).for_replay())

    def default_preset(self, role: Role) -> str:
        """The lidar of a driver that names none."""
        return default_preset(role[1], self.laws[role], self.spec.groups[role[0]].model(0))

    def further_lidars(self, role: Role) -> dict[str, Lidar]:
        """The tables of a driver's further lasers, by name."""
        driver = getattr(self.spec.groups[role[0]], role[1])
        return further_lidars(driver, self.default_preset(role), self.laws[role])

    def _beams(self) -> int:
        """Beams of all members' lidars in one scan each."""
        beams = 0
        for (i, role), driver in drivers_of(self.spec):
            if i >= len(self.spec.platoon):
                break  # how many there will be is not known
            group = self.spec.groups[i]
            lidar = driver.lidar.model(self.default_preset((i, role)), group.model(0).length)
            beams += lidar.samples * (1 if role == "leader" else (group.size or 1) - 1)
        return beams

    def resolved(self, folder: Path | None = None) -> dict[str, Any]:
        """All keys with their values, as for TOML. Files are named relative to `folder`; without one, by ""."""
        table = self.spec.model_dump(exclude_none=True)
        for key in ("platoon", "equip", "obstacle", "manoeuvre", "breakdown"):
            if not table[key]:
                del table[key]
        if "channel" in table and not table["channel"]["blackout"]:
            del table["channel"]["blackout"]
        table["sumo"] |= self._resolved_files(folder)
        table["record"]["metrics"] = self.metrics.names(lambda file: _relative(file, folder))
        for platoon in table.get("platoon", []):
            if "vehicles" in platoon:
                del platoon["vehicle"]
        for (i, role), _ in drivers_of(self.spec):
            key, number = self.spec.key_of(i)
            table[key][number][role] = self._resolved_driver((i, role), folder)
        if self.then:
            table["branch"]["then"] = self._resolved_changes(folder)
        return table

    def _resolved_changes(self, folder: Path | None) -> dict[str, Any]:
        """The drivers and the breakdowns that change at the branch, whole; all drivers if none changes."""
        roles = [role for role, _ in drivers_of(self.spec)]
        before, then = ({role: one._resolved_driver(role, folder) for role in roles} for one in (self, self.then))
        changed = {f"platoon.{i}.{name}": then[i, name] for i, name in roles if then[i, name] != before[i, name]}
        if self.then.spec.breakdown != self.spec.breakdown:
            changed["breakdown"] = [one.model_dump(exclude_none=True) for one in self.then.spec.breakdown]
        return changed or {f"platoon.{i}.{name}": then[i, name] for i, name in roles}

    def _resolved_files(self, folder: Path | None) -> dict[str, Any]:
        """Keys of the table `sumo` that name files."""
        sumo, named = self.spec.sumo, {}
        if self.configuration:
            named["config"] = _relative(self.configuration.path, folder)
        elif sumo.net not in shipped.networks():
            named["net"] = _relative(self.net, folder)
        for key, files in (("routes", self.route_files), ("additional", self.additional)):
            brought = len(files) - len(getattr(sumo, key))  # by the network or the configuration
            named[key] = [_relative(file, folder) for file in files[brought:]]
        return named

    def _resolved_driver(self, role: Role, folder: Path | None) -> dict[str, Any]:
        """The table of a leader or follower, with all gains of its law."""
        law, driver = self.laws[role], getattr(self.spec.groups[role[0]], role[1])
        name = driver.law
        if file := self.plug_ins.get(role):
            name = f"{_relative(file, folder)}:{name.rsplit(':', 1)[1]}"
        return {
            "law": name,
            **table_of(law, lambda file: _relative(file, folder)),
            "lidar": {"preset": self.default_preset(role)} | driver.lidar.model_dump(exclude_none=True),
            "odometry": driver.odometry.model_dump(exclude_none=True),
        } | self._resolved_extras(role, folder)

    def _resolved_extras(self, role: Role, folder: Path | None) -> dict[str, Any]:
        """The tables of further lasers and of sensors, where there are any."""
        lidars = {name: one.model_dump(exclude_none=True) for name, one in self.further_lidars(role).items()}
        driver, sensors = getattr(self.spec.groups[role[0]], role[1]), {}
        for (name, sensor), file in self.sensors[role]:
            written = driver.sensors[name].sensor
            if file:
                written = f"{_relative(file, folder)}:{written.rsplit(':', 1)[1]}"
            sensors[name] = {"sensor": written, **table_of(sensor, lambda path: _relative(path, folder))}
        return {key: table for key, table in (("lidars", lidars), ("sensors", sensors)) if table}


def placed(fault: Fault, place: Callable[[KeyPath, str], str]) -> str:
    """`file:line: key: what`."""
    return f"{place(*fault)}: {dotted(fault.path)}: {fault.what}"


def _relative(file: Path, folder: Path | None) -> str:
    return relative_to(file, folder) if folder else ""


def relative_to(file: Path, folder: Path) -> str:
    """The path of a file as seen from a folder; the whole path where they are on two drives of Windows."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return file.resolve().as_posix()
