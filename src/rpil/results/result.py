"""Content of an audit: the ranking of the demonstrations, their verdicts, the weights of their steps, what was assumed.

Pictures and tables read it from here; `rpil.results.record.Audit` is what users get.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Self

import numpy as np
from scipy.special import expit

from rpil.data.copies import run_id
from rpil.data.errors import DataError
from rpil.data.text import MAX_IDS, counted, listed
from rpil.inference.findings import FINDINGS
from rpil.numerics.types import Array, Float, Int
from rpil.results import answering
from rpil.results.answering import Id, looking_order, n_first
from rpil.results.judged import Judged, failures
from rpil.results.reasons import Fact, known_facts, reasons_of, worst_steps, worst_stretch
from rpil.results.vocabulary import SIDES, WORSE, in_numbers, numbered, short_id

if TYPE_CHECKING:
    from rpil.faults.rule import Fault

WHOLE = "A demonstration is good or bad as a whole, and a label is certain."
"""The assumption of the paper's mixture."""

MAX_NAMED_FIRST = 12
"""Demonstrations to look at first that a sentence names."""

ACTING = {"outliers": "differently from the rest", "mixture": "like the adversary that was named"}

NEAR = 9
"""Steps around a step, and this itself, by which the page draws whether it is like those of the trusted."""


@dataclass(frozen=True, eq=False, repr=False)
class AuditResult(Judged):
    """The fields of an audit, and what follows from them."""

    @property
    def evidence(self) -> dict[str, Float[Array, " M"]]:
        """The parts of `log_odds` by name, in nats."""
        return {"actions": self.from_actions, "label": self.from_label}

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """The reason for the verdict on each demonstration, one sentence each."""
        return self.own_reasons or tuple(reasons_of(self, self.answers.shared(self.copy_of), self.said))

    @property
    def labels(self) -> tuple[str, ...]:
        """The label of each demonstration; copies share theirs."""
        texts = {1: "good", 0: "", -1: "bad"}
        return tuple(texts[label] for label in self.answers.shared(self.copy_of).labels.tolist())

    @property
    def said(self) -> tuple[str, ...]:
        """Answers about each demonstration besides its label: how it failed, or which other one is better."""
        first = self.copy_of.tolist()
        worse = {first[m]: f"{WORSE}{self.ids[better]}" for better, m in self.answers.pairs.tolist()}
        how = [self.answers.failure if is_failed else "" for is_failed in failures(self)]
        return tuple(own or worse.get(m, "") for own, m in zip(how, first, strict=True))

    @property
    def groups(self) -> dict[str, tuple[Hashable, ...]]:
        """The `competing` groups by their names, A and B."""
        return dict(zip("AB", self.competing, strict=False))

    def verdict_counts(self, ids: Sequence[Hashable] | None = None) -> dict[str, int]:
        """The number of demonstrations with each verdict: of all, or of those called `ids`."""
        verdict_of: dict[Hashable, str] = dict(zip(self.ids, self.verdicts, strict=True))
        verdicts = [verdict_of[name] for name in (self.ids if ids is None else ids)]
        own = (self.vocabulary.upper, "open", self.vocabulary.lower)
        # Where tasks are judged by themselves, some may have an anchor and others none.
        return {one: verdicts.count(one) for one in SIDES if one in own or one in self.verdicts}

    def ranking(self) -> Int[Array, " M"]:
        """Indices of the demonstrations, the most trusted first."""
        return np.argsort(-self.log_odds, kind="stable")

    @cached_property
    def ranks(self) -> Int[Array, " M"]:
        """The place of each demonstration in the ranking, from 1, the most trusted, on."""
        return np.argsort(self.ranking()) + 1

    @cached_property
    def facts(self) -> dict[str, tuple[Fact, ...]]:
        """Facts about each demonstration by name, which change no verdict: `rpil.results.reasons.known_facts`, and the
        fields that are shown."""
        shown = {one.metadata["shown"]: getattr(self, one.name) for one in fields(self) if one.metadata.get("shown")}
        columns = {name: tuple(np.asarray(column).tolist()) for name, column in shown.items() if len(column)}
        return known_facts(self.columns, self.order) | columns

    question = property(answering.question)
    suggest_labels = answering.suggest_labels

    def answered(
        self, labels: Mapping[Id, str] | None = None, pairs: Collection[tuple[Id, Id]] = (), instead: bool = False
    ) -> Self:
        """Add answers to those of the audit, and return the new audit; no policy is fitted again.

        Parameters
        ----------
        labels : mapping of id to {"good", "bad", "better than ID", "same as ID"}
            A key (id, start, end) is about rows, from the first to the one before `end`: good or bad.
        pairs : sequence of (id, id), or mapping of them to {"better than", "same as"}
            The better and the worse of two demonstrations, or a word for what the first is to the second.
        instead : bool
            Whether these answers replace the labels and pairs that the audit has.

        Raises
        ------
        DataError
            If an id or a label is unknown, answers contradict each other, or none is left.
        """
        known = answering.merged(replace(self, answers=self.answers.unsaid) if instead else self, labels, pairs)
        if not known.count and self.anchor == "answers":
            way = "take the audit before answered(), or call rpil.audit without any"
            raise DataError(f"No answer would be left; {way}.")
        return answering.with_answers(self, known)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Sentences: how it was judged, the finding, what the probability means, and from what it is learned."""
        known, learned = self.answers.once(self.copy_of), "Lengths and rewards were not used."
        if self.anchor == "answers":
            counts = np.count_nonzero(known.labels), len(known.compared), np.isfinite(known.outcomes).sum()
            given = ", ".join(counted(n, m) for n, m in zip(counts, ("label", "pair", "outcome"), strict=True) if n)
            learned = f"P(good) is learned from {given or 'no answers'}, each of which may be wrong."
        whole = [WHOLE] * (self.anchor == "named adversary")
        return *self.method, FINDINGS[self.finding], self.vocabulary.explanation, learned, *whole

    def worst_steps(self, demonstration: Hashable, k: int = 5) -> list[int]:
        """Up to `k` steps with the lowest log-ratios below 0 of the demonstration with this id, counted from 0."""
        return worst_steps(self.step_log_ratio[self.steps(self.index(demonstration))], k)

    def step_trust(self, index: int) -> Float[Array, " n"]:
        """P(the `NEAR` steps around each step of demonstration `index` are like those of the trusted), all alike."""
        return np.asarray(expit(np.convolve(self.log_ratio(index), np.ones(NEAR))[NEAR // 2 :][: self.lengths[index]]))

    @property
    def run_id(self) -> str:
        """Id that the report, the JSON and the weights of one run have in common; see `rpil.data.copies.run_id`."""
        return run_id(self.ids, self.offsets, self.log_odds)

    def table(
        self,
        demonstrators: Mapping[str, str] | None = None,
        tasks: Mapping[str, str] = MappingProxyType({}),
        faults: Sequence[Fault] = (),
    ) -> dict[str, Sequence[object]]:
        """The columns of every table, of the JSON and of the page, with a row for each demonstration.

        `demonstrators`, by default those of the audit, and `tasks` are by ids as text; `faults` are the findings of
        ``rpil check``, the worst first.
        """
        if demonstrators is None:
            demonstrators = {str(name): str(one.name) for one in self.demonstrators for name in one.demonstrations}
        names, rules = [*map(str, self.ids)], defaultdict[str, list[str]](list)
        for found in faults:
            rules[str(found.id)].append(found.rule)
        return {
            "id": self.ids,
            "verdict": self.verdicts,
            "label": self.labels,
            "said": self.said,
            "rejected_by": self.rejected_by or ("",) * len(names),
            "rank": self.ranks.tolist(),
            "look": (np.argsort(answering.looking_order(self)[0]) + 1).tolist(),
            "expert_proba": self.expert_proba.tolist(),
            "log_odds": self.log_odds.tolist(),
            "n_steps": self.lengths.tolist(),
            **{f"from_{part}": values.tolist() for part, values in self.evidence.items()},
            "reliability": self.reliability.tolist(),
            "demonstrator": [demonstrators.get(name, "") for name in names],
            "task": [tasks.get(name, "") for name in names],
            **{f"fact_{name.replace(' ', '_')}": values for name, values in self.facts.items()},
            "faults": [", ".join(rules[name]) for name in names],
            "reason": self.reasons,
            "run": [self.run_id] * len(names),
        }

    def to_dict(self) -> dict[str, object]:
        """The audit as numbers, text, lists and dicts, as ``rpil audit --format json`` prints it; the first to look at
        first."""
        nested = ("from_", "fact_", "demonstrator", "task", "faults", "run")  # or not known to an audit
        columns, asked = {name: own for name, own in self.table().items() if not name.startswith(nested)}, None
        if self.question:
            stretches = [worst_stretch(self.log_ratio(self.index(name))) for name in self.pair]
            look_at = [stretch and [*stretch] for stretch in stretches]
            asked = {"pair": list(self.pair), "look_at": look_at, "text": self.question}
        return {
            "n_demonstrations": len(self.ids),
            "n_steps": int(self.offsets[-1]),
            "finding": self.finding,
            "anchor": self.anchor,
            "adversary": self.adversary,
            "prior": asdict(self.prior),
            "identifiable": self.identifiable,
            "groups": [list(group) for group in self.competing],
            "pair": list(self.pair),
            "question": asked,
            "doubts": list(self.doubts),
            "notes": list(self.notes),
            "contradicting": list(self.contradicting),
            "assumptions": list(self.assumptions),
            "demonstrations": [
                {
                    **{name: column[m] for name, column in columns.items()},
                    "evidence": {name: float(part[m]) for name, part in self.evidence.items()},
                    "worst_steps": worst_steps(self.step_log_ratio[self.steps(m)]),
                    "facts": {name: values[m] for name, values in self.facts.items()},
                }
                for m in answering.looking_order(self)[0]
            ],
            "demonstrators": [
                {"name": who.name, "trust": asdict(who.trust) if who.trust else None}
                | {"n_demonstrations": len(who.demonstrations), "verdicts": self.verdict_counts(who.demonstrations)}
                for who in self.demonstrators
            ],
            **({"provenance": deepcopy(self.provenance)} if self.provenance else {}),
        }


def look_first(audit: AuditResult, faulty: Collection[Hashable] = ()) -> list[int]:
    """Demonstrations without a label to look at first: the `faulty` ones, then the first in the order of looking."""
    at, order = {name: m for m, name in enumerate(audit.ids)}, looking_order(audit)[0]
    known = {*np.flatnonzero((np.array(audit.labels) != "") | failures(audit)).tolist()}
    first = dict.fromkeys(m for m in (*(at[name] for name in faulty if name in at), *order) if m not in known)
    return [*first][: n_first(len(audit.ids))]


def first_sentence(audit: AuditResult, faulty: Collection[Hashable] = ()) -> str:
    """Which demonstrations to look at first, without those that have a label."""
    if not (first := look_first(audit, faulty)):
        return "Every demonstration has a label."
    names = listed([short_id(audit.ids[m]) for m in first], MAX_NAMED_FIRST, ", ")
    return f"Look at {'these' if len(first) > 1 else 'this'} {len(first):,} first: {names}."


def headline(audit: AuditResult, most: int = MAX_IDS) -> str:
    """The finding in one sentence, with numbers and up to `most` names, the lowest score first; 0 for none."""
    counts, ranked = audit.verdict_counts(), audit.ranking()[::-1].tolist()
    below = [one for one, size in counts.items() if size and SIDES[one] == "lower"]
    lists = ([short_id(audit.ids[m]) for m in ranked if audit.verdicts[m] == one] for one in below)
    names = {one: listed(own, most, ", ") for one, own in zip(below, lists, strict=True) if most}
    if audit.finding == "answered":
        sizes = ((one, size) for one, size in counts.items() if size and one != "outlier")
        said = (numbered(size, one) + f" ({names.get(one)})" * (one in names) for one, size in sizes)
        return f"By {audit.told}: {', '.join(said)}."
    if audit.finding in ACTING and below:
        n = counts[below[0]]
        some = f"{n:,} of {len(audit.ids):,} act{'s' * (n == 1)} {ACTING[audit.finding]}"
        return f"{some}: {names[below[0]]}." if names else f"{some}."
    sentence, n = FINDINGS[audit.finding], sum(map(len, audit.groups.values()))
    where = f" in one of the {audit.within}" * bool(audit.within and n < len(audit.ids))
    if audit.finding == "a group apart" and audit.groups:
        alike = {*audit.groups["B"]}
        own = [short_id(audit.ids[m]) for m in ranked if audit.ids[m] in alike]
        who = f"{len(own):,} of {n:,}{where} act alike, and differ from the rest"
        members = f" ({listed(own, most, ', ')})" if most else ""
        return f"{who}{members}; {sentence.partition('; ')[2]}"
    if audit.finding == "two groups" and audit.groups:
        both = " and ".join(f"{len(ids):,}" for ids in audit.groups.values())
        return f"Two groups act differently{where}: {both}{sentence.removeprefix('Two groups act differently')}"
    if audit.finding != "nothing could be learned":
        return sentence
    return f"{audit.finding.capitalize()}: {sentence[:1].lower()}{sentence[1:]}"


def verdict_sentence(audit: AuditResult) -> str:
    """How many demonstrations have which verdict."""
    size = f"{counted(len(audit.ids), 'demonstration')} ({audit.offsets[-1]:,} steps)"
    return f"{size}: {in_numbers(audit.verdict_counts())}."
