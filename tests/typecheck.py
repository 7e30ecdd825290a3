"""Types and shapes of every call of the rooms in `ROOMS` are checked while the tests run: jaxtyping by beartype."""

from __future__ import annotations

import ast
from typing import Any

from beartype import BeartypeConf, beartype
from jaxtyping import _import_hook, install_import_hook

ROOMS = ("rpil.numerics", "rpil.policies", "rpil.mixture", "rpil.inference")
ROOMS += tuple(f"rpil.audit.{file}" for file in ("calibration", "label_choice", "record", "summary"))

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""An int is a float, as for type checkers."""


class _Outer(_import_hook.JaxtypingTransformer):
    """Leaves out functions within functions: each call around them would make their checks anew, in milliseconds, so
    that fits took 2.5 times as long."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> Any:
        return node if isinstance(self._parents[-1], ast.FunctionDef) else super().visit_FunctionDef(node)


def install() -> None:
    """To be called before anything of rpil is imported."""
    _import_hook.JaxtypingTransformer = _Outer
    install_import_hook(ROOMS, "typecheck.check")
