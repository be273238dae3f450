"""Right of way in a network file: SUMO may die of junctions whose requests do not fit their connections."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping


class Requests:
    """The requests of each junction, read element by element. There is one for each connection and crossing."""

    def __init__(self) -> None:
        self._ends: dict[str, str] = {}  # edge -> junction
        self._links: Counter[str] = Counter()  # by junction
        self._rows: dict[str, list[Mapping[str, str]]] = {}  # by junction, in the order of the file
        self._junction = ""

    def note(self, tag: str, attributes: Mapping[str, str]) -> None:
        if tag == "edge":
            self._ends[attributes.get("id", "")] = attributes.get("to", "")
            if attributes.get("function") == "crossing":  # :JUNCTION_cNUMBER
                self._links[attributes.get("id", "")[1:].rpartition("_c")[0]] += 1
        elif tag == "junction":
            self._junction = attributes.get("id", "")
        elif tag == "request":
            self._rows.setdefault(self._junction, []).append(attributes)
        elif tag == "connection":
            before, after = attributes.get("from", ""), attributes.get("to", "")
            if not before.startswith(":") and not after.startswith(":"):
                self._links[self._ends.get(before, "")] += 1

    def fault(self) -> str:
        """The fault of the first junction that has one; "" if there is none."""
        for junction, rows in self._rows.items():
            n = len(rows)
            if n != self._links[junction]:
                return f"junction '{junction}' has {n} requests for {self._links[junction]} connections and crossings"
            sizes = {len(row.get(key, "")) for row in rows for key in ("response", "foes")}
            if [row.get("index") for row in rows] != list(map(str, range(n))) or sizes != {n}:
                return f"junction '{junction}' has requests that are not numbered from 0 to {n - 1}, of {n} digits each"
        return ""
