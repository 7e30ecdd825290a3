"""How large the library is, by room, and which names have two meanings: ``python tools/budget.py``.

Lines are those of the Python files. Numbers are what was chosen: those in defaults of the fields of classes, and in
constants of modules. A grid of k values counts k; literals in functions do not count.

A name has two meanings where two modules define a class or a type of that name, with or without an underscore, or where
two files of different folders share it. Type variables are no types, and `settings.py` and `protocol.py` mean the same
in every room: its settings, and what its classes have in common. `tools/path_of_audit.py` counts what one audit runs.
`tests/test_budget.py` has the budgets, which only fall.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1] / "src" / "rpil"
SHARED_FILES = "settings.py", "protocol.py"


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


def names_of_types(source: str) -> Iterator[str]:
    """The classes and names of types that a module defines, without underscores before them."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef):
            yield node.name.lstrip("_")
        elif isinstance(node, ast.Assign) and isinstance(name := node.targets[0], ast.Name):
            word = name.id.lstrip("_")
            is_variable = isinstance(node.value, ast.Call) and ast.unparse(node.value.func) == "TypeVar"
            if word[:1].isupper() and not word.isupper() and not is_variable:
                yield word


def two_meanings(root: Path = ROOT) -> dict[str, list[str]]:
    """The names with two meanings, each with its files; those of files end with ``.py``."""
    homes: dict[str, set[str]] = {}
    for path in sorted(root.rglob("*.py")):
        shared = path.name.startswith("__") or path.name in SHARED_FILES
        for name in (*names_of_types(path.read_text(encoding="utf-8")), *(() if shared else (path.name,))):
            homes.setdefault(name, set()).add(str(path.relative_to(root)))
    return {name: sorted(files) for name, files in sorted(homes.items()) if len(files) > 1}


def n_context_variables(root: Path = ROOT) -> int:
    return sum(path.read_text(encoding="utf-8").count("ContextVar(") for path in root.rglob("*.py"))


def main() -> None:
    sizes = {path.name: size_of(path) for path in sorted(ROOT.iterdir()) if (path / "__init__.py").exists()}
    sizes["all"] = Size(*map(sum, zip(*sizes.values(), strict=True)))
    for room, size in sizes.items():
        print(f"{room:12} {size.lines:7,} lines {size.numbers:5,} numbers")
    names = two_meanings()
    print(*(f"{name}: {', '.join(files)}" for name, files in names.items()), sep="\n")
    n_files = sum(name.endswith(".py") for name in names)
    print(f"two meanings: {len(names) - n_files} types, {n_files} files; {n_context_variables()} context variables")


if __name__ == "__main__":
    main()
