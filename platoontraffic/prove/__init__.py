"""Tests of a road network: random routes, driven alone on bare ground or by platoons in traffic."""
