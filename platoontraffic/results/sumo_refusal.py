"""Which file is meant where SUMO refuses its input: SUMO's own words name it for XML errors only."""

from __future__ import annotations

import gzip
import re
from collections.abc import Sequence
from pathlib import Path

from platoontraffic.scenario import Scenario

MOST = 20_000_000  # of a file that is searched for the ids in SUMO's words [bytes]


def loaded(scenario: Scenario) -> str:
    """The files that SUMO loads, in words."""
    net, *more = (f"{kind} {', '.join(map(str, files))}" for kind, files in _files(scenario).items() if files)
    return f"{net} with {', '.join(more)}" if more else net


def refusal(words: str, scenario: Scenario) -> str:
    """`FILE: SUMO refuses it: …`, or `SUMO refuses the scenario (net …)` where the words fit no file or several."""
    config, option = scenario.configuration, re.search(r"option '-*([\w.-]+)'", words)
    if config and option and option[1] in config.options:
        return f"{config.path}: SUMO refuses it: {words}"
    if file := _meant(words, scenario):
        return f"{file}: SUMO refuses it: {words}"
    return f"SUMO refuses the scenario ({loaded(scenario)}): {words}"


def failure(when: str, words: str, scenario: Scenario) -> str:
    """`SUMO failed at …`, with the file that the words fit: SUMO finds some faults of vehicles at their departure only.

    when: `40 s`, or `its end`
    """
    file = _meant(words, scenario)
    return f"{file}: SUMO failed at {when}: {words}" if file else f"SUMO failed at {when}: {words}"


def _meant(words: str, scenario: Scenario) -> Path | None:
    """The only file that SUMO's words name, or that has all ids in them."""
    files = [file for some in _files(scenario).values() for file in some]
    meant = [file for file in files if file.name.removesuffix(".gz") in words]
    if not meant and (ids := re.findall(r"'([^'\s]+)'", words)):
        meant = [file for file in files if _has_all(file, ids)]
    if len(meant) > 1:  # routes and additional files also name edges of the network
        meant = [file for file in meant if file != scenario.net]
    return meant[0] if len(meant) == 1 else None


def _files(scenario: Scenario) -> dict[str, Sequence[Path]]:
    config = scenario.configuration
    return {
        "net": [scenario.net],
        "routes": scenario.route_files,
        "additional": scenario.additional_of_sumo,
        "configuration": [config.path] if config else [],
    }


def _has_all(file: Path, ids: Sequence[str]) -> bool:
    """Whether every id, or the flow that it is of, is a word in the file."""
    try:
        with file.open("rb") as opened:
            packed = opened.read(2) == b"\x1f\x8b"
        with gzip.open(file) if packed else file.open("rb") as opened:
            text = opened.read(MOST).decode(errors="replace")
    except (OSError, EOFError):
        return False
    names = ((re.escape(name), re.escape(name.rpartition(".")[0] or name)) for name in ids)
    return all(re.search(rf'["\s](?:{name}|{flow})["\s]', text) for name, flow in names)
