"""Demonstrations that are known to be good, beside those that are to be judged."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.names import quoted


def with_reference(demonstrations: Demonstrations, reference: Demonstrations) -> Demonstrations:
    """The `demonstrations`, and after them those of the `reference`; all ids are text, and no two are alike.

    A `DataError` where the two have other observations or actions.
    """
    one, other = demonstrations, reference
    missing = [name for name in one.observation_names if name not in other.observation_names]
    more = [name for name in other.observation_names if name not in one.observation_names]
    if missing or more:
        lacks = f"lacks {quoted(missing, 5)}" if missing else f"has {quoted(more, 5)} too"
        raise DataError(
            f"{other.source}: its observations are not those of {one.source}: it {lacks}; name the same ones with "
            "<option> or <option>.",
            ("observations", "exclude"),
        )
    columns = [other.observation_names.index(name) for name in one.observation_names]
    kinds = [_kind_of_action(each) for each in (one, other)]
    if kinds[0] != kinds[1]:
        raise DataError(
            f"{other.source}: its actions are {kinds[1]}, and those of {one.source} are {kinds[0]}; give a reference "
            "with the same actions, or say what they are with <option> or <option>.",
            ("action", "action_kind"),
        )
    prefixes = itertools.chain(["reference "], (f"reference {k} " for k in itertools.count(2)))
    prefix = next(p for p in prefixes if not any(str(name).startswith(p) for name in one.ids))
    return replace(
        one,
        observations=np.concatenate([one.observations, other.observations[:, columns]]),
        actions=np.concatenate([one.actions, other.actions]),
        offsets=np.concatenate([one.offsets, one.n_steps + other.offsets[1:]]),
        ids=(*map(str, one.ids), *(f"{prefix}{name}" for name in other.ids)),
    )


def _kind_of_action(demonstrations: Demonstrations) -> str:
    """What the actions are, in words that are alike where they can be judged together."""
    if demonstrations.is_discrete:
        return "discrete text" if demonstrations.actions.dtype.kind == "U" else "discrete numbers"
    names = demonstrations.action_names
    parts = f" ({quoted(names, 5)})" if names else ""
    if demonstrations.part_classes:
        return f"the parts {', '.join(map(str, demonstrations.part_classes))}"
    return f"{demonstrations.n_actions} continuous numbers{parts}"
