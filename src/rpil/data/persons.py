"""Answers of persons: what is learned where they disagree, and how far any two of them agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Literal, NamedTuple, cast

from rpil.data.text import MAX_IDS, counted, listed, printable

Label = Literal["good", "bad"]
Relation = Literal["better than", "same as"]
Pairs = dict[tuple[str, str], Relation]
"""What the first demonstration is to the second, by their ids as text; of two that are the same the first is less."""

GivenAnswers = Mapping[str, tuple[dict[str, Label], Pairs]]
"""Labels and pairs by the name of the person who gave them, "" where none is known."""

Said = tuple[tuple[str, ...], str]
"""One demonstration and its label, or two and what the first is to the second."""


class AnswerRow(NamedTuple):
    """An answer as a row of a file of labels, whose columns but for the first two may be missing."""

    id: str
    label: object
    """A word, or what else a file has in its place."""
    note: str = ""
    tag: str = ""
    """Why, in a word or two."""
    by: str = ""
    """The name of the person who answered."""


def majority(given: GivenAnswers) -> tuple[dict[str, Label], Pairs]:
    """The answer of most persons to each question; none where as many give another one."""
    labels: dict[str, Label] = {}
    pairs: Pairs = {}
    for answers in _by_question(given).values():
        (ids, word), *ties = _most_said(answers)
        if len(ids) == 2 and not ties:
            pairs[ids[0], ids[1]] = cast(Relation, word)
        elif not ties:
            labels[ids[0]] = cast(Label, word)
    return labels, pairs


def agreement_lines(given: GivenAnswers) -> Iterator[str]:
    """How far two persons agree, one sentence for each two who answered the same, and where nothing is learned."""
    shared: dict[tuple[str, str], list[tuple[Said, Said]]] = {}
    for answers in _by_question(given).values():
        for two in combinations(sorted(answers), 2):
            shared.setdefault(two, []).append((answers[two[0]], answers[two[1]]))
    for two, both in list(shared.items())[:MAX_IDS]:
        names = " and ".join(printable(name) or "a person without a name" for name in two)
        yield f"{names} answered the same {counted(len(both), 'question')}, and agree on {_agreement(both)}."
    yield from tie_lines(given)


def tie_lines(given: GivenAnswers) -> Iterator[str]:
    """A sentence on the questions from whose answers nothing is learned, where there are any."""
    tied = [" or ".join(sorted(ids)) for ids, answers in _by_question(given).items() if len(_most_said(answers)) > 1]
    if tied:
        yield f"Nothing is learned from answers in which persons disagree: {listed(tied, MAX_IDS)}."


def _by_question(given: GivenAnswers) -> dict[frozenset[str], dict[str, Said]]:
    """What each person said, by the demonstrations that a question is about."""
    questions: dict[frozenset[str], dict[str, Said]] = {}
    for by, (labels, pairs) in given.items():
        said: list[Said] = [((m,), label) for m, label in labels.items()]
        for ids, word in [*said, *pairs.items()]:
            questions.setdefault(frozenset(ids), {})[by] = ids, word
    return questions


def _most_said(answers: Mapping[str, Said]) -> list[Said]:
    """The answer of most persons, or several that as many gave."""
    counts = Counter(answers.values())
    return [said for said, n in counts.items() if n == max(counts.values())]


def _agreement(both: Sequence[tuple[Said, Said]]) -> str:
    """How many answers of two persons are the same, their share, and Cohen's kappa unless chance alone makes all the
    same. Chance agrees in labels and in pairs, by the shares of each."""
    n, same, kinds = len(both), sum(one == other for one, other in both), Counter(len(one[0]) for one, _ in both)
    sorts = [[(len(ids), word, ids == (*sorted(ids),)) for ids, word in own] for own in zip(*both, strict=True)]
    first, second = map(Counter, sorts)
    by_chance = sum(first[sort] * second[sort] / kinds[sort[0]] for sort in first)
    kappa = f", Cohen's kappa {(same - by_chance) / (n - by_chance):.2f}" if by_chance < n else ""
    return f"{same:,} ({same / n:.0%}{kappa})"
