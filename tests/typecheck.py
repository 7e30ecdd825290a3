"""Types and shapes of every call of the rooms in `ROOMS` are checked while the tests run: jaxtyping by beartype."""

from __future__ import annotations

from beartype import BeartypeConf, beartype

ROOMS = ("rpil.numerics", "rpil.policies", "rpil.mixture", "rpil.inference")
ROOMS += tuple(f"rpil.audit.{file}" for file in ("calibration", "label_choice", "record", "summary"))

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""An int is a float, as for type checkers."""
