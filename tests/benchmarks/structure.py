"""Print the size of functions and classes of the package, and import rings.

    .venv/bin/python tests/benchmarks/structure.py [CHECKOUT]

A function's lines are those of its code, without its docstring, comments and blank lines.
"""

from __future__ import annotations

import ast
import io
import statistics
import sys
import tokenize
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

PACKAGES = ("platoontraffic", "lidar", "analysis")
MOST_PARAMETERS, MOST_STATE = 8, 12
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


class Function(NamedTuple):
    lines: int
    parameters: int  # without self and cls
    kernel: bool  # compiled by numba
    name: str


class State(NamedTuple):
    attributes: int  # fields, or names that methods assign on self
    frozen: bool
    name: str


def code_lines(source: str) -> set[int]:
    """Numbers of the lines with code on them."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {n for token in tokens if token.type not in NO_CODE for n in range(token.start[0], token.end[0] + 1)}


def docstring_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> set[int]:
    if ast.get_docstring(node, clean=False) is None:
        return set()
    return set(range(node.body[0].lineno, node.body[0].end_lineno + 1))


def function(node: ast.FunctionDef | ast.AsyncFunctionDef, code: set[int], place: str) -> Function:
    lines = code & set(range(node.lineno, node.end_lineno + 1)) - docstring_lines(node)
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    own = [argument for argument in arguments if argument.arg not in ("self", "cls")]
    kernel = any("compile" in ast.unparse(decorator) for decorator in node.decorator_list)
    return Function(len(lines), len(own), kernel, f"{place}:{node.lineno} {node.name}")


def state(node: ast.ClassDef, place: str) -> State:
    fields = {statement.target.id for statement in node.body if isinstance(statement, ast.AnnAssign)}
    stored = {
        part.attr
        for part in ast.walk(node)
        if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Store) and ast.unparse(part.value) == "self"
    }
    frozen = any("frozen=True" in ast.unparse(decorator) for decorator in node.decorator_list)
    frozen |= any(ast.unparse(base) in ("NamedTuple", "BaseModel", "Table") for base in node.bases)
    return State(len(fields | stored), frozen, f"{place}:{node.lineno} {node.name}")


def modules(root: Path) -> Iterator[tuple[str, Path]]:
    """Dotted names, all below platoontraffic, and files."""
    for package in PACKAGES:
        above = "platoontraffic" if package == "platoontraffic" else f"platoontraffic.{package}"
        for file in sorted((root / package).rglob("*.py")):
            inside = file.relative_to(root / package).with_suffix("").parts
            yield ".".join([above, *inside]).removesuffix(".__init__"), file


def imports(name: str, file: Path, tree: ast.AST, known: set[str]) -> set[str]:
    """Modules of the package that a module imports, inside functions as well."""
    package = name.split(".") if file.name == "__init__.py" else name.split(".")[:-1]
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            wanted = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = [*above, *([node.module] if node.module else [])]
            wanted = [".".join([*base, alias.name]) for alias in node.names]
        else:
            continue
        for target in wanted:
            found.add(target if target in known else target.rpartition(".")[0])
    # what the package itself gives to its users is no arrow to it
    return found & known - {name, "platoontraffic"}


def ring(arrows: dict[str, set[str]]) -> str:
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return " -> ".join(error.args[1])
    return "none"


def room(module: str) -> str:
    return module.split(".")[1] if "." in module else module


def between_rooms(arrows: dict[str, set[str]]) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for module, needed in arrows.items():
        found.setdefault(room(module), set()).update({room(other) for other in needed} - {room(module)})
    return found


def main() -> None:
    root = Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parents[2]
    found, functions, classes, arrows = dict(modules(root)), [], [], {}
    for name, file in found.items():
        source = file.read_text(encoding="utf-8")
        tree, code, place = ast.parse(source), code_lines(source), str(file.relative_to(root))
        nodes = list(ast.walk(tree))
        functions += [function(n, code, place) for n in nodes if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
        classes += [state(n, place) for n in nodes if isinstance(n, ast.ClassDef)]
        arrows[name] = imports(name, file, tree, set(found))
    lines = sorted(f.lines for f in functions)
    p95 = statistics.quantiles(lines, n=20)[-1]
    print(f"{len(found)} files, {len(lines)} functions: "
          f"median {statistics.median(lines):g}, p95 {p95:g}, max {lines[-1]} lines")  # fmt: skip
    for f in sorted(functions, reverse=True)[:10]:
        print(f"  {f.lines:3} {f.name}")
    print(f"functions with more than {MOST_PARAMETERS} parameters, without kernels:")
    for f in functions:
        if f.parameters > MOST_PARAMETERS and not f.kernel:
            print(f"  {f.parameters:3} {f.name}")
    print(f"classes with more than {MOST_STATE} attributes:")
    for c in sorted(classes, reverse=True):
        if c.attributes > MOST_STATE:
            print(f"  {c.attributes:3} {c.name}{', frozen' if c.frozen else ''}")
    rooms = between_rooms(arrows)
    print(f"{len(rooms)} rooms, {sum(map(len, rooms.values()))} arrows; ring of rooms: {ring(rooms)}; "
          f"of files: {ring(arrows)}")  # fmt: skip


if __name__ == "__main__":
    main()
