"""Tables of a platoon's vehicles: `vehicle`, `lidar` with its `noise`, and `odometry`.

Keys carry their unit. `model` converts a table into the record that the simulation uses, in SI and radians.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from platoontraffic.errors import did_you_mean
from platoontraffic.lidar import PRESETS, LidarModel, Mount, Noise
from platoontraffic.lidar.noise import DEFAULT_NAME
from platoontraffic.scenario.base import MOST, Angle, Fraction, Named, Positive, Size, one_of
from platoontraffic.scenario.defaults import VEHICLE
from platoontraffic.vehicles.bicycle import Car
from platoontraffic.vehicles.catalogue import VEHICLES, VehicleModel
from platoontraffic.vehicles.differential import DifferentialDrive
from platoontraffic.vehicles.odometry import ODOMETRY, OdometryErrors

# The points of a route are a tenth of its vehicle's length apart: those of a shorter one would fill the memory.
Footprint = Annotated[float, Field(ge=0.05, le=100)]  # length or width [m]
Offset = Annotated[float, Field(ge=-100, le=100)]  # on a vehicle [m]
Error = Annotated[float, Field(ge=0, le=100)]  # in the unit of its key
Delay = Annotated[float, Field(ge=0, le=1)]  # [s]
Lag = Annotated[float, Field(ge=0, le=60)]  # [s]

# A UTM-30LX is 60 mm deep: with its face flush with the front bumper, its centre is 30 mm behind.
LASER_BEHIND_BUMPER = 0.03  # [m]


class Vehicle(Named):
    """A vehicle by name, and how it differs from the one of that name. Keys that are not given keep its values."""

    short = "type"

    type: str = VEHICLE
    """Name of the vehicle; `platoontraffic list vehicles` prints all."""
    length_m: Footprint | None = None
    """Length of the footprint [m]. Default: that of the type."""
    width_m: Footprint | None = None
    """Width of the footprint [m]. Default: that of the type."""
    axle_m: Offset | None = None
    """Position of the driven axle (robots) or the rear axle (cars), forward of the centre [m]; negative: behind it.
    Default: that of the type."""
    lag_s: Lag | None = None
    """First-order lag [s]: of the wheel speeds (robots), of the drive's acceleration (cars); 0: none.
    Default: that of the type."""

    wheel_separation_m: Size | None = None
    """Robots: distance between the two driven wheels [m]. Default: that of the type."""
    wheel_radius_m: Positive | None = None
    """Robots: radius of the driven wheels [m]. Default: that of the type."""
    max_wheel_speed_radps: Positive | None = None
    """Robots: greatest angular speed of a wheel [rad/s]. Default: that of the type."""

    wheelbase_m: Size | None = None
    """Cars: distance between the axles [m]. Default: that of the type."""
    max_steering_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    """Cars: steering angle of the bicycle model's front wheel at full lock [deg]. Default: that of the type."""
    max_steering_rate_degps: Positive | None = None
    """Cars: greatest rate of the steering angle [deg/s]. Default: that of the type."""
    steering_lag_s: Lag | None = None
    """Cars: first-order lag of the steering [s]; 0: none. Default: that of the type."""
    max_acceleration_mps2: Positive | None = None
    """Cars: greatest acceleration at low speed [m/s2]. Default: that of the type."""
    power_wpkg: Positive | None = None
    """Cars: power at the wheels per mass [W/kg]. Default: that of the type."""
    max_speed_mps: Positive | None = None
    """Cars: speed at which drag takes all of the power [m/s]. Default: that of the type."""
    max_braking_mps2: Positive | None = None
    """Cars: greatest deceleration [m/s2]. Default: that of the type."""
    max_jerk_mps3: Annotated[float, Field(ge=0.1, le=MOST)] | None = None
    """Cars: greatest jerk of the drive and of the brakes [m/s3]. Default: that of the type."""
    brake_lag_s: Lag | None = None
    """Cars: first-order lag of the brakes [s]; 0: none. Default: that of the type."""
    grip_mps2: Annotated[float, Field(gt=0)] | None = None
    """Cars: greatest acceleration in any direction that the tyres hold [m/s2]; inf: any. Default: that of the type."""
    response_s: Annotated[float, Field(gt=0, le=60)] | None = None
    """Cars: time constant with which a commanded speed is approached [s]. Default: that of the type."""

    @field_validator("type")
    @classmethod
    def known(cls, name: str) -> str:
        return one_of(name, VEHICLES)

    @model_validator(mode="after")
    def keys_of_its_class(self) -> Vehicle:
        keys = {name: _keys_of(model) for name, model in VEHICLES.items()}
        faults = []
        for key, value in self._given():
            if key not in keys[self.type]:
                having = ", ".join(name for name in keys if key in keys[name])
                what = f"a key of {having}, not of {self.type}{did_you_mean(key, keys[self.type])}"
                faults.append(InitErrorDetails(type=PydanticCustomError("class", what), loc=(key,), input=value))
        if faults:
            raise ValidationError.from_exception_data("Vehicle", faults)
        return self

    @model_validator(mode="after")
    def wheels_under_its_body(self) -> Vehicle:
        faults = []
        for key, size, must in _outside(self.model()):
            given = getattr(self, key)
            key, value, what = (size, getattr(self, size), f"{key} {must}") if given is None else (key, given, must)
            faults.append(InitErrorDetails(type=PydanticCustomError("outside", what), loc=(key,), input=value))
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


def _keys_of(model: VehicleModel) -> list[str]:
    """Keys of `Vehicle` that a vehicle of this class has."""
    own = {field.name for field in fields(model)}
    return [key for key in Vehicle.model_fields if key.rsplit("_", 1)[0] in own]


def _outside(model: VehicleModel) -> Iterator[tuple[str, str, str]]:
    """Wheels that are not under the body: the key of their place, that of the body's size, and what is allowed."""
    half = model.length / 2
    if abs(model.axle) > half:
        yield "axle_m", "length_m", f"must be from {-half:g} to {half:g}, within the length of {model.length:g}"
    elif isinstance(model, Car) and model.axle + model.wheelbase > half:
        most = half - model.axle
        yield "wheelbase_m", "length_m", f"must be at most {most:g}, from the rear axle to the front of the vehicle"
    if isinstance(model, DifferentialDrive) and model.wheel_separation > model.width:
        yield "wheel_separation_m", "width_m", f"must be at most {model.width:g}, the width"


class NoiseTable(Named):
    """A lidar's measurement errors. Keys that are not given keep the preset's values."""

    short = "preset"

    preset: str | None = None
    """Name of the lidar preset that the errors are taken from, or "none" for an exact lidar.
    Default: the preset of the lidar itself."""
    sigma_m: Error | None = None
    """Standard deviation of the range, its constant part [m]. Default: that of the preset."""
    sigma_m_per_m: Error | None = None
    """Standard deviation of the range, the part that grows with the range [m/m]. Default: that of the preset."""
    bias_m: Error | None = None
    """Standard deviation of a range error that a lidar keeps for the whole run [m]. Default: that of the preset."""
    resolution_m: Error | None = None
    """Step of the reported range [m]; 0: none. Default: that of the preset."""
    dropout: Fraction | None = None
    """Probability that a return is lost. Default: that of the preset."""
    dropout_at_range_max: Fraction | None = None
    """Probability added at the greatest range; it falls with the square of the range. Default: that of the preset."""
    dropout_grazing: Fraction | None = None
    """Probability added where a surface is seen edge-on; it falls with the squared cosine of the incidence angle.
    Default: that of the preset."""
    grazing_from_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    """Incidence angle, from the surface's normal, below which `dropout_grazing` adds nothing [deg].
    Default: that of the preset."""
    dropped: Literal["error", "no_return"] | None = None
    """Value of a lost return: "error" (NaN) or "no_return" (+inf). Default: that of the preset."""

    @field_validator("preset")
    @classmethod
    def known(cls, name: str | None) -> str | None:
        return name and one_of(name, ["none", *PRESETS])

    def model(self, default: Noise) -> Noise:
        """The errors. default: those of the lidar, where the table names no preset"""
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
    """A laser scanner and its place on the vehicle. Keys that are not given keep the preset's values."""

    short = "preset"

    preset: str | None = None
    """Name of the lidar; `platoontraffic list lidars` prints all.
    Default: the lidar that the law declares, or else "car-leader" or "car-follower" for cars, vans and trucks,
    "paper-leader" or "paper-follower" for robots."""
    fov_deg: Annotated[float, Field(gt=0, le=360)] | None = None
    """Field of view, half of it to each side of straight ahead [deg]. Default: that of the preset."""
    samples: Annotated[int, Field(ge=5, le=100_000)] | None = None  # Algorithm 1 has five sectors
    """Number of beams in a scan. Default: that of the preset."""
    range_min_m: Annotated[float, Field(ge=0, le=10_000)] | None = None
    """Shortest range that is measured; what is nearer blocks the beam [m]. Default: that of the preset."""
    range_max_m: Annotated[float, Field(gt=0, le=10_000)] | None = None
    """Greatest range that is measured [m]. Default: that of the preset."""
    rate_hz: Positive | None = None
    """Scans per second [Hz]; the interval must be a multiple of run.step_s. Default: that of the preset."""
    mount_x_m: Offset | None = None
    """Position of the lidar, forward of the vehicle's centre [m]. Default: 0.03 m behind the front bumper; of presets
    that look all around, 0: on the roof."""
    mount_y_m: Offset = 0.0
    """Position of the lidar, to the left of the vehicle's centre line [m]."""
    mount_yaw_deg: Angle = 0.0
    """Direction of the middle beam, counter-clockwise from straight ahead [deg]."""
    noise: NoiseTable | None = None
    """Measurement errors: a table, the name of a lidar preset, or "none". Default: those of the preset."""
    divergence_deg: Annotated[float, Field(ge=0, le=5)] | None = None
    """Angle that one beam fills, sampled by `subbeams` [deg]. Default: that of the preset."""
    subbeams: Annotated[int, Field(ge=1, le=64)] | None = None
    """Number of rays that sample a beam over its divergence. Default: that of the preset."""
    merging_m: Annotated[float, Field(ge=0, le=100)] | None = None
    """Depth behind the nearest return of a beam within which the beam's returns merge into their mean, as at an
    edge [m]. Default: that of the preset."""
    sweeps: Annotated[int, Field(ge=1)] | None = None
    """Number of parts of a scan that are measured one after another; 1: all beams at one instant.
    Default: that of the preset."""
    delay_s: Delay | None = None
    """Time from the end of a scan to its use, for sensing and computing: a scan is used in the first step that begins
    this long after it was taken, or later [s]. Default: that of the preset, 0."""

    @field_validator("preset")
    @classmethod
    def known(cls, name: str | None) -> str | None:
        return name and one_of(name, PRESETS)

    def model(self, default_preset: str, vehicle_length: float, name: str = DEFAULT_NAME) -> LidarModel:
        """The scanner on a vehicle of this length [m]. raises: ValueError where keys contradict each other"""
        base = PRESETS[self.preset or default_preset]
        half = math.radians(self.fov_deg) / 2 if self.fov_deg is not None else None
        usual = 0.0 if base.angle_max >= math.pi else vehicle_length / 2 - LASER_BEHIND_BUMPER
        mount_x = _or(self.mount_x_m, usual)
        return LidarModel(
            samples=_or(self.samples, base.samples),
            angle_min=base.angle_min if half is None else -half,
            angle_max=base.angle_max if half is None else half,
            range_min=_or(self.range_min_m, base.range_min),
            range_max=_or(self.range_max_m, base.range_max),
            rate=_or(self.rate_hz, base.rate),
            mount=Mount(mount_x, self.mount_y_m, math.radians(self.mount_yaw_deg)),
            noise=self.noise.model(base.noise) if self.noise else base.noise,
            divergence=_radians_or(self.divergence_deg, base.divergence),
            subbeams=_or(self.subbeams, base.subbeams),
            merging=_or(self.merging_m, base.merging),
            sweeps=_or(self.sweeps, base.sweeps),
            name=name,
            delay=_or(self.delay_s, base.delay),
        )


class OdometryTable(Named):
    """Errors of a vehicle's measurement of its own speed and yaw rate. Keys that are not given keep the preset's
    values."""

    short = "preset"

    preset: Literal["none", "car"] = "none"
    """Name of a set of errors."""
    speed_scale: Fraction | None = None
    """Standard deviation of an error of the speed's scale that a vehicle keeps for the whole run, as a fraction of the
    speed. Default: that of the preset."""
    speed_noise_mps: Error | None = None
    """Standard deviation of the noise of each speed reading [m/s]. Default: that of the preset."""
    yaw_rate_bias_degps: Error | None = None
    """Standard deviation of an error of the yaw rate that a vehicle keeps for the whole run [deg/s].
    Default: that of the preset."""
    yaw_rate_noise_degps: Error | None = None
    """Standard deviation of the noise of each yaw rate reading [deg/s]. Default: that of the preset."""
    delay_s: Delay | None = None
    """Time from a reading to its use, as `delay_s` of a lidar [s]. Default: that of the preset, 0."""

    def model(self) -> OdometryErrors:
        base = ODOMETRY[self.preset]
        return OdometryErrors(
            speed_scale=_or(self.speed_scale, base.speed_scale),
            speed_noise=_or(self.speed_noise_mps, base.speed_noise),
            yaw_rate_bias=_radians_or(self.yaw_rate_bias_degps, base.yaw_rate_bias),
            yaw_rate_noise=_radians_or(self.yaw_rate_noise_degps, base.yaw_rate_noise),
            delay=_or(self.delay_s, base.delay),
        )


def _or(value: Any, default: Any) -> Any:
    return default if value is None else value


def _radians_or(degrees: float | None, default: float) -> float:
    return default if degrees is None else math.radians(degrees)
