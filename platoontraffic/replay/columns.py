"""Compact columns of numbers, for a page that unpacks them with functions of every browser."""

from __future__ import annotations

import gzip
import json
import struct
from typing import Any

import numpy as np


class Columns:
    """Columns of numbers, rounded to whole steps.

    A column is stored as differences between successive values, with the sign in the lowest bit, in planes: first the
    lowest bytes of all differences, then the next ones. Slowly changing values thus become mostly zeros, which gzip
    compresses well. In a column with missing values NaN is 0 and all other values are shifted up by one step.
    """

    def __init__(self) -> None:
        self._planes: list[bytes] = []
        self._size = 0

    def add(self, values: Any, step: float = 1.0) -> dict[str, Any]:
        """Append a column; returns the offset and format that the page needs to read it.

        step   : resolution
        raises : ValueError if a difference takes more than six bytes
        """
        values = np.asarray(values, dtype=float).ravel()
        missing = np.isnan(values)
        gaps = bool(missing.any())
        whole = np.rint(np.where(missing, 0.0, values) / step).astype(np.int64)
        lowest = int(whole[~missing].min(initial=0)) if gaps else 0
        if gaps:
            whole = np.where(missing, 0, whole - lowest + 1)
        change = np.diff(whole, prepend=0)
        signed = (change << 1) ^ (change >> 63)
        planes = max(int(signed.max(initial=0)).bit_length() + 7 >> 3, 1)
        if planes > 6:
            raise ValueError(f"{values[np.abs(whole).argmax()]} cannot be written in steps of {step}")
        place = {"at": self._size, "n": len(values), "planes": planes, "step": step}
        if gaps:
            place["lowest"] = lowest
        for plane in range(planes):
            self._planes.append(((signed >> (8 * plane)) & 0xFF).astype(np.uint8).tobytes())
        self._size += planes * len(values)
        return place

    def packed(self, header: dict[str, Any]) -> bytes:
        """gzip of: length of the header (4 bytes, little-endian), the header as JSON, all columns."""
        text = json.dumps(header, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        return gzip.compress(b"".join([struct.pack("<I", len(text)), text, *self._planes]), compresslevel=6, mtime=0)
