"""Mutants of everything that is read: scenarios, studies, networks, routes, configurations, environments.

Each has a number, of which it is made: equal numbers make equal files. Mutants are made of shipped files.
"""

from __future__ import annotations

import random
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from platoontraffic import shipped

# Every twentieth is of the same kind.
KINDS = (
    *["scenario"] * 7,
    *["network"] * 4,
    *["traffic"] * 3,
    *["study"] * 2,
    "configuration",
    *["sumocfg"] * 2,
    "shell",
)
SCENARIOS = ("paper_loop", "corridor_platoon", "corridor_two_platoons", "corridor_cut_in", "corridor_pedestrian",
             "corridor_manoeuvres", "corridor_breakdown", "bends_platoon")  # fmt: skip
LONG, BIG = "a" * 300, 10**400
OFTEN_ONE = (1, 1, 1, 2, 3)  # changes of a mutant: after many nothing is accepted

# Values that take the place of others in TOML; a text is written as it is.
VALUES: tuple[Any, ...] = (
    float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 5e-324, 1e-13, 0.1, 0, 0.0, -0.0, -1, 1, 3, 2**31,
    2**63 - 1,
    "", "1", "nan", "NA", "true", "=1+1", LONG, "../../etc", "/dev/null", ".", "é", "²", "\u202e", "\x01", "a b",
    "a,b", "a:b",
    "x.py:Y", "numpy:ndarray", "platoontraffic.controllers:Law", ":", "%s", "${HOME}", "<b>", "'", '"', True, False,
    [], {},
    [[]], [1, 2], ["a"], [{}], {"from": 0, "to": 1, "count": 3}, {"from": 1}, {"law": "path"}, {"a": {"a": {"a": 1}}},
    [1.5] * 200, ["car"] * 5, [[0.0, 0.0], [1.0, 1.0]],
)  # fmt: skip
RAW = (
    str(BIG),
    hex(BIG),
    "[" * 900 + "]" * 900,
    "1979-05-27T07:32:00Z",
    "07:32:00",
    "1_0",
    "'''a\nb'''",
    "0x1F",
    "1e400",
)
XML_VALUES = (
    "nan", "inf", "-inf", "-5", "0", "1", "1e300", "-1e300", "1e-300", "1e400", "99999999999999999999", "0.5", "",
    " ", "x",
    LONG, "é", "&lt;b&gt;", "&amp;", "true", "a b", "0,0 1,1", "0,0", "0,0 1e300,0 1e300,1e300", "1,2,3,4", "a:b",
    "${HOME}",
    "../x", "/dev/null", "-1", "2147483648", "NULL", "0x10", "1:30:00", "=1+1", "all", "passenger", "max", "GrGr",
)  # fmt: skip
TEXTS = (
    "\x00",
    "\xff\xfe",
    "[[",
    "]]",
    "=",
    '"',
    "'''",
    "\n",
    "<",
    ">",
    "&",
    "<!--",
    "&lol;",
    "{",
    "}",
    "#",
    "é",
    "\t\x07",
)
DOCTYPE = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY lol "&b;&b;&b;&b;">]>'
SHELL = {
    "NUMBA_NUM_THREADS": ("0", "-1", "x", ""), "PYTHONIOENCODING": ("ascii", "latin-1", "utf-16"),
    "LANG": ("C", "xx_YY"), "LC_ALL": ("C", "POSIX"), "TZ": ("x", "UTC"), "HOME": ("/nowhere", ""), "COLUMNS": ("0",
    "1", "x"),
    "TMPDIR": ("/nowhere", "/proc"), "SUMO_HOME": ("/nowhere", ""), "TERM": ("dumb", "x"), "MPLBACKEND": ("x", "agg"),
    "NUMBA_CACHE_DIR": ("/proc/x",), "XDG_CACHE_HOME": ("/proc/x",), "NUMBA_DISABLE_JIT": ("0",), "NO_COLOR": ("1",),
    "LIBSUMO_AS_TRACI": ("1", "quiet"), "PYTHONWARNINGS": ("error", "x"), "FORCE_COLOR": ("1",),
    "OMP_NUM_THREADS": ("0", "x"),
    "SUMO_BINARY": ("x",), "PYTHONOPTIMIZE": ("2",), "PYTHONDONTWRITEBYTECODE": ("1",), "PYTHONUTF8": ("0", "1"),
}  # fmt: skip
ARGUMENTS = ("platoon.size=0", "platoon.9.size=1", "platoon.²=1", "=", "a", "a=", "platoon.id=", "run.duration_s=1e400",
             "seed=" + "9" * 5000, "platoon=1", "sumo=", "sumo.net=" + LONG, "platoon.start.edge=1", "run=[", "a.b.c=1",
             "run.duration_s=" + "[" * 900, "name=a/b", "title=\x1b[31m", "platoon.leader=numpy:array",
        "é=é")  # fmt: skip


class Mutant(NamedTuple):
    kind: str
    arguments: list[str]  # of `check`; then of `run`, with more
    environment: dict[str, str]  # that it has beside the usual; only the kind shell has one
    runs: bool  # it can also be run


def write(number: int, folder: Path) -> Mutant:
    """The mutant of a number; its files are written into the folder."""
    rng = random.Random(f"door {number}")
    kind = KINDS[number % len(KINDS)]
    folder.mkdir(parents=True, exist_ok=True)
    return _WRITERS[kind](rng, folder)


def _scenario(rng: random.Random, folder: Path) -> Mutant:
    text = _base(rng)
    if rng.random() < 0.25:
        return _mutant("scenario", _write(folder / "s.toml", _edited(rng, text)))
    return _mutant("scenario", _write(folder / "s.toml", _mutated_toml(rng, text).encode("utf-8", "surrogatepass")))


def _study(rng: random.Random, folder: Path) -> Mutant:
    name = rng.choice(sorted(shipped.studies()))
    table = tomllib.loads(shipped.studies()[name].read_text(encoding="utf-8"))
    small = {"base": "paper_loop", "replications": 2, "grid": {"platoon.size": [2, 3]}}
    table = rng.choice([table, small, small])
    table["leave_out"] = [rng.choice(_CONDITIONS)]
    text = tomli_w.dumps(table)
    raw = _edited(rng, text) if rng.random() < 0.3 else _mutated_toml(rng, text).encode("utf-8", "surrogatepass")
    return Mutant("study", [str(_write(folder / "s.toml", raw))], {}, runs=False)


_CONDITIONS = (
    "platoon.size > 2", "platoon.size < 1e-3", '"a" * 9999999999 == 1', "[1] * 99999999999 == 1", "-" * 20_000 + "1",
    "(" * 500,
    "platoon.size / 0", "1e308 * platoon.size * 1e308 > 1", "platoon.size.real", "().__class__", "lambda: 1",
    "x for x in y", "",
    "not " * 5000 + "1", "platoon.size in 3", "platoon.size > 'a'", "\x00", "1 < 2 < platoon.size", "é",
    "99999999999999999999 > 1",
)  # fmt: skip


def _network(rng: random.Random, folder: Path) -> Mutant:
    text, net = _with_net(rng)
    raw = _mutated_xml(rng, shipped.networks()[net].read_text(encoding="utf-8"))
    _write(folder / "x.net.xml", raw)
    return _mutant("network", _write(folder / "s.toml", text.encode()))


def _traffic(rng: random.Random, folder: Path) -> Mutant:
    """Routes, additional files, polygons."""
    text, net = _with_net(rng, own=False)
    beside = shipped.networks()[net].parent
    sources = [file for end in ("rou", "add", "poly") for file in sorted(beside.glob(f"*.{end}.xml"))]
    table = tomllib.loads(text)
    chosen = rng.choice(sources)
    for file in sources:
        raw = file.read_text(encoding="utf-8")
        _write(folder / file.name, _mutated_xml(rng, raw) if file == chosen else raw.encode())
        table["sumo"].setdefault("routes" if ".rou." in file.name else "additional", []).append(file.name)
    table["sumo"]["traffic"] = False
    return _mutant("traffic", _write(folder / "s.toml", tomli_w.dumps(table).encode()))


def _configuration(rng: random.Random, folder: Path) -> Mutant:
    """A scenario of a SUMO configuration that is a mutant."""
    return _of_configuration(rng, folder, scenario=True)


def _sumocfg(rng: random.Random, folder: Path) -> Mutant:
    return _of_configuration(rng, folder, scenario=False)


def _of_configuration(rng: random.Random, folder: Path, scenario: bool) -> Mutant:
    net = shipped.networks()["corridor"]
    options = [
        ("net-file", str(net)), ("route-files", str(net.with_name("corridor.rou.xml"))),
        ("additional-files", str(net.with_name("corridor.add.xml"))), ("begin", "0"), ("end", "100"), ("step-length",
        "0.1"),
        ("seed", "3"), ("tripinfo-output", "trips.xml"), ("fcd-output", "/tmp/fcd.xml"), ("time-to-teleport", "300"),
        ("lateral-resolution", "0.8"), ("device.rerouting.probability", "0.5"), ("scale", "1.0"), ("threads", "2"),
        ("max-depart-delay", "10"), ("default.speeddev", "0.1"), ("step-method.ballistic", "true"), ("x", "y"),
    ]  # fmt: skip
    lines = [f'<{name} value="{value}"/>' for name, value in options if rng.random() < 0.6 or name == "net-file"]
    text = "<configuration>\n" + "\n".join(lines) + "\n</configuration>\n"
    name = rng.choice(("c.sumocfg", "c.sumocfg", "c.netecfg"))
    if rng.random() < 0.1:
        text = f'<neteditConfiguration><sumocfg-file value="{name}"/></neteditConfiguration>'
    _write(folder / name, _mutated_xml(rng, text))
    if not scenario:
        start = ["platoon.size=2", "platoon.start.edge=west_light", "platoon.start.position_m=90", "platoon.to=b2_east"]
        return Mutant("sumocfg", [str(folder / name), *start], {}, runs=True)
    table = tomllib.loads(shipped.scenarios()["corridor_platoon"].read_text(encoding="utf-8"))
    table["sumo"] = {"config": name}
    return _mutant("configuration", _write(folder / "s.toml", tomli_w.dumps(table).encode()))


def _shell(rng: random.Random, folder: Path) -> Mutant:
    """Environments, and arguments."""
    names = rng.sample(sorted(SHELL), rng.randint(0, 3))
    environment = {name: rng.choice(SHELL[name]) for name in names}
    more = rng.sample(ARGUMENTS, rng.randint(0 if names else 1, 2))
    return Mutant("shell", ["paper_loop", *more], environment, runs=rng.random() < 0.5)


_WRITERS: dict[str, Callable[[random.Random, Path], Mutant]] = {
    "scenario": _scenario, "network": _network, "traffic": _traffic, "study": _study, "configuration": _configuration,
    "sumocfg": _sumocfg, "shell": _shell,
}  # fmt: skip


def _mutant(kind: str, file: Path) -> Mutant:
    return Mutant(kind, [str(file)], {}, runs=True)


def _write(file: Path, raw: bytes) -> Path:
    file.write_bytes(raw)
    return file


def _base(rng: random.Random) -> str:
    """A shipped scenario in which all happens in the first second."""
    text = shipped.scenarios()[rng.choice(SCENARIOS)].read_text(encoding="utf-8")
    text = re.sub(r"\b(time_s|brakes_at_s|lasts_s) = [\d.]+", lambda m: f"{m[1]} = {_SOON[m[1]]}", text)
    return re.sub(r"(?m)^warm_up_s = .*$", "warm_up_s = 5.0", text)


_SOON = {"time_s": 0.2, "brakes_at_s": 0.4, "lasts_s": 0.3}


def _with_net(rng: random.Random, own: bool = True) -> tuple[str, str]:
    """A shipped scenario and the name of its network; own: it then names x.net.xml in its place."""
    while True:
        text = _base(rng)
        if net := re.search(r'(?m)^net = "(\w+)"$', text):
            return (text.replace(net[0], 'net = "x.net.xml"') if own else text), net[1]


def _edited(rng: random.Random, text: str) -> bytes:
    """A text with some of its bytes flipped, taken out, doubled or put in."""
    raw = bytearray(text.encode())
    for _ in range(rng.choice(OFTEN_ONE)):
        at = rng.randrange(len(raw))
        how = rng.randrange(5)
        if how == 0:
            raw[at] ^= 1 << rng.randrange(8)
        elif how == 1:
            del raw[at : at + rng.randint(1, 40)]
        elif how == 2:
            raw[at:at] = rng.choice(TEXTS).encode("latin-1")
        elif how == 3:
            raw[at:at] = raw[at : at + rng.randint(1, 200)]
        else:
            del raw[at:]
            raw += b"\n"
    return bytes(raw)


def _mutated_toml(rng: random.Random, text: str) -> str:
    """A document with one to three of its values replaced, removed or added."""
    table = tomllib.loads(text)
    raw = {}
    for number in range(rng.choice(OFTEN_ONE)):
        holder, key = rng.choice(_places(table))
        how = rng.random()
        if how < 0.1:
            del holder[key]
        elif how < 0.2 and isinstance(holder, dict):
            holder[rng.choice(("x", "size", "id", "law", "é", LONG, "", "a.b"))] = rng.choice(VALUES)
        elif how < 0.3:
            raw[f"@{number}@"] = rng.choice(RAW)
            holder[key] = f"@{number}@"
        elif isinstance(holder[key], float | int) and rng.random() < 0.4:
            holder[key] = holder[key] * rng.choice((-1, 0, 1e-9, 1e9, 0.5, 3, 1e300))
        else:
            holder[key] = rng.choice(VALUES)
    written = tomli_w.dumps(table)
    for mark, words in raw.items():
        written = written.replace(f'"{mark}"', words)
    return written


def _places(table: Any) -> list[tuple[Any, Any]]:
    """Every table or list in a document with each key or number in it."""
    places = []
    inner = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in inner:
        places.append((table, key))
        if isinstance(value, dict | list):
            places += _places(value)
    return places


def _mutated_xml(rng: random.Random, text: str) -> bytes:
    """An XML document with attributes replaced or removed, elements removed or doubled, or edited as a text."""
    if rng.random() < 0.06:
        return _edited(rng, text)
    if rng.random() < 0.03:
        return (DOCTYPE + re.sub(r'"[^"]*"', '"&lol;"', _body(text), count=rng.randint(1, 4))).encode()
    if rng.random() < 0.03:
        return f'<?xml version="1.0" encoding="{rng.choice(("KOI-99", "utf-16", "latin-1"))}"?>\n{_body(text)}'.encode()
    ways = (*[_attribute] * 10, *[_attributes] * 3, *[_element] * 5, _include)
    for _ in range(rng.choice(OFTEN_ONE)):
        text = rng.choice(ways)(rng, text)
    return text.encode("utf-8", "surrogatepass")


def _body(text: str) -> str:
    return re.sub(r"^<\?xml.*?\?>", "", text)


def _attribute(rng: random.Random, text: str) -> str:
    found = list(re.finditer(r'\s([\w.-]+)="([^"]*)"', text))
    if not found:
        return text
    one = rng.choice(found)
    alike = rng.choice([other for other in found if other[1] == one[1]])[2]
    other = rng.choice((rng.choice(XML_VALUES), rng.choice(found)[2], alike, _scaled(rng, one[2])))
    new = "" if rng.random() < 0.1 else f' {one[1]}="{other}"'
    return text[: one.start()] + new + text[one.end() :]


def _scaled(rng: random.Random, text: str) -> str:
    """A number times a factor; another text with two of its letters exchanged."""
    try:
        return f"{float(text) * rng.choice((-1, 0, 1e-6, 0.5, 0.99, 1.01, 2, 100, 1e6)):g}"
    except ValueError:
        at = rng.randrange(max(len(text), 1))
        return text[:at] + text[at + 1 : at + 2] + text[at : at + 1] + text[at + 2 :]


def _attributes(rng: random.Random, text: str) -> str:
    """Every attribute of one name, such as all speeds."""
    names = sorted(set(re.findall(r'\s([\w.-]+)="', text)))
    if not names:
        return text
    name, value = rng.choice(names), rng.choice(XML_VALUES)
    return re.sub(rf'(\s{re.escape(name)})="[^"]*"', lambda m: f'{m[1]}="{value}"', text)


def _element(rng: random.Random, text: str) -> str:
    """An element without content removed, doubled, moved or replaced; now and then any line."""
    lines = text.split("\n")
    whole = [i for i, line in enumerate(lines) if line.rstrip().endswith("/>")] if rng.random() < 0.9 else []
    whole = whole or list(range(len(lines)))
    at, other = rng.choice(whole), lines[rng.choice(whole)]
    lines[at : at + 1] = rng.choice(([], [], [lines[at]] * 2, [other], [lines[at], other], [lines[at], "<x/>"]))
    return "\n".join(lines)


def _include(rng: random.Random, text: str) -> str:
    href = rng.choice(("x.net.xml", "nowhere.xml", "/etc/passwd", "http://127.0.0.1:9/x", "corridor.add.xml", "."))
    return re.sub(r"(</[\w]+>\s*)$", rf'<include href="{href}"/>\1', text)
