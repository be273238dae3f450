"""Networks built by netconvert, which comes with the extra `gui`."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

from platoontraffic.errors import InputError

HEADER = re.compile(r"<!-- generated on .*?-->\s*", re.DOTALL)  # has date and paths


def build_net(config: str | Path, output: str | Path) -> None:
    """Build a network from a .netccfg. Equal sources give equal bytes: the header with date and paths is left out.

    raises : InputError with netconvert's errors
    """
    import sumo  # from eclipse-sumo, of the extra `gui`

    config, output = Path(config), Path(output)
    netconvert = Path(sumo.SUMO_HOME, "bin", "netconvert")
    done = subprocess.run(
        [netconvert, "-c", config.name, "-o", output.resolve()],
        cwd=config.parent,
        env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise InputError(*(f"{config}: netconvert: {fault}" for fault in errors_in(done.stderr)))
    output.write_text(HEADER.sub("", output.read_text(encoding="utf-8"), count=1), encoding="utf-8")


def errors_in(stderr: str) -> list[str]:
    """The errors that a program of SUMO reported; all of its output where no line is marked as an error."""
    return re.findall(r"^Error: *(.+)$", stderr, re.MULTILINE) or [stderr.strip()]
