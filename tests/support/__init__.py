"""What several tests use."""

from pathlib import Path

ROOT = Path(__file__).parents[2]  # of the repository
ODD_NETS = Path(__file__).parent / "nets"  # networks with what the shipped ones have not
