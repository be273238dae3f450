"""Geometry in the plane that many rooms share: lines with stations on them. SI units, x east, y north."""
