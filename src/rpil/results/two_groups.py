"""How two groups that each have a policy of their own differ, in words; nothing of it says which one is good."""

from __future__ import annotations

from collections.abc import Iterator

from rpil.data.fit_data import FitData
from rpil.data.spaces import Discrete
from rpil.data.text import listed, printable
from rpil.inference.channels import CHANNELS
from rpil.inference.rivals import Contrast
from rpil.numerics.types import Array, Float, Int
from rpil.results.facts import RANKS

TWO_GROUPS = "The two groups: "
"""How the sentences begin."""

MAX_P = 0.01
"""Probability of so different facts by chance (Mann and Whitney 1947), up to which a difference is named."""
MIN_SEPARATION = 0.8
"""Share of the pairs of a demonstration of each group that differ in this direction, from which it is named."""
MIN_PART_SHARE = 0.2
"""Share of the evidence from which a part of the action is named; the largest always is."""
MIN_APART = 0.5
"""Difference of the medians of a part, in its spread within the groups, from which they are named."""

SAID_OF_B = {
    "length": ("takes longer", "is shorter"),
    "pauses": ("pauses more", "pauses less"),
    "smoothness": ("is smoother", "is less smooth"),
    "path": ("has a longer path", "has a shorter path"),
}
"""What is said of group B where the fact is larger, and where it is smaller, than in group A."""


def groups_differ(
    groups: tuple[Int[Array, " A"], Int[Array, " B"]],
    columns: Float[Array, "M D"],
    contrast: Contrast | None,
    data: FitData,
) -> tuple[str, ...]:
    """Up to two sentences about the groups A and B: facts, and parts of the action; `columns` as in an audit."""
    if contrast is None:
        return ()
    facts = list(_facts(groups, columns, contrast))
    found = f"B {listed(facts)}" if facts else "in length, pauses, smoothness and path they hardly differ"
    parts = list(_parts(contrast, data))
    what = "where they take action" if isinstance(data.space, Discrete) else f"in part{'s' * (len(parts) > 1)}"
    whose = "" if isinstance(data.space, Discrete) else " of the action"
    policies = (f"{TWO_GROUPS}they differ most {what} {listed(parts)}{whose}.",) if parts else ()
    return (f"{TWO_GROUPS}{found}.", *policies)


def _facts(groups: tuple[Array, Array], columns: Array, contrast: Contrast) -> Iterator[str]:
    """What is said of group B by the facts in which it clearly differs from group A."""
    from scipy.stats import mannwhitneyu  # takes as long to import as all else

    first, second = groups
    for name, (channel, sign) in RANKS.items():
        values = sign * columns[:, CHANNELS.index(channel)]
        test = mannwhitneyu(values[second], values[first])
        above = test.statistic / (len(first) * len(second))
        if test.pvalue <= MAX_P and max(above, 1 - above) >= MIN_SEPARATION:
            steps = f" (median {contrast.length[1]:,.0f} against {contrast.length[0]:,.0f} steps)"
            yield SAID_OF_B[name][int(above < 0.5)] + steps * (name == "length")


def _parts(contrast: Contrast, data: FitData) -> Iterator[str]:
    """The parts of the action with most of the evidence, and what either group does there."""
    for k, (j, share) in enumerate(contrast.parts):
        if k and share < MIN_PART_SHARE:
            return
        first, second = contrast.use[:, j].tolist()
        name = printable(data.action_name(j))
        if isinstance(data.space, Discrete):
            yield f"{name} ({share:.0%} of the evidence; {first:.0%} of the steps of A, {second:.0%} of B)"
        else:
            apart = abs(second - first) > MIN_APART * contrast.spread[j]
            how = f"median {first:.3g} in A, {second:.3g} in B" if apart else "in how it follows the state"
            yield f"{name} ({share:.0%} of the evidence; {how})"
