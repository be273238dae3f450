"""Simulations in processes of their own, which are copied exactly by forks."""
