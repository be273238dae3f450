"""Scenario files: TOML in, checked and resolved, before anything starts.

Keys carry their unit; here, once, they become SI and radians. What is wrong is said in one line a fault:
`file:line: key: what; what is allowed`.
"""

from __future__ import annotations

import copy
import math
import os
import re
import shlex
import tomllib
import typing
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError

from platoontraffic import shipped
from platoontraffic.controllers.gains import keys_of, law_of, with_files
from platoontraffic.controllers.registry import Law, find_law, plug_in_file
from platoontraffic.errors import InputError, did_you_mean
from platoontraffic.lidar import PRESETS, LidarModel, Mount, Noise
from platoontraffic.road.network import Configuration, Network, id_clashes, read_configuration
from platoontraffic.scenario import metric_plug_ins, obstacle_tables, toml_lines
from platoontraffic.scenario.metric_plug_ins import MetricPlugIns
from platoontraffic.vehicles.bicycle import Car
from platoontraffic.vehicles.catalogue import VEHICLES, VehicleModel
from platoontraffic.vehicles.motion import DifferentialDrive
from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors

Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0, le=100)]  # of a vehicle [m]
Offset = Annotated[float, Field(ge=-100, le=100)]  # on a vehicle [m]
Number = Annotated[float, Field(allow_inf_nan=False)]
Lag = Annotated[float, Field(ge=0, allow_inf_nan=False)]  # [s]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]

NEEDS = frozenset({"route", "signals"})  # what a law may declare beside scan and own motion

START_GAPS = {DifferentialDrive: 0.5, Car: 2.5}  # [m]; SUMO's cars stand 2.5 m apart (minGap)

USUAL_STEP = 0.1  # [s] of cars that scan ten times a second

TEXTS = frozenset({"edge", "to", "id", "name", "title", "net", "config"})  # which may look like numbers

# A UTM-30LX is 60 mm deep: with its face flush with the front bumper, its centre is 30 mm behind.
LASER_BEHIND_BUMPER = 0.03


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Named(Table):
    """A table for which a name may stand."""

    short: ClassVar[str]  # the key that this name is

    @model_validator(mode="before")
    @classmethod
    def by_name(cls, value: Any) -> Any:
        return {cls.short: value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"type": "string"}, handler(schema)]}


class Sumo(Table):
    net: Annotated[str, Field(min_length=1)] | None = None  # name of a shipped network, or a .net.xml file
    config: Annotated[str, Field(min_length=1)] | None = None  # or a .sumocfg, which names network, routes and the rest
    routes: list[str] = []  # route files of background traffic
    additional: list[str] = []  # for SUMO; <poly>s in them are walls, obstacles and buildings
    traffic: bool = True  # a shipped network brings its own routes and bus stops; its <poly>s come always
    demand: Annotated[float, Field(gt=0, le=100)] | None = None  # so many times the vehicles of the route files
    warm_up_s: Annotated[float, Field(ge=0, le=86_400)] = 0.0  # SUMO's traffic alone, before the platoons stand there
    # That SUMO's drivers take to change lanes; default: what a config says, 3 s where SUMO drives a leader, or else 0.
    lane_change_s: Annotated[float, Field(ge=0, le=60)] | None = None

    @model_validator(mode="after")
    def one_of_both(self) -> Sumo:
        if (self.net is None) == (self.config is None):
            raise ValueError("must have a net or a config, one of both")
        return self


class SceneTable(Table):
    walls: Literal["outline", "none"] = "outline"  # of the drivable area
    lidar_engine: Literal["raster", "numpy", "pymunk", "shapely"] = "raster"


REPLAY_EVERY = {"traffic": 0.5, "scans": 0.25}  # so often a replay has them [s], ...
REPLAY_RANGES = 10e6  # ... but scans less often, where there would be more ranges than this


class Run(Table):
    step_s: Length = 0.025
    duration_s: Length
    laps: Length | None = None  # ends the run as soon as every member has turned through so many full circles

    @field_validator("step_s")
    @classmethod
    def whole_milliseconds(cls, step: float) -> float:
        if abs(step * 1000 - round(step * 1000)) > 1e-9:
            raise ValueError("must be whole milliseconds, as SUMO counts")
        return step


class Record(Table):
    every_s: Length = 0.1
    traffic_every_s: Length | None = None  # SUMO's own vehicles, in traffic.csv; default: not at all
    scans_every_s: Length | None = None  # what the lasers measured, in scans.npz; default: not at all
    sumo: list[Literal["trips", "summary", "edges"]] = []  # tables of SUMO's own, sumo_trips.csv and so on
    sumo_every_s: Length = 60.0  # of summary a row, of edges the intervals
    metrics: list[str] = []  # further metrics of the scenario's own, `module:Class`

    @field_validator("sumo", "metrics", mode="before")
    @classmethod
    def listed(cls, names: Any) -> Any:
        return names.split(",") if isinstance(names, str) else names


class Vehicle(Named):
    """A vehicle by name, and what is different of it: fields of its class in `vehicle` or `bicycle`, with a unit."""

    short = "type"

    type: str = "paper-robot"
    length_m: Size | None = None
    width_m: Size | None = None
    axle_m: Offset | None = None
    lag_s: Lag | None = None
    # of robots
    wheel_separation_m: Size | None = None
    wheel_radius_m: Length | None = None
    max_wheel_speed_radps: Length | None = None
    # of cars
    wheelbase_m: Size | None = None
    max_steering_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    max_steering_rate_degps: Length | None = None
    steering_lag_s: Lag | None = None
    max_acceleration_mps2: Length | None = None
    power_wpkg: Length | None = None
    max_speed_mps: Length | None = None
    max_braking_mps2: Length | None = None
    max_jerk_mps3: Length | None = None
    brake_lag_s: Lag | None = None
    response_s: Length | None = None

    @field_validator("type")
    @classmethod
    def known(cls, name: str) -> str:
        return _one_of(name, VEHICLES)

    @model_validator(mode="after")
    def keys_of_its_class(self) -> Vehicle:
        keys = {
            name: [key for key in type(self).model_fields if hasattr(model, key.rsplit("_", 1)[0])]
            for name, model in VEHICLES.items()
        }
        faults = []
        for key, value in self._given():
            if key not in keys[self.type]:
                others = ", ".join(name for name in keys if key in keys[name])
                what = f"a key of {others}, not of {self.type}{did_you_mean(key, keys[self.type])}"
                faults.append(InitErrorDetails(type=PydanticCustomError("class", what), loc=(key,), input=value))
        if faults:
            raise ValidationError.from_exception_data("Vehicle", faults)
        return self

    def model(self) -> VehicleModel:
        changes = {}
        for key, value in self._given():
            field, unit = key.rsplit("_", 1)
            changes[field] = math.radians(value) if unit in ("deg", "degps") else value
        return replace(VEHICLES[self.type], **changes)

    def _given(self) -> list[tuple[str, float]]:
        return [(key, value) for key, value in self if key != "type" and value is not None]


Share = Annotated[float, Field(ge=0, le=1)]
Error = Annotated[float, Field(ge=0, le=100)]


class NoiseTable(Named):
    """A scanner's errors; what is not given is as in the preset, by default that of the lidar."""

    short = "preset"

    preset: str | None = None  # "none", or a lidar preset, whose errors are meant
    sigma_m: Error | None = None
    sigma_m_per_m: Error | None = None
    bias_m: Error | None = None
    resolution_m: Error | None = None
    dropout: Share | None = None
    dropout_at_range_max: Share | None = None
    dropout_grazing: Share | None = None
    grazing_from_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    dropped: Literal["error", "no_return"] | None = None

    @field_validator("preset")
    @classmethod
    def known(cls, name: str | None) -> str | None:
        return name and _one_of(name, ["none", *PRESETS])

    def model(self, default: Noise) -> Noise:
        base = Noise() if self.preset == "none" else PRESETS[self.preset].noise if self.preset else default
        given = {
            "sigma": self.sigma_m,
            "sigma_per_metre": self.sigma_m_per_m,
            "bias": self.bias_m,
            "resolution": self.resolution_m,
            "dropout": self.dropout,
            "dropout_at_range_max": self.dropout_at_range_max,
            "dropout_grazing": self.dropout_grazing,
            "grazing_from": None if self.grazing_from_deg is None else math.radians(self.grazing_from_deg),
            "dropped": self.dropped,
        }
        return replace(base, **{name: value for name, value in given.items() if value is not None})


class Lidar(Named):
    short = "preset"

    preset: str | None = None  # default: the paper's, for a leader or a follower
    fov_deg: Annotated[float, Field(gt=0, le=360)] | None = None
    samples: Annotated[int, Field(ge=5, le=100_000)] | None = None  # Algorithm 1 has five sectors
    range_min_m: Annotated[float, Field(ge=0, le=10_000)] | None = None
    range_max_m: Annotated[float, Field(gt=0, le=10_000)] | None = None
    rate_hz: Length | None = None
    mount_x_m: Offset | None = None  # ahead of the vehicle's centre; default 0.03 m behind the front bumper
    mount_y_m: Offset = 0.0
    mount_yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    noise: NoiseTable | None = None
    divergence_deg: Annotated[float, Field(ge=0, le=5)] | None = None
    subbeams: Annotated[int, Field(ge=1, le=64)] | None = None
    merging_m: Annotated[float, Field(ge=0, le=100)] | None = None
    sweeps: Annotated[int, Field(ge=1)] | None = None

    @field_validator("preset")
    @classmethod
    def known(cls, name: str | None) -> str | None:
        return name and _one_of(name, PRESETS)

    def model(self, default_preset: str, vehicle_length: float) -> LidarModel:
        base = PRESETS[self.preset or default_preset]
        half = math.radians(self.fov_deg) / 2 if self.fov_deg is not None else None
        mount_x = vehicle_length / 2 - LASER_BEHIND_BUMPER if self.mount_x_m is None else self.mount_x_m
        return LidarModel(
            samples=_or(self.samples, base.samples),
            angle_min=base.angle_min if half is None else -half,
            angle_max=base.angle_max if half is None else half,
            range_min=_or(self.range_min_m, base.range_min),
            range_max=_or(self.range_max_m, base.range_max),
            rate=_or(self.rate_hz, base.rate),
            mount=Mount(mount_x, self.mount_y_m, math.radians(self.mount_yaw_deg)),
            noise=self.noise.model(base.noise) if self.noise else base.noise,
            divergence=base.divergence if self.divergence_deg is None else math.radians(self.divergence_deg),
            subbeams=_or(self.subbeams, base.subbeams),
            merging=_or(self.merging_m, base.merging),
            sweeps=_or(self.sweeps, base.sweeps),
        )


class OdometryTable(Named):
    """Errors of a vehicle's own speed and yaw rate; what is not given is as in the preset."""

    short = "preset"

    preset: Literal["none", "car"] = "none"
    speed_scale: Share | None = None
    speed_noise_mps: Error | None = None
    yaw_rate_bias_degps: Error | None = None
    yaw_rate_noise_degps: Error | None = None

    def model(self) -> OdometryErrors:
        base = ODOMETRY[self.preset]
        return OdometryErrors(
            speed_scale=_or(self.speed_scale, base.speed_scale),
            speed_noise=_or(self.speed_noise_mps, base.speed_noise),
            yaw_rate_bias=_radians(self.yaw_rate_bias_degps, base.yaw_rate_bias),
            yaw_rate_noise=_radians(self.yaw_rate_noise_degps, base.yaw_rate_noise),
        )


class Driver(Named):
    """A law, its gains (all further keys), the lidar it looks through, and what it knows its own motion by."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)
    short = "law"

    law: str
    lidar: Lidar = Lidar()
    odometry: OdometryTable = OdometryTable()


# Keys whose value may be a name, and the key of the table that this name is.
SHORT = {
    "leader": Driver.short,
    "follower": Driver.short,
    "lidar": Lidar.short,
    "noise": NoiseTable.short,
    "odometry": OdometryTable.short,
    "vehicle": Vehicle.short,
}


class Start(Table):
    time_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0  # later ones wait until there is room
    speed_mps: Annotated[float, Field(ge=0, le=100)] = 0.0  # of all members
    edge: str
    lane: Annotated[int, Field(ge=0)] = 0
    position_m: Number  # of the leader's front bumper, from the lane's start
    lateral_m: Number = 0.0  # to the left of the lane's centre line


class Platoon(Table):
    id: Identifier = "platoon"
    size: Annotated[int, Field(ge=1, le=10_000)] = 1
    vehicle: Vehicle = Vehicle()
    start: Start
    gap_m: Length | None = None  # bumper to bumper, at the start; default: START_GAPS
    route: list[str] = []
    to: Annotated[str, Field(min_length=1)] | None = None  # instead of a route: where the fastest way leads
    loop: bool = False  # the route begins again at its end
    leader: Driver
    follower: Driver | None = None

    @field_validator("id")
    @classmethod
    def not_taken(cls, name: str) -> str:
        if name == "person":
            raise ValueError("'person': its members would be called as SUMO's pedestrians are")
        return name

    @model_validator(mode="after")
    def gap_by_vehicle(self) -> Platoon:
        gap = START_GAPS[type(self.vehicle.model())] if self.gap_m is None else self.gap_m
        return self.model_copy(update={"gap_m": gap})

    @model_validator(mode="after")
    def followers_have_a_law(self) -> Platoon:
        if self.to is not None and (self.route or self.loop):
            raise ValueError("has a route, or loops, and `to`; must have one or the other")
        if self.size > 1 and self.follower is None:
            raise ValueError("a platoon of more than one needs a [platoon.follower]")
        return self


class Manoeuvre(Table):
    """What a member is told at a time."""

    kind: Literal["split", "join", "leave"]
    vehicle: str
    time_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    behind: str | None = None  # whom it joins
    route: list[str] = []  # of who leaves, from the edge on where its platoon starts; or ...
    to: Annotated[str, Field(min_length=1)] | None = None  # ... where the fastest way from there leads

    @model_validator(mode="after")
    def sound(self) -> Manoeuvre:
        if (self.kind == "join") != (self.behind is not None):
            raise ValueError("`behind` must be given to join, and only then")
        if (self.kind == "leave") != bool(self.route or self.to) or (self.route and self.to):
            raise ValueError("a route or `to`, one of both, must be given to leave, and only then")
        return self


class Breakdown(Table):
    """What fails of a member, and when."""

    vehicle: str
    what: Literal["drive", "laser"]
    time_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    lasts_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None  # default: to the end
    rate_mps2: Annotated[float, Field(gt=0, le=10)] = 2.0  # without its drive it rolls to a stand so

    def begins_before_end_of(self, other: Breakdown) -> bool:
        return other.lasts_s is None or self.time_s <= other.time_s + other.lasts_s


class Spec(Table):
    """A scenario file."""

    name: Identifier = "scenario"
    title: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    sumo: Sumo
    scene: SceneTable = SceneTable()
    run: Run
    record: Record = Record()
    platoon: Annotated[list[Platoon], Field(min_length=1)]
    obstacle: list[obstacle_tables.Obstacle] = []
    manoeuvre: list[Manoeuvre] = []
    breakdown: list[Breakdown] = []


class Change(NamedTuple):
    """A key that is not as in the file, and where that was said."""

    key: str  # a key of `platoon` without a number is set in every platoon
    value: Any
    place: str  # `argument 2`, or `file:line`
    text: str  # as it was written

    @classmethod
    def parse(cls, argument: str, number: int) -> Change:
        """Of `key=value`. raises: InputError"""
        key, equals, text = argument.partition("=")
        if not equals or not all(key.split(".")):
            raise InputError(f"argument {number}: {argument!r}: must be key=value")
        try:
            value = tomllib.loads(f"value = {text}")["value"] if "\n" not in text else text
        except tomllib.TOMLDecodeError:
            value = text  # a bare word is a string
        if key.rpartition(".")[2] in TEXTS and not isinstance(value, str):
            value = text  # SUMO's edges may have numbers for names
        return cls(key, value, f"argument {number}", argument)

    def fault(self, what: str) -> InputError:
        return InputError(f"{self.place}: {self.text!r}: {what}")


@dataclass(frozen=True)
class Scenario:
    """A checked scenario: what the file and the arguments say, and everything they name."""

    spec: Spec
    source: Path
    net: Path
    route_files: tuple[Path, ...]
    additional: tuple[Path, ...]
    configuration: Configuration | None
    laws: dict[tuple[int, str], Any]  # (platoon's number, "leader" or "follower") -> law
    plug_ins: dict[tuple[int, str], Path]  # files beside the scenario that laws are named by
    sources: tuple[Path, ...]  # of all laws that are not shipped
    metrics: MetricPlugIns
    varied: dict[str, Any]  # what the arguments changed
    place: Callable[[tuple], str]  # where a key stands: `file:line`, or the argument that set it

    def fault(self, path: tuple, what: str) -> str:
        """`file:line: key: what`."""
        return f"{self.place(path)}: {dotted(path)}: {what}"

    @property
    def seed(self) -> int:
        return self.spec.seed

    def files(self) -> dict[str, Path]:
        """Every input file, by a name that says what it is for."""
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

    def remarks(self) -> list[str]:
        """What a user of the SUMO configuration might expect, and is not so."""
        config, step = self.configuration, self.spec.run.step_s
        if config is None:
            return []
        remarks = []
        if ignored := [option for option in config.ignored if option != "step-length"]:
            remarks.append(f"{config.path}: options that are not used: {', '.join(ignored)}")
        if config.step is not None:
            used = "is run.step_s" if config.step == step else f"is not used; run.step_s = {step:g}"
            remarks.append(f"{config.path}: step-length = {config.step:g} {used}")
        return remarks

    def for_replay(self) -> Scenario:
        """With all that a replay shows recorded, where nothing is said of how often.

        Scans are by far the most of it: of large platoons they are recorded less often.
        """
        run, record = self.spec.run, self.spec.record
        beams = sum(
            driver.lidar.model(default_preset(role, self.laws[i, role]), platoon.vehicle.model().length).samples * n
            for i, platoon in enumerate(self.spec.platoon)
            for role, driver, n in (("leader", platoon.leader, 1), ("follower", platoon.follower, platoon.size - 1))
        )
        traffic, scans = (math.ceil(every / run.step_s - 1e-9) * run.step_s for every in REPLAY_EVERY.values())
        scans *= math.ceil(run.duration_s * beams / (scans * REPLAY_RANGES))
        given = {"traffic_every_s": record.traffic_every_s or round(traffic, 3)}
        given["scans_every_s"] = record.scans_every_s or round(scans, 3)
        return replace(self, spec=self.spec.model_copy(update={"record": record.model_copy(update=given)}))

    def resolved(self, folder: Path | None = None) -> dict[str, Any]:
        """All keys with their values, as for TOML. Files are named relative to `folder`; without one, not at all."""
        table = self.spec.model_dump(exclude_none=True)

        def named(file: Path) -> str:
            return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix() if folder else ""

        if self.configuration:
            table["sumo"]["config"] = named(self.configuration.path)
        elif self.spec.sumo.net not in shipped.networks():
            table["sumo"]["net"] = named(self.net)
        for key in ("obstacle", "manoeuvre", "breakdown"):
            if not table[key]:
                del table[key]
        given = {"routes": self.route_files, "additional": self.additional}
        for key, files in given.items():  # beside those that the network or the configuration brings
            n = len(getattr(self.spec.sumo, key))
            table["sumo"][key] = [named(file) for file in files[len(files) - n :]]
        table["record"]["metrics"] = self.metrics.names(named)
        for (i, role), law in self.laws.items():
            driver = table["platoon"][i][role]
            keys = {alias: getattr(law, name) for name, alias in keys_of(type(law)).items()}
            driver.clear()
            given = {key: named(v) if isinstance(v, Path) else v for key, v in keys.items() if v is not None}
            driver |= {"law": getattr(self.spec.platoon[i], role).law, **given}
            lidar = getattr(self.spec.platoon[i], role).lidar.model_dump(exclude_none=True)
            driver["lidar"] = {"preset": default_preset(role, law)} | lidar
            driver["odometry"] = getattr(self.spec.platoon[i], role).odometry.model_dump(exclude_none=True)
            if file := self.plug_ins.get((i, role)):
                driver["law"] = f"{named(file)}:{driver['law'].rsplit(':', 1)[1]}"
        return table


def default_preset(role: str, law: Any) -> str:
    """The lidar of a driver that names none: that of its law, or else the paper's."""
    return getattr(law, "lidar", f"paper-{role}")


def load(
    name_or_file: str | Path,
    arguments: Sequence[str | Change] = (),
    seed: int | None = None,
    platoons: str | Path | None = None,
) -> Scenario:
    """The scenario of a file, or a shipped one by name, changed by `key=value` arguments.

    A SUMO configuration is a scenario too, with platoons from the file `platoons`, or from arguments alone.

    raises: InputError with one line for every fault found
    """
    changes = [a if isinstance(a, Change) else Change.parse(a, number) for number, a in enumerate(arguments, start=1)]
    source = _find(name_or_file)
    config = read_configuration(source) if _is_xml(source) else None
    if config is None and platoons is not None:
        raise InputError(f"--platoon: goes with a SUMO configuration (.sumocfg, .netecfg); {source} is a scenario")
    table, lines = ({}, {}) if config and platoons is None else read_toml(platoons or source)
    if config:
        table.setdefault("name", _name(source))
        _complete(table, config, changes)
        source = Path(platoons or source)
    places: dict[tuple, str] = {}
    varied = {}
    for change in changes:
        varied[change.key] = change.value
        places |= dict.fromkeys(_set(table, change), change.place)
    table.setdefault("name", _name(source))
    if config:
        _take_duration(table, config)
    if seed is not None:
        table["seed"] = seed
        places["seed",] = "--seed"

    def place(path: tuple) -> str:
        for n in range(len(path), 0, -1):
            if path[:n] in places:
                return places[path[:n]]
        line = toml_lines.line_of(lines, path)
        return f"{source}:{line}" if line else str(source)

    try:
        spec = Spec.model_validate(table)
    except ValidationError as error:
        faults = error.errors()
        raise InputError(*(f"{place(fault_path(f))}: {fault_of(f, Spec)}" for f in faults)) from None
    return _resolve(spec, source, varied, place)


def read_toml(file: str | Path) -> tuple[dict[str, Any], dict]:
    """A TOML file, and the lines on which its keys stand. raises: InputError"""
    try:
        text = Path(file).read_text(encoding="utf-8-sig")
        return tomllib.loads(text), toml_lines.key_lines(text)
    except tomllib.TOMLDecodeError as error:
        at = re.search(r"\(at line (\d+)", str(error))  # or at the end of the document
        line = at[1] if at else text.count("\n") + 1
        raise InputError(f"{file}:{line}: not valid TOML: {str(error).split(' (at')[0]}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _name(file: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_-]", "_", file.stem)


def _is_xml(file: Path) -> bool:
    if file.suffix in (".sumocfg", ".netecfg"):
        return True
    try:
        with file.open("rb") as opened:
            return opened.read(100).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<")
    except OSError:  # said when it is read
        return False


def _complete(table: dict[str, Any], config: Configuration, changes: Sequence[Change]) -> None:
    """Make a scenario of platoons, or of nothing, and a SUMO configuration, by defaults for cars among traffic."""
    if not all(isinstance(table.setdefault(key, {}), dict) for key in ("sumo", "scene", "run")):
        return  # which is said later
    sumo = table["sumo"]
    if taken := [key for key in ("net", "config", "traffic") if key in sumo]:
        raise InputError(f"--platoon: sumo.{taken[0]}: is the configuration's, {config.path}; must not be given")
    sumo["config"] = os.path.abspath(config.path) if "platoon" in table else config.path.name
    table["scene"].setdefault("walls", "none")
    table["run"].setdefault("step_s", _step(config))
    if "platoon" not in table:
        if not any(change.key.startswith("platoon.") for change in changes):
            raise InputError(f"{config.path}: no platoon is given; complete would be, for example: {_example(config)}")
        table["platoon"] = [{}]
    # One truth for the gains of cars: those that are tested.
    follower = tomllib.loads(shipped.scenarios()["ring_platoon"].read_text(encoding="utf-8"))["platoon"][0]["follower"]
    usual = {"vehicle": "car", "leader": "sumo", "follower": follower}
    if isinstance(table["platoon"], list):
        table["platoon"] = [copy.deepcopy(usual) | p if isinstance(p, dict) else p for p in table["platoon"]]


def _step(config: Configuration) -> float:
    """The configuration's own step where a scan of 10 Hz takes whole ones."""
    fits = config.step is not None and config.step > 0 and _whole(USUAL_STEP / config.step)
    return config.step if fits else USUAL_STEP


def _take_duration(table: dict[str, Any], config: Configuration) -> None:
    run, sumo = table["run"], table["sumo"]
    if not (isinstance(run, dict) and isinstance(sumo, dict)) or "duration_s" in run:
        return
    if config.end is None:
        raise InputError(f"{config.path}: names no <end>; say how long the run takes, for example run.duration_s=600")
    warm_up = sumo.get("warm_up_s", 0.0)
    run["duration_s"] = round(config.end - config.begin - (warm_up if isinstance(warm_up, int | float) else 0), 3)


def _example(config: Configuration) -> str:
    lane, position, to = Network.read(config.net).sample_way()
    edge, _, index = lane.rpartition("_")
    words = ["platoontraffic", "run", str(config.path), *([] if config.end else ["run.duration_s=600"])]
    words += [f"platoon.start.edge={edge}", *([f"platoon.start.lane={index}"] if index != "0" else [])]
    size = 5 if position >= 40 else 1
    words += [f"platoon.start.position_m={position:g}", f"platoon.to={to}", f"platoon.size={size}"]
    return shlex.join(words)


def _resolve(spec: Spec, source: Path, varied: dict, place: Callable[[tuple], str]) -> Scenario:
    faults: list[str] = []
    folder = source.parent

    def fault(path: tuple, what: str) -> None:
        faults.append(f"{place(path)}: {dotted(path)}: {what}")

    nets = shipped.networks()
    config = None
    if spec.sumo.config is not None:
        try:
            config = read_configuration(folder / spec.sumo.config)
        except InputError as error:
            raise InputError(*(f"{place(('sumo', 'config'))}: sumo.config: {one}" for one in error.faults)) from error
    net = config.net if config else nets.get(spec.sumo.net, folder / spec.sumo.net)
    found: dict[str, Law] = {}  # one class a name, so that members may share a call
    sources: set[Path] = set()
    if not net.is_file():
        what = "no such file, nor a shipped network"
        fault(("sumo", "net"), f"{spec.sumo.net!r}: {what}{did_you_mean(spec.sumo.net, nets)}")
    if config:
        routes, additional = list(config.routes), list(config.additional)
    else:
        routes, additional = _brought(spec.sumo) if spec.sumo.net in nets else ([], [])
    for key, files in (("routes", routes), ("additional", additional)):
        for i, name in enumerate(getattr(spec.sumo, key)):
            files.append(folder / name)
            if not (folder / name).is_file():
                fault(("sumo", key, i), f"{name!r}: no such file")
            elif "," in str(files[-1]):  # SUMO would take it for two
                fault(("sumo", key, i), f"{name!r}: has a comma in its path; must have none")

    if not _whole(spec.run.duration_s / spec.run.step_s):
        fault(("run", "duration_s"), f"{spec.run.duration_s}: must be a multiple of run.step_s = {spec.run.step_s}")
    if spec.sumo.warm_up_s and not _whole(spec.sumo.warm_up_s / spec.run.step_s):
        fault(("sumo", "warm_up_s"), f"{spec.sumo.warm_up_s}: must be a multiple of run.step_s = {spec.run.step_s}")
    for key in ("every_s", "traffic_every_s", "scans_every_s"):
        every = getattr(spec.record, key)
        if every and not _whole(every / spec.run.step_s):
            fault(("record", key), f"{every}: must be a multiple of run.step_s = {spec.run.step_s}")
    for i, platoon in enumerate(spec.platoon):
        if (time := platoon.start.time_s) and not _whole(time / spec.run.step_s):
            fault(("platoon", i, "start", "time_s"), f"{time}: must be a multiple of run.step_s = {spec.run.step_s}")
        if platoon.start.time_s >= spec.run.duration_s:
            fault(("platoon", i, "start", "time_s"), f"{time}: must be before the end, {spec.run.duration_s}")
    ids = [p.id for p in spec.platoon]
    for i, name in enumerate(ids):
        if name in ids[:i]:
            fault(("platoon", i, "id"), f"{name!r}: platoon.{ids.index(name)} has this id too")
    members = {f"{p.id}.{place}": i for i, p in enumerate(spec.platoon) for place in range(p.size)}
    obstacle_tables.check(spec.obstacle, {p.id: p.size for p in spec.platoon}, spec.run.duration_s, fault)
    obstacles = {obstacle_tables.name_of(spec.obstacle, i): i for i in range(len(spec.obstacle))}
    for file in filter(Path.is_file, [*routes, *additional]):
        try:
            clashes = id_clashes(file, members | obstacles)
        except InputError as error:
            faults += error.faults
            continue
        for name, clash in clashes:
            if name in obstacles:
                clash = clash.replace("the id of a member", "the id of this obstacle")
                fault(("obstacle", obstacles[name], "id"), f"{name!r}: {clash}; must be another")
        clashes = [clash for clash in clashes if clash[0] in members]
        for i, clash in {members[name]: what for name, what in reversed(clashes)}.items():  # one a platoon
            fault(("platoon", i, "id"), f"{ids[i]!r}: {clash}; must be another")

    laws, plug_ins = {}, {}
    for i, platoon in enumerate(spec.platoon):
        for role in ("leader", "follower"):
            driver: Driver | None = getattr(platoon, role)
            if driver is None:
                continue
            at = ("platoon", i, role)
            try:
                law = found[driver.law] = found.get(driver.law) or find_law(driver.law, folder)
                kind = law.kind
                sources |= set(law.sources)
                gains = with_files(kind, driver.model_extra or {}, folder)
                laws[i, role] = law_of(kind, gains, lambda key, what, at=at: fault((*at, key), what), _without_key)
                sources |= {value for value in gains.values() if isinstance(value, Path)}
            except LookupError as error:
                fault((*at, "law"), str(error))
                continue
            if file := plug_in_file(driver.law, folder):
                plug_ins[i, role] = file
            needs = frozenset(getattr(laws[i, role], "needs", ()))
            if unknown := sorted(needs - NEEDS):
                fault((*at, "law"), f"{driver.law!r} needs {', '.join(unknown)}; there is: {', '.join(sorted(NEEDS))}")
            if needs & {"route", "signals"} and not platoon.route and not platoon.to:
                ways = f"platoon.{i}.route, the edges to drive, or platoon.{i}.to, the last of them"
                fault((*at, "law"), f"{driver.law!r} needs {ways}")
            if getattr(kind, "native", False):  # SUMO drives, without a laser
                if role == "follower":
                    fault((*at, "law"), f"{driver.law!r} follows nobody; must be a law that drives by its scan")
                continue
            try:
                lidar = driver.lidar.model(default_preset(role, kind), platoon.vehicle.model().length)
            except ValueError as error:
                fault((*at, "lidar"), str(error))
                continue
            if not _whole(1 / (lidar.rate * spec.run.step_s)):
                step = spec.run.step_s
                what = f"{lidar.rate:g}: a scan must take whole steps of run.step_s = {step}, as at {1 / step:g} Hz"
                fault((*at, "lidar", "rate_hz"), what)
    for table, i, one in (
        *(("manoeuvre", i, one) for i, one in enumerate(spec.manoeuvre)),
        *(("breakdown", i, one) for i, one in enumerate(spec.breakdown)),
    ):
        if one.vehicle not in members:
            fault((table, i, "vehicle"), f"{one.vehicle!r}: no member{did_you_mean(one.vehicle, members)}")
        if one.time_s >= spec.run.duration_s:
            fault((table, i, "time_s"), f"{one.time_s:g}: must be before the end, {spec.run.duration_s:g}")
        departs = spec.platoon[members[one.vehicle]].start.time_s if one.vehicle in members else 0.0
        if one.time_s < departs:
            fault((table, i, "time_s"), f"{one.time_s:g}: {one.vehicle} departs at {departs:g}; must not be earlier")
    for i, one in enumerate(spec.breakdown):
        law = laws.get((members.get(one.vehicle, -1), "leader" if one.vehicle.endswith(".0") else "follower"))
        if one.what == "laser" and getattr(law, "native", False):
            fault(("breakdown", i, "what"), f"'laser': {one.vehicle} has none, SUMO drives it; must be 'drive'")
        if one.lasts_s is not None and one.lasts_s < spec.run.step_s:
            fault(("breakdown", i, "lasts_s"), f"{one.lasts_s:g}: must be a step or more, {spec.run.step_s:g}")
        for k, other in enumerate(spec.breakdown[:i]):
            same = (one.vehicle, one.what) == (other.vehicle, other.what)
            if same and one.begins_before_end_of(other) and other.begins_before_end_of(one):
                until = "to the end" if other.lasts_s is None else f"until {other.time_s + other.lasts_s:g}"
                fault(
                    ("breakdown", i, "time_s"), f"{one.time_s:g}: that {one.what} is broken {until}, by breakdown.{k}"
                )
    for i, told in enumerate(spec.manoeuvre):
        at = ("manoeuvre", i)
        if told.behind is not None and told.behind not in members:
            fault((*at, "behind"), f"{told.behind!r}: no member{did_you_mean(told.behind, members)}")
        if told.behind == told.vehicle:
            fault((*at, "behind"), f"{told.vehicle!r}: cannot follow itself; must be another member")
        if told.vehicle in members:
            role = "leader" if told.vehicle.endswith(".0") else "follower"
            if told.kind == "split" and role == "leader":
                fault((*at, "vehicle"), f"{told.vehicle!r}: leads already; must be a follower")
                continue
            law = laws.get((members[told.vehicle], role))
            if law is not None and getattr(law, "on_loss", "") != "drive":
                which = f"platoon.{members[told.vehicle]}.{role}"
                fault(
                    (*at, "vehicle"), f"{told.vehicle!r}: {which} cannot drive alone; must be tracking, on_loss drive"
                )
    metrics = metric_plug_ins.find(spec.record.metrics, folder, lambda i, what: fault(("record", "metrics", i), what))
    if faults:
        raise InputError(*faults)
    files = (net, tuple(routes), tuple(additional), config)
    return Scenario(spec, source, *files, laws, plug_ins, tuple(sorted(sources)), metrics, varied, place)


def _brought(sumo: Sumo) -> tuple[list[Path], list[Path]]:
    """Route files and additional files of a shipped network."""
    folder = shipped.networks()[sumo.net].parent
    kinds = ("poly", "add") if sumo.traffic else ("poly",)
    routes = [folder / f"{sumo.net}.rou.xml"] if sumo.traffic else []
    additional = [folder / f"{sumo.net}.{kind}.xml" for kind in kinds]
    return [file for file in routes if file.is_file()], [file for file in additional if file.is_file()]


def _find(name_or_file: str | Path) -> Path:
    known = shipped.scenarios()
    if str(name_or_file) in known:
        return known[str(name_or_file)]
    file = Path(name_or_file)
    if file.is_file():
        return file
    if (file / "config.toml").is_file():
        raise InputError(f"{file}: is the folder of a run; its scenario is {file / 'config.toml'}")
    if file.is_dir():
        raise InputError(f"{file}: is a folder; must be a scenario file, or one of: {', '.join(known)}")
    hint = did_you_mean(str(name_or_file), known)
    raise InputError(f"{name_or_file}: no such scenario file, nor a shipped scenario{hint}")


def _set(table: dict, change: Change) -> list[tuple]:
    """Make a change in the table; returns the paths that were set."""
    names = change.key.split(".")
    targets: list[tuple[Any, tuple]] = [(table, ())]
    for name in names[:-1]:
        targets = [step for node, path in targets for step in _into(node, path, name, change)]
    paths = []
    for node, path in [step for target in targets for step in _last(*target)]:
        if not isinstance(node, dict):
            raise change.fault(f"{dotted(path)} is not a table")
        node[names[-1]] = copy.deepcopy(change.value)
        paths.append((*path, names[-1]))
    return paths


def _into(node: Any, path: tuple, name: str, change: Change) -> list[tuple[Any, tuple]]:
    if isinstance(node, list):
        if name.lstrip("-").isdigit() and not name.isdigit():
            raise change.fault("they are numbered from 0")
        if not name.isdigit():
            return [s for i, item in enumerate(node) for s in _into(item, (*path, i), name, change)]
        if int(name) >= len(node):
            raise change.fault(f"there are {len(node)}, numbered from 0")
        return [(node[int(name)], (*path, int(name)))]
    if not isinstance(node, dict):
        raise change.fault(f"{dotted(path)} is not a table")
    if isinstance(node.get(name), str) and name in SHORT:
        node[name] = {SHORT[name]: node[name]}
    return [(node.setdefault(name, {}), (*path, name))]


def _last(node: Any, path: tuple) -> list[tuple[Any, tuple]]:
    return [(item, (*path, i)) for i, item in enumerate(node)] if isinstance(node, list) else [(node, path)]


def fault_of(error: dict, model: type[BaseModel]) -> str:
    """pydantic's error as `key: what; what is allowed`."""
    path = error["loc"]
    if path[:1] == ("obstacle",):
        path, kind, what = obstacle_tables.located(error)
        if what:
            return f"{dotted(path)}: {what}"
        if kind and error["type"] == "extra_forbidden":
            return f"{dotted(path)}: unknown key{did_you_mean(str(path[-1]), _known_keys(kind, path[2:-1]))}"
    if error["type"] == "extra_forbidden":
        return f"{dotted(path)}: unknown key{did_you_mean(str(path[-1]), _known_keys(model, path[:-1]))}"
    if error["type"] == "missing":
        return f"{dotted(path)}: missing"
    what = error["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if error["type"] == "model_type":
        what = "should be a table, or a name" if path[-1] in SHORT else "should be a table"
    value = error["input"]
    shown = "" if isinstance(value, dict | BaseModel) else f"{value!r}: "
    return f"{dotted(path)}: {shown}{what}"


def _without_key(error: dict, model: type[BaseModel]) -> str:
    return fault_of(error, model).split(": ", 1)[-1]


def fault_path(error: dict) -> tuple:
    """Of pydantic's error: the path of the key in the file."""
    path = error["loc"]
    return obstacle_tables.located(error)[0] if path[:1] == ("obstacle",) else path


def _known_keys(model: type[BaseModel], path: tuple) -> list[str]:
    for name in path:
        if isinstance(name, int):
            continue
        inner = model.model_fields[name].annotation
        while typing.get_args(inner):
            inner = typing.get_args(inner)[0]
        model = inner
    return [field.alias or name for name, field in model.model_fields.items()]


def _one_of(name: str, known: dict[str, Any]) -> str:
    if name not in known:
        raise ValueError(f"not known{did_you_mean(name, known)}")
    return name


def _radians(degrees: float | None, default: float) -> float:
    return default if degrees is None else math.radians(degrees)


def _or(value: Any, default: Any) -> Any:
    return default if value is None else value


def _whole(ratio: float) -> bool:
    return ratio > 0.5 and abs(ratio - round(ratio)) < 1e-6


def dotted(path: tuple) -> str:
    return ".".join(map(str, path))
