"""How large the library is, by room: ``python tools/budget.py``.

Lines are those of the Python files. Numbers are what was chosen: those in defaults of the fields of classes, and in
constants of modules. A grid of k values counts k; literals in functions do not count. `tests/test_budget.py` has the
budgets, which only fall.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1] / "src" / "rpil"


class Size(NamedTuple):
    """Lines and numbers of a room."""

    lines: int
    numbers: int


def size_of(room: Path) -> Size:
    """The size of the Python files in a folder."""
    sources = [path.read_text(encoding="utf-8") for path in room.rglob("*.py")]
    return Size(sum(len(source.splitlines()) for source in sources), sum(map(numbers_of, sources)))


def numbers_of(source: str) -> int:
    """Numbers in the constants of a module and in the fields of its classes."""
    tree = ast.parse(source)
    bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
    return sum(map(is_number, (part for body in bodies for node in body for part in value_of(node))))


def value_of(node: ast.stmt) -> Iterator[ast.AST]:
    """The parts of the value that a statement gives a name."""
    if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
        yield from ast.walk(node.value)


def is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)


def main() -> None:
    sizes = {path.name: size_of(path) for path in sorted(ROOT.iterdir()) if (path / "__init__.py").exists()}
    sizes["all"] = Size(*map(sum, zip(*sizes.values(), strict=True)))
    for room, size in sizes.items():
        print(f"{room:12} {size.lines:7,} lines {size.numbers:5,} numbers")


if __name__ == "__main__":
    main()
