"""Pictures of an audit, as scikit-learn Display objects.

A Display holds the data of one picture; ``plot`` draws it and keeps the axes in ``ax_`` and the figure in ``figure_``,
so that either can be changed afterwards. Matplotlib is imported when something is drawn, not before.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from rpil.data.errors import DataError
from rpil.data.text import printable
from rpil.numerics.types import Array, Float
from rpil.results.traces import bin_starts
from rpil.results.words import SIDES, Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from rpil.results.result import AuditResult


# The palette of Okabe and Ito, which readers with any of the common colour deficiencies can distinguish.
COLOURS: dict[Side, str] = {"upper": "#0072b2", "open": "#7f8790", "lower": "#d55e00"}
MAX_NAMED_ROWS = 40
MAX_NAMED_SESSIONS = 12


def running_mean(values: Float[Array, " N"], window: int | None = None) -> Float[Array, " N"]:
    """Centred running mean, over fewer values at both ends; by default over a twentieth of the values."""
    width = max(window or len(values) // 20, 1)
    totals = np.concatenate([[0.0], np.cumsum(values)])
    centre = np.arange(len(values))
    start, stop = np.maximum(centre - (width - 1) // 2, 0), np.minimum(centre + width // 2 + 1, len(values))
    return np.asarray((totals[stop] - totals[start]) / (stop - start))


def _add_legend(ax: Axes) -> None:
    # Above the axes, so that nothing is covered.
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=6, frameon=False, handletextpad=0.2)


@dataclass(eq=False)
class _AuditDisplay(ABC):
    """A picture of an audit, on the axes of the caller or on new ones."""

    audit: AuditResult = field(repr=False)
    ax_: Axes = field(init=False, repr=False)
    figure_: Figure | SubFigure = field(init=False, repr=False)

    @abstractmethod
    def plot(self, *args: Any, **options: Any) -> Self:
        """Draw the picture."""

    @classmethod
    def from_audit(cls, audit: AuditResult, *, ax: Axes | None = None, **options: Any) -> Self:
        """Draw the picture from an `Audit`; `options` are those of ``plot``."""
        return cls(audit).plot(ax, **options)

    def _prepare_axes(self, ax: Axes | None, size: tuple[float, float] = (6.4, 3.6)) -> Axes:
        if ax is None:
            import matplotlib.pyplot as plt

            _, ax = plt.subplots(figsize=size, layout="constrained")
        ax.spines[["top", "right"]].set_visible(False)
        self.ax_, self.figure_ = ax, ax.figure
        return ax


class RankingDisplay(_AuditDisplay):
    """Every demonstration, the most trusted at the top, coloured by its verdict."""

    def plot(self, ax: Axes | None = None, *, quantity: Literal["reliability", "log_odds"] = "reliability") -> Self:
        """Draw the reliability with its 95 % interval, or the log-odds."""
        if quantity not in ("reliability", "log_odds"):
            raise ValueError(f"quantity is 'reliability' or 'log_odds', not {quantity!r}.")
        audit, order = self.audit, self.audit.ranking()
        size, has_names = len(order), len(order) <= MAX_NAMED_ROWS
        ax = self._prepare_axes(ax, (6.4, 1.2 + 0.2 * min(size, MAX_NAMED_ROWS)))
        rows, verdicts = np.arange(size), np.array(audit.verdicts)[order]
        values, intervals = getattr(audit, quantity)[order], audit.reliability_interval[order]
        # Infinite log-odds are drawn beyond all others.
        bound = 2 * np.abs(values[np.isfinite(values)]).max(initial=1)
        values = values.clip(-bound, bound)
        for verdict in audit.verdict_counts():
            mask, colour = verdicts == verdict, COLOURS[SIDES[verdict]]
            if quantity == "reliability":
                ax.hlines(rows[mask], *intervals[mask].T, color=colour, alpha=0.4, linewidth=2)
            if mask.any():
                ax.plot(values[mask], rows[mask], "o", color=colour, markersize=4.5, label=f"{verdict} ({mask.sum()})")
        if quantity == "reliability":
            ax.set(xlim=(-0.02, 1.02), xlabel=f"Reliability (share of {audit.words.upper} steps, 95 % interval)")
        else:
            # Log-odds grow with the number of steps: some are hundreds of nats, others near 0.
            ax.set_xscale("symlog", linthresh=10)
            ax.axvline(0, color=COLOURS["open"], linewidth=0.8)
            words = audit.words
            ax.set(xlabel=f"Log-odds of {words.upper} against {words.lower} (nats, logarithmic beyond 10)")
        if has_names:
            ax.set_yticks(rows, [printable(audit.ids[m]) for m in order], parse_math=False)
        ax.set(ylim=(size - 0.5, -0.5), ylabel="Demonstration" if has_names else "Rank")
        _add_legend(ax)
        return self


class TimelineDisplay(_AuditDisplay):
    """The log-ratio ``log pi(a|s) - log psi(a|s)`` of each step of one demonstration, in nats."""

    def plot(
        self, ax: Axes | None = None, *, demonstration: Hashable = None, window: int | None = None, worst: int = 5
    ) -> Self:
        """Draw the steps, their running mean over `window` steps and the `worst` ones.

        Parameters
        ----------
        demonstration : id
            By default the least trusted one.
        window : int
            By default a twentieth of the steps.
        """
        ax = self._prepare_axes(ax, (9.0, 2.8))
        index = int(self.audit.ranking()[-1]) if demonstration is None else self.audit.index(demonstration)
        ratio = self.audit.step_log_ratio[self.audit.steps(index)]
        steps, mean, marks = np.arange(len(ratio)), running_mean(ratio, window), self.audit.worst_steps(index, worst)
        ax.plot(steps, ratio, ".", color=COLOURS["open"], markersize=3, alpha=0.6)
        ax.axhline(0, color=COLOURS["open"], linewidth=0.8)
        for colour, side in ((COLOURS["upper"], mean >= 0), (COLOURS["lower"], mean <= 0)):
            ax.fill_between(steps, mean, where=side, interpolate=True, color=colour, alpha=0.25, linewidth=0)
        ax.plot(steps, mean, color="#4a5158", linewidth=1.2)
        ax.plot(marks, ratio[marks], "o", color=COLOURS["lower"], markersize=6, fillstyle="none")
        # Bad steps are often neighbours, so that their numbers would overlap: one number for each run of them.
        labelled: list[int] = []
        for step in marks:
            if all(abs(step - other) > len(steps) / 20 for other in labelled):
                labelled.append(step)
                text = ax.text(step, ratio[step], f"\n{step}", ha="center", va="top", linespacing=0.8)
                text.set(fontsize="small", color=COLOURS["lower"])
        ax.margins(x=0.01, y=0.12)
        ax.set(xlabel="Step", ylabel="Log-ratio (nats)")
        ax.set_title(f"Demonstration {printable(self.audit.ids[index])}", parse_math=False)
        return self


class EvidenceDisplay(_AuditDisplay):
    """The parts of the action with most of the evidence about one demonstration, beside what the typical do in the same
    states, and the trust in its steps below; ``axes_`` holds the axes of each, within ``ax_``."""

    axes_: list[Axes]

    def plot(self, ax: Axes | None = None, *, demonstration: Hashable = None, fps: float | None = None) -> Self:
        """Draw the traces; `rpil.results.traces` says what they are.

        Parameters
        ----------
        demonstration : id
            By default the least trusted one.
        fps : float
            Steps a second, so that the axis is in seconds.

        Raises
        ------
        DataError
            If there is no such demonstration, or it has no traces.
        """
        audit = self.audit
        index = int(audit.ranking()[-1]) if demonstration is None else audit.index(demonstration)
        name = audit.ids[index]
        if name not in audit.traces:
            raise DataError(
                f"Demonstration {printable(name)} has no traces: the {len(audit.traces)} most worth a look have them; "
                "choose one of these."
            )
        own, trust = audit.traces[name], audit.step_trust(index)
        starts = bin_starts(len(trust))
        # The trust in steps is half as high as a part.
        height, unit = 1 / (len(own.parts) + 0.5), fps or 1.0
        ax = self._prepare_axes(ax, (9.0, 1.0 + 1.7 / height))
        ax.set_axis_off()
        ax.set_title(f"Demonstration {printable(name)}", parse_math=False, pad=24)
        self.axes_ = [ax.inset_axes((0, 1 - (k + 0.76) * height, 1, 0.7 * height)) for k in range(len(own.parts))]
        self.axes_.append(ax.inset_axes((0, 0, 1, 0.4 * height)))
        for axes, part in zip(self.axes_, own.parts, strict=False):
            label = f"{own.compared_with}, 5 to 95 %"
            axes.fill_between(starts / unit, part.low, part.high, color=COLOURS["open"], alpha=0.3, label=label)
            axes.plot(starts / unit, part.value, color="black", linewidth=1.0, label="this one")
            said = f"{part.share:.0%} of the evidence, {part.nats:+.1f} nats"
            what = "Probability of the action taken" if own.taken else part.name
            axes.set_title(f"{what} ({said})", parse_math=False, loc="left", fontsize="medium")
        self.axes_[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, borderaxespad=0)
        last = self.axes_[-1]
        last.fill_between(np.arange(len(trust)) / unit, trust, color=COLOURS["upper"], alpha=0.4, linewidth=0)
        last.set(ylim=(0, 1), ylabel="Trust", xlabel="Seconds" if fps else "Step")
        for axes in self.axes_:
            axes.spines[["top", "right"]].set_visible(False)
            axes.set_xlim(0, len(trust) / unit)
        return self


class SessionsDisplay(_AuditDisplay):
    """Log-odds in the order of recording, session by session: sessions with another set-up stand out together."""

    def plot(self, ax: Axes | None = None) -> Self:
        """Draw one dot for each demonstration, and lines between sessions.

        Where the order of recording is not known it is that of the data; where sessions are not, there are no lines.
        """
        audit, size = self.audit, len(self.audit.ids)
        ax = self._prepare_axes(ax, (9.0, 2.8))
        ax.set_yscale("symlog", linthresh=10)
        place = np.arange(size) if audit.order is None else np.argsort(np.argsort(audit.order, kind="stable"))
        names = audit.sessions or ("",) * size
        first: dict[str, int] = {}
        for m in np.argsort(place).tolist():
            first.setdefault(names[m], len(first))
        session = np.array([first[name] for name in names])
        order = np.lexsort([place, session])
        rows, verdicts = np.arange(size), np.array(audit.verdicts)[order]
        for verdict in audit.verdict_counts():
            mask, colour = verdicts == verdict, COLOURS[SIDES[verdict]]
            if mask.any():
                values = audit.log_odds[order][mask]
                ax.plot(rows[mask], values, "o", color=colour, markersize=4.5, label=f"{verdict} ({mask.sum()})")
        starts = np.flatnonzero(np.diff(session[order], prepend=-1))
        for start in starts[1:].tolist():
            ax.axvline(start - 0.5, color=COLOURS["open"], linewidth=0.8, linestyle=":")
        if 1 < len(starts) <= MAX_NAMED_SESSIONS:
            centres = (starts + np.append(starts[1:], size) - 1) / 2
            ax.set_xticks(centres, [printable(name) for name in first], parse_math=False)
        ax.axhline(0, color=COLOURS["open"], linewidth=0.8)
        by = "Place in the data" if audit.order is None else "Order of recording"
        ax.set(xlabel=f"Session, and {by[:1].lower()}{by[1:]}" if len(starts) > 1 else by, ylabel="Log-odds (nats)")
        _add_legend(ax)
        return self


@dataclass(frozen=True, eq=False)
class AuditPlots:
    """The pictures of an audit, each drawn on the axes `ax` or on new ones; see `rpil.results.record.Audit.plot`."""

    audit: AuditResult = field(repr=False)

    def ranking(
        self, *, quantity: Literal["reliability", "log_odds"] = "reliability", ax: Axes | None = None
    ) -> RankingDisplay:
        """Every demonstration, the most trusted at the top."""
        return RankingDisplay.from_audit(self.audit, ax=ax, quantity=quantity)

    def steps(self, demonstration: Hashable = None, *, ax: Axes | None = None) -> TimelineDisplay:
        """The log-ratio of each step of the demonstration with this id, by default of the least trusted one.

        Raises
        ------
        DataError
            If there is none.
        """
        return TimelineDisplay.from_audit(self.audit, ax=ax, demonstration=demonstration)

    def evidence(
        self, demonstration: Hashable = None, *, fps: float | None = None, ax: Axes | None = None
    ) -> EvidenceDisplay:
        """The parts of the action with most of the evidence about the demonstration with this id, by default the least
        trusted one; in seconds where `fps`, steps a second, is given.

        Raises
        ------
        DataError
            If there is none, or it has no traces.
        """
        return EvidenceDisplay.from_audit(self.audit, ax=ax, demonstration=demonstration, fps=fps)

    def sessions(self, *, ax: Axes | None = None) -> SessionsDisplay:
        """Log-odds in the order of recording, session by session, as far as these are known."""
        return SessionsDisplay.from_audit(self.audit, ax=ax)
