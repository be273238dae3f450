"""Tests of platoontraffic: a folder mirrors each room, and `support` holds what several of them use."""
