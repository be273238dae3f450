"""Tables of what drives a member: its law, its lasers, its sensors."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from platoontraffic.scenario.base import Identifier, Named, filled_in
from platoontraffic.scenario.vehicle_tables import Lidar, NoiseTable, OdometryTable, Vehicle


class SensorTable(Named):
    """A sensor of a plug-in."""

    model_config = ConfigDict(extra="allow")
    short = "sensor"

    sensor: str
    """Name of an installed sensor, or module:Class from a file beside the scenario.
    All further keys are parameters of the sensor."""


class Driver(Named):
    """The law that drives a leader or the followers, its gains as further keys, and the sensors that it gets."""

    model_config = filled_in("law") | ConfigDict(extra="allow")
    short = "law"

    law: str
    """Name of a law (`platoontraffic list laws` prints all), or module:Class from a file beside the scenario.
    All keys besides `law`, `lidar`, `lidars`, `odometry` and `sensors` are gains of the law. Default: for cars, vans
    and trucks, a leader drives by "path" and a follower by "tracking" with policy = "obey" and on_loss = "drive", both
    with odometry = "car"; required for robots."""
    lidar: Lidar = Lidar()
    """Laser scanner, by name or as a table."""
    lidars: dict[Identifier, Lidar] = Field({})
    """Further laser scanners, each with a name of its own. Their interval must be a multiple of that of `lidar`.
    Default: those that the law declares: "tracking" has "around", of preset "car-around"."""
    sensors: dict[Identifier, SensorTable] = Field({})
    """Sensors from plug-ins, each with the name by which the law asks for it in `needs`. Default: none."""
    odometry: OdometryTable = OdometryTable()
    """Errors of the measured own speed and yaw rate, by name or as a table. Default: "none"; "car" where the law is
    left out."""


# Keys that take a table or a name -> the key of the table that the name is the value of.
SHORT = {
    "leader": Driver.short,
    "follower": Driver.short,
    "lidar": Lidar.short,
    "noise": NoiseTable.short,
    "odometry": OdometryTable.short,
    "vehicle": Vehicle.short,
}
