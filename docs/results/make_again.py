"""Makes the numbers of the pages Results again: runs the commands that stand on them, and keeps what they print.

    python docs/results/make_again.py --list             # every command, with the time that its page says
    python docs/results/make_again.py                    # all of them, which takes a day or more
    python docs/results/make_again.py paper speed        # those of these pages

What a command prints is in results/again/PAGE-NUMBER.txt, beside its command line; runs and batches are in results/ and
are not repeated when they exist. Exit code 1 if a command fails.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
TOP = HERE.parents[1]
BLOCK = re.compile(r"^<!-- (?:dry|not run): (?P<time>[^>\n]*) -->\n```sh\n(?P<lines>.*?)^```", re.MULTILINE | re.DOTALL)


def commands(page: str) -> list[tuple[str, str]]:
    """(command, time) of the commands of a page."""
    found = []
    for block in BLOCK.finditer((HERE / f"{page}.md").read_text(encoding="utf-8")):
        lines = (line.partition("#")[0].strip() for line in block["lines"].splitlines())
        found += [(line, block["time"]) for line in lines if line and not line.startswith("python docs/results/")]
    return found


def main() -> int:
    pages = sorted(file.stem for file in HERE.glob("*.md"))
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=f"of {', '.join(pages)}; default: all")
    parser.add_argument("--list", action="store_true", help="print the commands, run none")
    given = parser.parse_args()
    if unknown := set(given.pages).difference(pages):
        parser.error(f"no such page: {', '.join(sorted(unknown))}")
    failed = 0
    for page in given.pages or pages:
        for number, (command, time) in enumerate(commands(page), 1):
            print(f"{page:18} {command}  ({time})", flush=True)
            if not given.list:
                failed += not _done(command, TOP / "results" / "again" / f"{page}-{number}.txt")
    return 1 if failed else 0


def _done(command: str, file: Path) -> bool:
    """Whether a command has succeeded; what it prints is in the file then, and otherwise, too."""
    file.parent.mkdir(parents=True, exist_ok=True)
    name, *words = shlex.split(command)
    program = [sys.executable] if name == "python" else [sys.executable, "-m", name]
    paths = os.pathsep.join(filter(None, (str(TOP), os.environ.get("PYTHONPATH"))))
    with file.open("w", encoding="utf-8") as out:
        print(f"$ {command}", file=out, flush=True)
        environment = os.environ | {"PYTHONPATH": paths}
        ended = subprocess.run([*program, *words], cwd=TOP, stdout=out, stderr=subprocess.STDOUT, env=environment)
    return ended.returncode == 0


if __name__ == "__main__":
    sys.exit(main())
