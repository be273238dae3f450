"""Motion of cars, vans and trucks: a kinematic bicycle with a drive line, for many vehicles at once.

Frames and units are those of `motion`. The pose is that of the centre of the footprint; the point that the equations
move is the middle of the rear axle. For the rear axle (x, y), heading psi, speed v, acceleration a, steering angle
delta and wheelbase L:

    x' = v cos psi     y' = v sin psi     psi' = v kappa     v' = a = drive - brake
    kappa = tan(delta) / L                                 |kappa| <= grip / v^2
    drive' = (max(demand, 0) - drive) / lag                |drive'| <= max_jerk
    brake' = (max(-demand, 0) - brake) / brake_lag         |brake'| <= max_jerk
    delta' = (demanded angle - delta) / steering_lag       |delta'| <= max_steering_rate

The tyres hold no more than `grip` [Wong]: where the steering asks for more lateral acceleration the curvature driven is
grip / v^2, so that the vehicle leaves the bend outwards, and what the brakes are asked for is what the bend leaves of
the friction circle, demand^2 + (v psi')^2 <= grip^2. The brakes follow that with their lag, so that in a swerve the sum
exceeds the circle for a moment, by a third at most; the drive, of 3 m/s2 at most, is not limited by it. Within that the
wheels do not slip: see `lateral_acceleration`. Road, load and wind are not modelled: an acceleration of 0 keeps the
speed, as a car's own lower controller would.

The formulas of a demand are in `bicycle_formulas`, their integration in `bicycle_kernel`.

[Wong]     Theory of Ground Vehicles, 3rd ed. 2001, 1.3: peak friction of tyres on dry asphalt 0.8 to 0.9; 1.4: the
           friction ellipse.
[Rajamani] Vehicle Dynamics and Control, 2nd ed. 2012: 2.2 the bicycle, 5.3 the lag between demand and acceleration.
[Polack]   Polack, Altché, d'Andréa-Novel, de La Fortelle: The kinematic bicycle model: a consistent model for planning
           feasible trajectories for autonomous vehicles? IEEE Intelligent Vehicles Symposium 2017.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from operator import attrgetter
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from platoontraffic.vehicles import bicycle_formulas
from platoontraffic.vehicles.motion import Command, Drive, Motion, NotNegative, Positive, Twist, rows

VALID_LATERAL = 4.0  # greatest lateral acceleration for which the kinematic bicycle is valid [Polack] [m/s2]
SUBSTEP = 0.025  # longest step of the integration [s]; of second order: 2 mm after 8 s of hard driving

_FIELDS = attrgetter(*Motion.__dataclass_fields__)


@dataclass(frozen=True)
class Car:
    """A vehicle steered by its front wheels, with a drive line that lags behind its command.

    Each field is a float, or an array (n,) for n vehicles at once (`records.stack`). `CARS` holds ready ones. The speed
    of its motion is that of the rear axle, never negative.
    """

    length: Positive  # of the footprint rectangle [m]
    width: Positive
    axle: float  # rear axle, ahead of the centre [m]; negative: behind it
    wheelbase: Positive
    max_steering: Positive  # angle of the bicycle's front wheel at lock; see `steering_at_lock`
    max_steering_rate: Positive  # [rad/s]
    steering_lag: NotNegative  # first order [s]; 0: none
    max_acceleration: Positive  # [m/s2], at low speed
    power: Positive  # at the wheels, by mass [W/kg]
    max_speed: Positive  # [m/s], where drag takes all of the power
    max_braking: Positive  # [m/s2]
    max_jerk: Positive  # [m/s3], of drive and of brake each; one that takes over from the other changes at both rates
    lag: NotNegative  # first order, of the drive [s]; 0: none
    brake_lag: NotNegative  # same, of the brakes
    response: Positive  # to the speed of a Twist, first order [s]
    grip: Annotated[float, Field(gt=0)]  # greatest acceleration that the tyres hold, across and by braking [m/s2]

    strongest_acceleration = bicycle_formulas.strongest_acceleration
    drive_for = bicycle_formulas.drive_for
    within_limits = bicycle_formulas.within_limits

    @cached_property
    def _table(self) -> np.ndarray:
        """Its fields as records."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return _records(values, np.broadcast_shapes(*map(np.shape, values.values())))

    @property
    def top_speed(self) -> float:
        """On the level [m/s]."""
        return self.max_speed

    @property
    def turning_radius(self) -> float:
        """Turning radius of the rear axle's middle at full lock [m]."""
        return self.wheelbase / np.tan(self.max_steering)

    @property
    def curvature_rate(self) -> float:
        """Greatest rate at which the curvature of the rear axle's path changes, straight ahead [1/(m s)]."""
        return self.max_steering_rate / self.wheelbase

    @property
    def drive_lag(self) -> float:
        """First order, of the drive's acceleration [s]."""
        return self.lag

    @property
    def hardest_braking(self) -> float:
        """[m/s2]."""
        return self.max_braking

    def braking_delay(self, scan: float, braking: float) -> float:
        """T = T_scan + T_b [s]: a vehicle that is to brake by b from a speed v stops within v T + v^2 / 2 b.

        T_b is that of the brakes, the integral of the deceleration that is missing, over b. They follow the demand
        with a lag of first order T_brake, and no faster than by their jerk j: T_b = b / 2 j + j T_brake^2 / 2 b where
        the jerk limits them at first, b > j T_brake; else T_brake.
        """
        lag, jerk = self.brake_lag, self.max_jerk
        limited = braking > jerk * lag
        return scan + (braking / (2 * jerk) + jerk * lag**2 / (2 * braking) if limited else lag)

    def axle_position(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """The middle of the rear axle, the point that the curvature refers to, x and y [m]. Arrays (n,)."""
        return motion.x + self.axle * np.cos(motion.heading), motion.y + self.axle * np.sin(motion.heading)

    def saturated(self, command: Command | Drive | Twist, motion: Motion) -> Drive:
        """The demand within the limits of engine, brakes, tyres and steering lock, before any lag."""
        if isinstance(command, Command):
            by_twist, driven = self.drive_for(command.twist, motion), ~np.isnan(command.drive.acceleration)
            drive = Drive(*(np.where(driven, given, own) for given, own in zip(command.drive, by_twist, strict=True)))
        else:
            drive = self.drive_for(command, motion) if isinstance(command, Twist) else command
        return self.within_limits(drive, self.strongest_acceleration(motion.speed), lateral_acceleration(motion))

    def moved(self, motion: Motion, command: Command | Drive | Twist, dt: float) -> Motion:
        """Motion after dt [s] under one command, in equal sub-steps of at most SUBSTEP.

        Within a sub-step the demand is constant, the one at its middle; lag, jerk and steering rate are then exact, and
        the axle drives an arc. The error falls with the square of the sub-step. At constant steering the path is an
        exact circle, whatever the speed does. A car that has braked to 0 stands, with acceleration 0.

        raises: ValueError if a single twist or drive is not finite
        """
        from platoontraffic.vehicles.bicycle_kernel import MOTION, move  # here: importing numba takes half a second

        command = command if isinstance(command, Command) else Command.of(_finite(command))
        values, (twist, drive) = _FIELDS(motion), command
        shape, values = rows((*values, *twist, *drive))
        cars = self._table if self._table.shape == shape else np.broadcast_to(self._table, shape).copy()
        after, count = np.empty((9, cars.size)), max(1, math.ceil(dt / SUBSTEP - 1e-9))
        move(values[:9], cars.ravel(), values[9:], count, dt / count, np.empty(1, MOTION), after)
        return Motion(*after.reshape(9, *shape))


def lateral_acceleration(motion: Motion) -> np.ndarray:
    """v^2 times curvature, at the rear axle, to the left [m/s2]. Arrays (n,).

    The bicycle is valid up to half of what the tyres hold [Polack], `VALID_LATERAL` on a dry road.
    """
    return motion.speed * motion.yaw_rate


def steering_at_lock(turning_circle: float, wheelbase: float, width: float) -> float:
    """Steering angle of the bicycle on a vehicle's smallest circle [rad].

    turning_circle : diameter from kerb to kerb, that of the outer front wheel's path [m]
    wheelbase      : [m]
    width          : of the vehicle, taken as the distance between its outer wheels [m]
    """
    rear_radius = math.sqrt((turning_circle / 2) ** 2 - wheelbase**2) - width / 2
    return math.atan(wheelbase / rear_radius)


def _finite(command: Drive | Twist) -> Drive | Twist:
    for name, values in zip(command._fields, command, strict=True):
        if not np.isfinite(values).all():
            raise ValueError(f"{type(command).__name__} {name} = {values}; must be finite")
    return command


def _records(values: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    """Arrays or floats by name, as one array of records."""
    table = np.empty(shape, dtype=[(name, float) for name in values])
    for name, column in values.items():
        table[name] = column
    return table


CARS = {
    # The design car of road geometry: RASt 06 / FGSV "Bemessungsfahrzeuge": length, width, wheelbase, circle.
    "car": Car(
        length=4.74,
        width=1.76,
        axle=-1.27,  # rear overhang 1.10 m, same
        wheelbase=2.70,
        max_steering=steering_at_lock(11.7, 2.70, 1.76),
        max_steering_rate=0.4,  # CommonRoad vehicle models, BMW 320i; Apollo's Lincoln MKZ 0.44
        steering_lag=0.1,  # assumption; Autoware's simulator 0.27 without a bound of the rate, CommonRoad none
        max_acceleration=4.0,  # assumption: with the power below, 100 km/h in 9 s
        power=55.0,  # mean new car in the EU 2016: 95 kW, 1392 kg (ICCT pocketbook); 0.8 of it at the wheels (Plexe)
        max_speed=55.56,  # SUMO, passenger: 200 km/h
        max_braking=9.0,  # SUMO, passenger: emergencyDecel
        max_jerk=20.0,  # emergency braking, Sensors 21 (2021) 1427 table 8: 6 to 21 m/s3
        lag=0.5,  # SUMO's CC model (Plexe): tauEngine; Rajamani ch. 5
        brake_lag=0.2,  # Plexe engine parameters: brakes tau
        response=1.0,  # assumption
        grip=9.0,  # dry asphalt [Wong], and what the brakes need
    ),
    # Mercedes Sprinter, wheelbase 144 in: length, width, wheelbase.
    "van": Car(
        length=5.94,
        width=1.99,
        axle=-1.70,  # front overhang 1.0 m is an assumption: rear overhang 1.27 m
        wheelbase=3.665,
        max_steering=steering_at_lock(13.0, 3.665, 1.99),  # circle 11.2 to 14.3 m by wheelbase
        max_steering_rate=0.4,  # CommonRoad, VW Vanagon
        steering_lag=0.1,  # assumption, as the car
        max_acceleration=3.0,  # assumption
        power=25.0,  # 110 kW, laden to 3.5 t, 0.8 of it at the wheels
        max_speed=41.7,  # CommonRoad, VW Vanagon
        max_braking=9.0,  # SUMO, delivery: emergencyDecel
        max_jerk=20.0,  # as the car
        lag=0.5,
        brake_lag=0.2,
        response=1.0,  # assumption
        grip=9.0,  # as the car
    ),
    # The two-axle design truck of road geometry: AASHTO Green Book, SU (SU-30): length, width, wheelbase, circle.
    "truck": Car(
        length=9.2,
        width=2.4,
        axle=-2.8,  # rear overhang 1.8 m, same
        wheelbase=6.1,
        max_steering=steering_at_lock(25.6, 6.1, 2.4),
        max_steering_rate=0.3,  # assumption: the car's, by the greater ratio of a truck's steering
        steering_lag=0.2,  # assumption
        max_acceleration=2.0,  # assumption
        power=12.0,  # assumption: 180 kW, 12 t, 0.8 of it at the wheels
        max_speed=25.0,  # limiter, directive 92/6/EEC: 90 km/h
        max_braking=7.0,  # SUMO, truck: emergencyDecel
        max_jerk=10.0,  # assumption: air brakes, half of the car's
        lag=0.5,
        brake_lag=0.4,  # air brakes: 75 % within 0.6 s (UN R13 annex 6), so 0.6 / ln 4 at the most
        response=1.0,  # assumption
        grip=7.0,  # what the brakes need; truck tyres hold less than a car's [Wong, table 1.3]
    ),
}
