"""Types and shapes are checked while the tests run: in the rooms of `ROOMS`, by jaxtyping and beartype."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable
from functools import wraps
from inspect import unwrap
from typing import Any

from beartype import BeartypeConf, beartype
from jaxtyping import _import_hook, install_import_hook

ROOMS = ("rpil.numerics", "rpil.policies", "rpil.mixture", "rpil.inference")
ROOMS += tuple(f"rpil.results.{file}" for file in ("record", "summary"))

CHECKED_CALLS = 10
"""Calls of each function that are checked in each test: iterations repeat types, and EM would take twice as long."""

calls: Counter[Callable[..., Any]] = Counter()
"""Calls of each function in the running test, which `conftest.py` clears."""

types_checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""An int is a float, as for type checkers."""


def first_calls(checked: Callable[..., Any]) -> Callable[..., Any]:
    """`checked` for the first calls in a test, and then the function that it checks."""
    function = unwrap(checked)

    @wraps(checked)
    def call(*args: Any, **kwargs: Any) -> Any:
        calls[function] += 1
        return (checked if calls[function] <= CHECKED_CALLS else function)(*args, **kwargs)

    return call


class _Outer(_import_hook.JaxtypingTransformer):
    """Leaves out functions within functions: each call around them would make their checks anew, in milliseconds, so
    that fits took 2.5 times as long."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> Any:
        if isinstance(self._parents[-1], ast.FunctionDef):
            return node
        decorated = super().visit_FunctionDef(node)
        first = ast.parse("__import__('typecheck').first_calls", mode="eval").body
        for part in ast.walk(first):
            ast.copy_location(part, node)
        decorated.decorator_list.insert(len(decorated.decorator_list) - 1, first)
        return decorated


def install() -> None:
    """To be called before anything of rpil is imported."""
    _import_hook.JaxtypingTransformer = _Outer
    install_import_hook(ROOMS, "typecheck.types_checked")
