"""The audit of some of the demonstrations that were judged together."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np

from rpil.results.record import Audit

_OF_DEMONSTRATIONS = (
    *("log_odds", "from_actions", "from_demonstrator", "from_label"),
    *("expert_proba", "reliability", "reliability_interval", "columns", "columns_within", "claimed"),
)
_OF_STEPS = "step_log_ratio", "step_share", "step_weight"


def select(audit: Audit, indices: Sequence[int], ids: Sequence[Hashable] | None = None) -> Audit:
    """The audit of the demonstrations at `indices` alone, in that order, as they were judged among all.

    `ids` are new names for them. What concerns all, as the finding and the share of experts, stays.
    """
    chosen = list(indices)
    steps = np.concatenate([np.arange(0), *(np.arange(audit.offsets[m], audit.offsets[m + 1]) for m in chosen)])
    _, first, place = np.unique(audit.copy_of[chosen], return_index=True, return_inverse=True)
    names = dict(zip((audit.ids[m] for m in chosen), ids or [audit.ids[m] for m in chosen], strict=True))

    def named(old: Sequence[Hashable]) -> tuple[Hashable, ...]:
        return tuple(names[name] for name in old if name in names)

    return replace(
        audit,
        own_reasons=tuple(audit.reasons[m] for m in chosen),
        ids=tuple(names.values()),
        offsets=np.concatenate([[0], np.cumsum(audit.lengths[chosen])]),
        **{name: getattr(audit, name)[chosen] for name in _OF_DEMONSTRATIONS},
        **{name: getattr(audit, name)[steps] for name in _OF_STEPS},
        verdicts=tuple(audit.verdicts[m] for m in chosen),
        competing=tuple(map(named, audit.competing)),
        pair=pair if len(pair := named(audit.pair)) == 2 else (),
        demonstrators=tuple(
            replace(who, demonstrations=own) for who in audit.demonstrators if (own := named(who.demonstrations))
        ),
        answers=audit.answers.select(chosen),
        max_unlike_of_parts=audit.max_unlike,
        copy_of=first[place],
        contradicting=named(audit.contradicting),
        sessions=tuple(audit.sessions[m] for m in chosen) if audit.sessions else (),
        order=None if audit.order is None else audit.order[chosen],
        traces={names[name]: own for name, own in audit.traces.items() if name in names},
        deviations=tuple(audit.deviations[m] for m in chosen) if audit.deviations else (),
    )
