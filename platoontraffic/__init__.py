"""Platoons that drive by laser scanner, in SUMO traffic."""

from platoontraffic.controllers import Decision, Sensed, Target, per_vehicle
from platoontraffic.vehicle import Drive, Twist

__all__ = ["Decision", "Drive", "Sensed", "Target", "Twist", "per_vehicle"]
