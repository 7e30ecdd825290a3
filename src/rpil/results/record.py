"""`Audit`: what a fit found out about demonstrations, with the pictures and tables that a notebook shows."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rpil.data.arrays import spans
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.text import DataFrame, data_frame
from rpil.results.answering import looking_order
from rpil.results.result import AuditResult, first_sentence, headline, verdict_sentence

if TYPE_CHECKING:
    from rpil.data.demonstrations import Demonstrations
    from rpil.formats.format import Dataset
    from rpil.results.choice import Choice
    from rpil.results.plots import AuditPlots
    from rpil.segments.ranges import Segments


@dataclass(frozen=True, eq=False, repr=False)
class Audit(AuditResult):
    """The result about the demonstrations: M of them, with N steps in all.

    `print` shows it in a few lines; `to_frame` has a row for each demonstration, and `plot` the pictures.

    Attributes
    ----------
    ids : tuple
        Ids of the demonstrations, in the order of the data.
    offsets : (M + 1,) int array
        Demonstration m has the steps ``offsets[m]:offsets[m + 1]``.
    finding : str
        One of `rpil.inference.findings.FINDINGS`.
    log_odds : (M,) array
        The score, log P - log(1 - P) with the probability that `vocabulary` names: larger for demonstrations that are
        more like the others, or better by the answers. It is the sum of the next two.
    from_actions, from_label : (M,) arrays
        Parts of the score: from its own actions, and from answers.
    expert_proba : (M,) array
        The probability that `vocabulary` explains: ``sigmoid(log_odds)`` with a verdict or a named adversary. For an
        open demonstration it stays within the limits of verdicts, or is 0.5 if the finding gives no verdicts.
    reliability : (M,) array
        Share of the steps of the demonstration whose actions the policy explains better than their frequencies do.
    verdicts : tuple of str
        The upper or the lower word of `vocabulary`, or "open" if the data do not decide.
    step_log_ratio : (N,) array
        ``log pi(a|s) - log psi(a|s)`` of each step, in nats.
    step_weight : (N,) array
        Weight of each step for training a policy (`rpil.results.step_weights`).
    prior : Interval
        Share of the upper group of the scores, or of the good demonstrations or experts.
    identifiable : bool
        False if two groups wait for an answer that says which one is good.
    competing : tuple of tuple of ids
        These two groups.
    pair : tuple of ids
        Two demonstrations to compare: the answer to "which is better?" would say most; empty if there are none.
    adversary : str
        Name of the adversary of the mixture, or of the reference of the judge.
    method, notes, doubts : tuple of str
        Sentences: how the audit judged, what else a user should know, and what speaks against verdicts by the
        answers.
    demonstrators : tuple of Demonstrator
        Once two answers contrast, the most trusted first; until then no trust. Empty if demonstrators were not given.
    answers : Answers
        The labels, pairs and outcomes that were given.
    contradicting : tuple of ids
        Demonstrations whose label contradicts the other answers.
    columns : (M, D) array
        Numbers that answers learn from, see `rpil.inference.answered`; (M, 0) if there are none.
    claimed : (M,) int array
        The claim without answers: -1 outlier, else 0. It stays until answers contrast.
    part : (M,) array
        1 in the part that the learner trusts, -1 in the other part; 1/2 and -1/2 if only answers can tell which part to
        trust; else 0 (`rpil.inference.two_parts`).
    copy_of : (M,) int array
        Index of the first of the copies of each demonstration, which may be itself.
    deviations, own_reasons, rejected_by : tuple of str
        How each demonstration acts in its worst steps, and how others act there (`rpil.results.summary`); its reason,
        if that compares it with demonstrations outside the audit; and the rule of
        `rpil.results.choice.KEEP_RULES` that rejects it. Each may be "", or the tuple empty.
    anchor : {"none", "answers", "named adversary"}
        The evidence of who is good; see `rpil.results.vocabulary`.
    sessions : tuple of str
        The session of each demonstration; empty if none are known.
    order : (M,) array or None
        The place of each demonstration in the order of recording, if that is stated.
    taken_over : (N,) array or None
        1 in steps in which a person had taken over, -1 in the steps just before, else 0; None if no column says so.
    settings : AuditSettings
        Settings by which verdicts and weights were given.
    fps : float or None
        Steps a second, if they are known: then sentences name seconds.
    within : str
        "tasks", "sessions" or both, if each of these was judged by itself; else empty.
    task_of : (M,) int array or None
        The number of the task or session of each demonstration, if several were judged; -1 if it was not judged.
    provenance : mapping or None
        How `rpil.audit` or a command made the audit, before any answers through `answered`.
    """

    @property
    def plot(self) -> AuditPlots:
        """Pictures: ``plot.ranking()``, ``plot.steps(id)`` and ``plot.sessions()``."""
        from rpil.results.plots import AuditPlots

        return AuditPlots(self)

    @property
    def choice(self) -> Choice:
        """The ids that ``rpil keep`` keeps, ``choice.kept``, and those that it rejects by each rule,
        ``choice.rejected``."""
        from rpil.results.choice import choose

        return choose(self.table())

    def ranges(
        self, dropped: ArrayLike | None = None, kept: Iterable[Hashable] | None = None
    ) -> dict[Hashable, list[tuple[int, int]]]:
        """Half-open ranges of the rows to keep in the demonstrations `kept`, by default those of `choice`. Rows that an
        answer calls bad, and `dropped` rows such as ``rpil.idle_rows(demonstrations)``, are not in them."""
        rows = ~self.answers.bad_rows(self.offsets)
        if dropped is not None:
            if np.shape(dropped) != rows.shape or np.asarray(dropped).dtype != bool:
                raise DataError(f"dropped must hold True or False for each of the {len(rows):,} steps of this audit.")
            rows &= ~np.asarray(dropped)
        names = self.choice.kept if kept is None else kept
        return {name: spans(rows[self.steps(self.index(name))]) for name in names}

    def segments(
        self, demonstrations: Demonstrations | Dataset, tasks: Mapping[str, str] = MappingProxyType({})
    ) -> Segments:
        """Segments of its `demonstrations`: acts, idle rows, takeovers, with scores and reasons. Each is compared with
        those of the same task, given by ids as text."""
        from rpil.segments.find import find_segments
        from rpil.segments.ranges import joined

        if demonstrations.ids != self.ids or not np.array_equal(demonstrations.offsets, self.offsets):
            raise DataError(f"{demonstrations.source}: these are not the demonstrations of the audit; give those.")
        group, parts = np.unique([tasks.get(str(name), "") for name in self.ids], return_inverse=True)[1], []
        for own in (np.flatnonzero(group == k).tolist() for k in range(group.max() + 1)):
            steps = np.concatenate([np.arange(self.offsets[m], self.offsets[m + 1]) for m in own])
            marks = [(m, first, last, sign > 0) for m, first, last, sign in self.answers.select(own).marks.tolist()]
            ratio = self.step_log_ratio[steps] if len(self.step_log_ratio) else None
            taken = None if self.taken_over is None else self.taken_over[steps] > 0
            found = find_segments(demonstrations.select(own), ratio, taken, marks)
            parts.append(replace(found, demonstration=np.array(own)[found.demonstration]))
        return joined(parts)

    def to_frame(self) -> DataFrame:
        """A data frame with a row for each demonstration, in the order of looking: the first to look at first.

        The columns are those that ``rpil audit --verdicts`` writes, as far as an audit knows them. It is a frame of
        pandas, or where that is not installed a table of pyarrow.
        """
        columns, order = self.table(), looking_order(self)[0]
        for name in ("faults", "task", "run", *["demonstrator"] * (not self.demonstrators)):
            del columns[name]  # an audit does not know these
        return data_frame({name: [column[m] for m in order] for name, column in columns.items()})

    def to_html(self, path: StrPath, title: str = "Audit of demonstrations") -> None:
        """Write the report of ``rpil audit --report`` to a file: one page, which needs no network.

        The report has no recording faults, because an audit does not know them.

        Raises
        ------
        DataError
            If the path cannot be written.
        """
        from rpil.results.html.page import About, write_page

        write_page(path, self, About(title, "in memory"))

    def __repr__(self) -> str:
        doubts = [f"Doubt: {doubt}" for doubt in self.doubts]
        lines = first_sentence(self), headline(self), *doubts, verdict_sentence(self), self.question
        return "\n".join(filter(None, lines))
