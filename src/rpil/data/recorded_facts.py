"""Facts about demonstrations beside their steps: the order in which they were made, their sessions and outcomes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from rpil.data.errors import DataError
from rpil.data.id_values import check_ids, read_id_pairs
from rpil.data.names import plain_name
from rpil.numerics.types import Array, Float, Int

Outcome = Mapping[int, float] | Mapping[str, float] | Sequence[float] | Array
"""Values that a user gives: a number by id, or one for each demonstration."""

FILE_SESSION = "file"
"""The word that stands for the file of each demonstration in the place of a column of the session."""

_REWARD = re.compile(r"(?:next_)?rew(?:ard)?s?")


@dataclass(frozen=True, eq=False)
class Facts:
    """Facts about M demonstrations beside their steps; nothing of it is used unless it is asked for."""

    order: Float[Array, " M"] | None = None
    """The position of each demonstration in the order that the file states, if it states one."""
    sessions: tuple[str, ...] = ()
    """Session of each demonstration; empty where none is known."""
    outcomes: tuple[Float[Array, " M"], ...] = ()
    """How each demonstration ended, by one column or several, more is better; NaN where it is not known."""
    outcome_names: tuple[str, ...] = ()
    """The columns, as the user named them."""


def outcome_of_steps(values: Float[Array, " N"], offsets: Int[Array, " _"], column: str) -> Float[Array, " M"] | None:
    """One number for each demonstration, of a column with a value for each step: the sum of a reward, the value of a
    column that is constant within each, the last one of a flag, 0 or 1; else None. NaN is a missing value: one in a
    reward makes its sum unknown, others are left out."""
    if _REWARD.fullmatch(plain_name(column)):
        return np.add.reduceat(values, offsets[:-1])
    low, high = (extreme.reduceat(values, offsets[:-1]) for extreme in (np.fmin, np.fmax))
    if np.all((low == high) | np.isnan(low)):
        return np.asarray(low)
    if np.isin(values[~np.isnan(values)], (0, 1)).all():
        last = np.maximum.reduceat(np.where(np.isnan(values), -1, np.arange(len(values))), offsets[:-1])
        return np.where(last < 0, np.nan, values[last])
    return None


def check_outcome(outcome: Float[Array, " M"], name: str, source: str) -> Float[Array, " M"]:
    """The `outcome` called `name`; a `DataError` where it is infinite, known for none, or the same for all."""
    known = outcome[~np.isnan(outcome)]
    if not np.isfinite(known).all():
        raise DataError(f"{source}: {name} is infinite for some demonstrations; give numbers, or leave it out.")
    if not tells(outcome):
        known_of = "every demonstration that it is known of, which tells none from another"
        fault = f"{known[0]:g} for {known_of}" if len(known) else "known for no demonstration"
        raise DataError(f"{source}: {name} is {fault}; name another, or leave it out.")
    return outcome


def tells(outcome: Float[Array, " M"]) -> bool:
    """Whether the `outcome` differs between demonstrations of which it is known."""
    return len(np.unique(outcome[~np.isnan(outcome)])) > 1


def given_outcome(
    given: Outcome | str, ids: Sequence[Hashable], source: str, every: Sequence[Hashable] = ()
) -> Float[Array, " M"]:
    """The outcome that a user gives, by id, for each of M demonstrations, or in a file (id,value), which may speak of
    others of `every` one; those left out are unknown. A `DataError` as `check_outcome`, and where an id is unknown or
    twice in the file, a value no number, or their count another one."""
    if isinstance(given, str):
        source, rows = Path(given).name, read_id_pairs(given, "value")
        words = {"true": 1.0, "false": 0.0, "": np.nan}
        found = cast(dict[str, float], {m: words.get(str(value).lower(), value) for m, value, *_ in rows})
        if len(found) < len(rows):
            [(twice, _)] = Counter(m for m, *_ in rows).most_common(1)
            raise DataError(f"{source}, demonstration {twice!r}: it has two outcomes; keep one.")
        return given_outcome(found, ids, source, every)
    if isinstance(given, Mapping):
        by_id = {str(m): value for m, value in given.items()}
        check_ids(by_id, every or ids, source, "--outcome")
        given = [by_id.get(str(m), np.nan) for m in ids]
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{source}: outcome holds what is no number; give a number for each demonstration.") from error
    if values.shape != (len(ids),):
        wrong = f"outcome has the shape {values.shape}"
        raise DataError(f"{source}: {wrong}; give one number for each of {len(ids)} demonstrations.")
    return check_outcome(values, "the outcome", source)


def check_sessions(sessions: Sequence[str], name: str, source: str) -> None:
    """A `DataError` where the `sessions` of M demonstrations, of the column `name` or by "file", divide nothing."""
    n_sessions = len(set(sessions))
    if n_sessions == len(sessions) or (n_sessions == 1 and name == FILE_SESSION):
        each = "one session" if n_sessions == 1 else "a session of its own each"
        raise DataError(
            f"{source}: the demonstrations have {each} by {name!r}, which makes no sessions to judge within; name a "
            "column that several share with --session, or leave it out."
        )
