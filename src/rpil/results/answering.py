"""Answers to an audit: what they change, and what to ask next. No policy is fitted again."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, compress
from typing import Any, TypeVar, get_args

import numpy as np
from scipy.special import expit

from rpil.data.errors import DataError
from rpil.data.fit_data import Demonstrators
from rpil.data.id_values import Relation, check_ids, label_rows, label_signs, match_pairs, parse_answers, parse_marks
from rpil.data.text import counted, printable
from rpil.inference.answered import Answered, answer, places_to_ask
from rpil.inference.answers import Answers, check_copied_labels
from rpil.inference.findings import DECIDED
from rpil.inference.groups import expert_share_interval
from rpil.numerics.types import Array, Float, Int
from rpil.results.judged import Demonstrator, Interval, Judged, failures
from rpil.results.reasons import NEARLY_ALL, TWO_GROUPS, span, worst_stretch
from rpil.results.step_weights import weights_of
from rpil.results.vocabulary import SIDES, VOCABULARIES, Verdict

Id = TypeVar("Id", bound=Hashable)

MIN_FIRST = 5
"""Demonstrations to look at first, at least."""

MIN_OF_NOTHING = 8
NOTHING_FOLLOWED = (
    "The answers do not predict each other by any measured fact, so that no other demonstration gets a verdict; check "
    "some of the answers, or answer about further ones."
)
"""The answers from which this is said, and the sentence."""

_UNTIL_DECIDED = (TWO_GROUPS, "two labels", "All outliers are of one operator")  # in notes that hold until then

A = TypeVar("A", bound=Judged)


def with_answers(audit: A, known: Answers) -> A:
    """The audit with all answers that are `known`; see `Audit.answered`."""
    if not audit.columns.size:
        raise DataError("This audit keeps nothing to learn from answers; give the labels to fit().")
    check_copied_labels(known, audit.copy_of, audit.ids)
    if twice := {*known.names} & {f"-{name}" for name in known.names}:
        raise DataError(f"The outcome {min(twice)[1:]!r} is given with and without a minus; leave one of them out.")
    if not known.once(audit.copy_of).count:
        if not len(known.marks) and not len(audit.answers.marks):
            return audit
        audit = replace(audit, answers=replace(audit.answers, marks=known.marks))
        return replace(audit, step_weight=weights_of(audit))
    named = {name: one.name for one in audit.demonstrators for name in one.demonstrations}
    who = Demonstrators.from_names([named.get(name) for name in audit.ids]) if named else Demonstrators()
    found = answer(audit.columns, known, audit.settings.judge.answers, audit.copy_of, who, audit.task_of)
    known, log_odds, verdicts = replace(known, heard=found.witnesses.heard), found.log_odds, found.verdicts
    is_decided = known.once(audit.copy_of).contrast  # until then those that were outliers without answers stay so
    is_told = is_decided and _is_told_of_groups(audit, known)
    stays = np.where(verdicts == 0, audit.claimed, 0) * (not is_decided)
    answered = replace(
        audit,
        finding="answered",
        anchor="answers",
        log_odds=log_odds,
        from_label=log_odds - audit.from_actions,
        expert_proba=shown_proba(log_odds, verdicts, "answered", audit.settings.min_proba("answers")),
        verdicts=verdicts_of(verdicts, "answers", stays),
        prior=Interval(*expert_share_interval(expit(log_odds), 1.0)),
        identifiable=audit.identifiable or is_told,
        competing=() if is_told else audit.competing,
        demonstrators=rank_demonstrators(who, audit.ids, expit(log_odds) if is_decided else None),
        answers=known,
        own_reasons=(),
        contradicting=tuple(audit.ids[m] for m in found.contradicting.tolist()),
        doubts=tuple(doubts_of_answers(found, known.shared(audit.copy_of), is_decided)),
        notes=tuple(note for note in audit.notes if not (is_told and any(said in note for said in _UNTIL_DECIDED))),
    )
    return replace(answered, step_weight=weights_of(answered), rejected_by=rejecting_rules(answered))


def _is_told_of_groups(audit: Judged, known: Answers) -> bool:
    """Whether the answers contrast in the task whose groups compete, if there is one."""
    if audit.task_of is None or not audit.competing:
        return True
    rows = np.flatnonzero(audit.task_of == audit.task_of[audit.index(audit.competing[0][0])])
    return known.select(rows.tolist()).contrast


def rejecting_rules(audit: Judged) -> tuple[str, ...]:
    """The rule of `rpil.results.choice.KEEP_RULES` that rejects each demonstration, or nothing.

    What is inferred rejects once answers contrast: those that are bad, and of an answered pair the worse one unless the
    other answers speak for it.
    """
    known, verdicts, first = audit.answers.shared(audit.copy_of), np.array(audit.verdicts), audit.copy_of
    worse = np.isin(first, first[known.pairs[:, 1]]) & (audit.log_odds <= 0)
    is_bad = ((verdicts == "bad") | worse) & audit.answers.once(first).contrast
    rules = {"": known.labels > 0, "outcome": known.failed(audit.log_odds), "labels": known.labels < 0}
    rules |= {"adversary": verdicts == "adversary", "answers": is_bad}
    return tuple(np.select([*rules.values()], [*rules], "").tolist())


def merged(audit: Judged, labels: Mapping[Id, str] | None, pairs: Collection[tuple[Id, Id]]) -> Answers:
    """The answers of an audit and these; a new label replaces an old one."""
    known = audit.answers
    rows = label_rows(labels)
    texts, more = parse_answers(rows, "the labels")
    check_ids([*(row.id for row in rows), *chain.from_iterable(more)], audit.ids, "the labels", "the labels")
    marks = parse_marks(rows, "the labels", audit.ids, audit.lengths)
    for m, start, end, sign in known.marks.tolist():  # a new answer about the same rows stands in place of an old one
        new = marks[(marks[:, 0] == m) & (marks[:, 1] < end) & (marks[:, 2] > start)]
        if (new[:, 1:3] == (start, end)).all(axis=1).any():
            continue
        if (new[:, 3] != sign).any():
            said = f"rows {start} to {end} of {audit.ids[m]!r} have the other label"
            raise DataError(f"the labels: {said}; give the same rows again to change it.")
        marks = np.concatenate([marks, [[m, start, end, sign]]])
    new = label_signs(texts, audit.ids)
    signs = np.where(new == 0, known.labels, new)
    old: list[tuple[Relation, Array]] = [("better than", known.pairs), ("same as", known.tied)]
    before = [((audit.ids[a], audit.ids[b]), relation) for relation, of_it in old for a, b in of_it.tolist()]
    told = [*pairs.items()] if isinstance(pairs, Mapping) else [(pair, "better than") for pair in pairs]
    given: list[Any] = [([*pair] if isinstance(pair, tuple | list | np.ndarray) else [], word) for pair, word in told]
    if not all(len(pair) == 2 and word in get_args(Relation) for pair, word in given):
        way = "the better one first, as [(3, 8)], or a mapping of these to 'better than' or 'same as'"
        raise DataError(f"the pairs must be two ids each, {way}.")
    compared, tied = match_pairs([*before, *more.items(), *given], audit.ids)
    return replace(known, labels=signs, pairs=compared, tied=tied, heard=None, marks=marks)


def shown_proba(
    log_odds: Float[Array, " M"], verdicts: Int[Array, " M"], finding: str, min_proba: float
) -> Float[Array, " M"]:
    """P of each demonstration, which claims no more than the verdicts: 1/2 where the `finding` gives none; where the
    demonstration has none (0), strictly between 1 - `min_proba` and `min_proba`, from which there are verdicts."""
    if finding not in DECIDED:
        return np.full(len(log_odds), 0.5)
    proba = expit(log_odds)
    bounded = np.clip(proba, np.nextafter(1 - min_proba, 1), np.nextafter(min_proba, 0))
    return np.asarray(np.where(verdicts == 0, bounded, proba))


def verdicts_of(verdicts: Int[Array, " M"], anchor: str, stays: Int[Array, " M"] | int = 0) -> tuple[Verdict, ...]:
    """The signs 1, 0 and -1 as verdicts of an anchor; where they are 0, those of no anchor for what `stays`."""
    said, unsaid = VOCABULARIES[anchor], VOCABULARIES["none"]
    texts: dict[int, Verdict] = {2: said.upper, 0: "open", -1: unsaid.lower, -2: said.lower}
    return tuple(texts[sign] for sign in np.where(verdicts == 0, stays, 2 * verdicts).tolist())


def doubts_of_answers(found: Answered, known: Answers, contrast: bool) -> Iterator[str]:
    """Sentences that speak against verdicts by these answers, also on outcomes that the others do not bear out."""
    if found.count == 1:
        yield "One answer alone does not make other demonstrations good or bad; give a second one."
        return
    if found.count >= MIN_OF_NOTHING and contrast and not found.follows:
        yield NOTHING_FOLLOWED
    witnesses = found.witnesses
    for k, (name, confirmed, sign) in enumerate(zip(known.names, witnesses.confirmed, witnesses.sign, strict=False)):
        outcome = "outcome" + f" {printable(name)}" * (name != "outcome")
        if confirmed < 0.5:
            most = "its own failures alone" if k == known.only_flag and known.failed(found.log_odds).any() else "little"
            yield f"No answer and no other outcome confirms the {outcome}, so it counts for {most}."
        elif sign < 0:
            yield f"The {outcome} contradicts what else is known: less of it counts as better."
        free = (known.labels == 0) & (found.log_odds > 0) & (sign > 0)
        if k == known.only_flag and (n := int((known.outcomes[free, k] == 0).sum())):
            yield f"What else is known outweighs {known.failure} of {counted(n, 'demonstration')}."


def question(audit: Judged) -> str | None:
    """The question whose answer would say most, with where to look; None after an answer, or if scores are alike."""
    if audit.anchor != "none" or audit.answers.count or len(audit.pair) != 2:
        return None
    return question_sentence(audit, audit.pair)


def question_sentence(audit: Judged, names: Sequence[Hashable]) -> str:
    """The question about one or two demonstrations, with where to look; never what the audit thinks of them."""
    where = " or ".join(where_to_look(audit, name) for name in names)
    return f"Which is better: {where}?" if len(names) == 2 else f"Is it good or bad: {where}?"


def where_to_look(audit: Judged, name: Hashable) -> str:
    """The demonstration, with its worst stretch unless that is nearly all of it."""
    m = audit.index(name)
    stretch = worst_stretch(audit.log_ratio(m))
    if stretch is None or stretch[1] + 1 - stretch[0] >= NEARLY_ALL * audit.lengths[m]:
        return printable(name)
    return f"{printable(name)} (look {span(stretch[0], stretch[1], audit.fps)})"


def looking_order(audit: Judged) -> tuple[list[int], int]:
    """All demonstrations, those that are most worth a look first, and how many to look at first.

    These are those whose label contradicts the other answers, outliers or bad ones, and a group apart. Then come the
    open ones, and the rest; the lowest log-odds first.
    """
    lowest = np.argsort(-audit.log_odds, kind="stable")[::-1].tolist()
    of_side = {side: [m for m in lowest if SIDES[audit.verdicts[m]] == side] for side in ("lower", "open", "upper")}
    apart = {*audit.competing[1]} if audit.finding == "a group apart" else ()
    alike = [m for m in lowest if audit.ids[m] in apart]
    urgent = dict.fromkeys([*map(audit.index, audit.contradicting), *of_side["lower"], *alike])
    order = list(dict.fromkeys([*urgent, *of_side["open"], *of_side["upper"]]))
    return order, max(len(urgent), min(n_first(len(order)), len(order)))


def n_first(n_demonstrations: int) -> int:
    """How many demonstrations to look at first: a tenth, five at least."""
    return max(MIN_FIRST, n_demonstrations // 10)


def suggest_labels(audit: Judged, k: int = 3) -> tuple[Hashable, ...]:
    """Ids of up to `k` demonstrations without a label whose labels would say most, the best first; none is a copy of
    one that is labelled, or of another one among them. A `DataError` if `k` is not positive.
    """
    if k < 1:
        raise DataError(f"k={k!r} labels cannot be suggested; ask for one at least.")
    first = np.unique(audit.copy_of, return_index=True)[1]
    known, settings = audit.answers.once(audit.copy_of), audit.settings.judge.answers
    ranking, log_odds = audit.from_actions[first], audit.log_odds[first]
    chosen = places_to_ask(ranking, log_odds, known.labels, (known.labels != 0) | failures(audit)[first], settings, k)
    return tuple(audit.ids[m] for m in first[chosen].tolist())


def rank_demonstrators(
    demonstrators: Demonstrators, ids: Sequence[Hashable], proba: Float[Array, " M"] | None = None
) -> tuple[Demonstrator, ...]:
    """The demonstrators with a name; with P(good) of each demonstration, their trust is the share of good ones, and the
    most trusted is the first."""
    if not demonstrators.informative:
        return ()
    members = [demonstrators.index == u for u in range(len(demonstrators.names))]
    trust = [None if proba is None else Interval(*expert_share_interval(proba[own], 1.0)) for own in members]
    theirs = (tuple(compress(ids, own)) for own in members)
    named = (who for who in map(Demonstrator, demonstrators.names, trust, theirs) if who.name is not None)
    return tuple(sorted(named, key=lambda who: -who.trust.mean if who.trust else 0.0))
