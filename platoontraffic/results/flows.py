"""Flows of all vehicles at the ends of counted edges."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from platoontraffic.results.metrics import Value


def of_passages(passages: pd.DataFrame, edges: Sequence[str], duration: float) -> list[Value]:
    """Metrics of the scope `everybody`, one for each edge. duration: of the run [s]"""
    per_hour = 3600 / duration if duration else float("nan")
    counts = passages.edge_id.value_counts()
    return [Value("everybody", "", "", _name(edge), float(counts.get(edge, 0)) * per_hour, "1/h") for edge in edges]


def meanings(edges: Sequence[str]) -> dict[str, str]:
    """Metric -> meaning."""
    return {
        _name(edge): f"vehicles that passed the end of edge {edge}, over the time from 0 to the end" for edge in edges
    }


def _name(edge: str) -> str:
    return f"flow_{edge}"
