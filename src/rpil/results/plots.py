"""Pictures of an audit; each is drawn on the axes of the caller or on new ones, which it returns.

Matplotlib, of the extra `plot`, is imported when something is drawn, not before.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.errors import optional
from rpil.data.text import printable
from rpil.numerics.types import Array, Int
from rpil.results.reasons import worst_steps
from rpil.results.result import AuditResult
from rpil.results.vocabulary import COLOURS, SIDES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_NAMED_ROWS = 40
MAX_NAMED_SESSIONS = 12


@dataclass(frozen=True, eq=False)
class AuditPlots:
    """The pictures of an audit, each drawn on the axes `ax` or on new ones, which it returns."""

    audit: AuditResult = field(repr=False)

    def ranking(self, *, ax: Axes | None = None) -> Axes:
        """The reliability of every demonstration, the most trusted at the top."""
        audit, order = self.audit, self.audit.ranking()
        size = len(order)
        ax = _axes(ax, (6.4, 1.2 + 0.2 * min(size, MAX_NAMED_ROWS)))
        ax.set(xlim=(-0.02, 1.02), xlabel="Share of steps that are like the rest")
        _dots(ax, audit, order, audit.reliability[order], np.arange(size))
        has_names = size <= MAX_NAMED_ROWS
        if has_names:
            ax.set_yticks(np.arange(size), [printable(audit.ids[m]) for m in order], parse_math=False)
        ax.set(ylim=(size - 0.5, -0.5), ylabel="Demonstration" if has_names else "Rank")
        return ax

    def steps(self, demonstration: Hashable = None, *, ax: Axes | None = None) -> Axes:
        """The log-ratio ``log pi(a|s) - log psi(a|s)`` of each step of the demonstration with this id, by default of
        the lowest one; its mean over a twentieth of the steps, and the five worst.

        Raises
        ------
        DataError
            If there is none.
        """
        ax, lowest = _axes(ax, (9.0, 2.8)), int(self.audit.ranking()[-1])
        index = lowest if demonstration is None else self.audit.index(demonstration)
        ratio = self.audit.step_log_ratio[self.audit.steps(index)]
        steps, marks, window = np.arange(len(ratio)), worst_steps(ratio), np.ones(max(len(ratio) // 20, 1))
        mean = np.convolve(ratio, window, "same") / np.convolve(np.ones(len(ratio)), window, "same")  # fewer at ends
        ax.plot(steps, ratio, ".", color=COLOURS["open"], markersize=3, alpha=0.6)
        ax.axhline(0, color=COLOURS["open"], linewidth=0.8)
        for colour, side in ((COLOURS["upper"], mean >= 0), (COLOURS["lower"], mean <= 0)):
            ax.fill_between(steps, mean, where=side, interpolate=True, color=colour, alpha=0.25, linewidth=0)
        ax.plot(steps, mean, color="#4a5158", linewidth=1.2)
        ax.plot(marks, ratio[marks], "o", color=COLOURS["lower"], markersize=6, fillstyle="none")
        ax.margins(x=0.01, y=0.12)
        ax.set(xlabel="Step", ylabel="Evidence")
        ax.set_title(f"Demonstration {printable(self.audit.ids[index])}", parse_math=False)
        return ax

    def sessions(self, *, ax: Axes | None = None) -> Axes:
        """Log-odds in the order of recording, session by session: sessions with another set-up stand out together.

        Where the order of recording is not known it is that of the data; where sessions are not, none are divided.
        """
        audit, size = self.audit, len(self.audit.ids)
        ax = _axes(ax, (9.0, 2.8))
        ax.set_yscale("symlog", linthresh=10)
        place = np.arange(size) if audit.order is None else np.argsort(np.argsort(audit.order, kind="stable"))
        names = audit.sessions or ("",) * size
        first = {name: k for k, name in enumerate(dict.fromkeys(names[m] for m in np.argsort(place).tolist()))}
        session = np.array([first[name] for name in names])
        order = np.lexsort([place, session])
        _dots(ax, audit, order, np.arange(size), audit.log_odds[order])
        starts = np.flatnonzero(np.diff(session[order], prepend=-1))
        for start in starts[1:].tolist():
            ax.axvline(start - 0.5, color=COLOURS["open"], linewidth=0.8, linestyle=":")
        if 1 < len(starts) <= MAX_NAMED_SESSIONS:
            centres = (starts + np.append(starts[1:], size) - 1) / 2
            ax.set_xticks(centres, [printable(name) for name in first], parse_math=False)
        ax.axhline(0, color=COLOURS["open"], linewidth=0.8)
        by = "Place in the data" if audit.order is None else "Order of recording"
        ax.set(xlabel=f"Session, and {by[:1].lower()}{by[1:]}" if len(starts) > 1 else by, ylabel="Score")
        return ax


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """The axes of the caller, or new ones."""
    if ax is None:
        _, ax = optional("matplotlib.pyplot", "To draw a picture", "plot").subplots(figsize=size, layout="constrained")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _dots(ax: Axes, audit: AuditResult, order: Int[Array, " M"], x: Array, y: Array) -> None:
    """A dot for each demonstration in this order, coloured by its verdict, and a legend above the axes."""
    verdicts = np.array(audit.verdicts)[order]
    for verdict in audit.verdict_counts():
        mask = verdicts == verdict
        if mask.any():
            label = f"{verdict} ({mask.sum()})"
            ax.plot(x[mask], y[mask], "o", color=COLOURS[SIDES[verdict]], markersize=4.5, label=label)
    ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=6, frameon=False, handletextpad=0.2)
