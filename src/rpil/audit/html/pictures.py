"""Inline SVG for the report: Matplotlib's pictures made to follow the page's colours, and compact timelines."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from rpil.audit.html.wording import number
from rpil.audit.plots import COLOURS, running_mean
from rpil.audit.record import Audit

# A curve has at most this many points, however long its demonstration: what keeps 200 timelines in a few megabytes.
POINTS = 200
STRIP_POINTS = 60
INK = "#1c2024"


def inline_svg(draw: Callable[[Any], Any], *, size: tuple[float, float], label: str, salt: str) -> Markup:
    """What `draw` puts on the Matplotlib axes it is given, `size` inches large, as SVG that follows the page's colours.

    A reader who cannot see the picture is told the `label`; the `salt` makes ids differ from those of other pictures.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    inks = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": salt, "font.size": 9} | dict.fromkeys(inks, INK)
    # A Figure of our own, not pyplot's: the caller's backend and open figures are left alone.
    with rc_context(style):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure.subplots())
        stream = io.StringIO()
        figure.savefig(
            stream, format="svg", transparent=True, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
        )
    text = stream.getvalue()
    # The document type, the name spaces and the global style rule have no place, or no meaning, inside HTML.
    text = text[text.index("<svg") :]
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:xlink)?="[^"]*"', "", text).replace("xlink:href", "href")
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r"font-family: [^;\"]+;?", "", text)
    text = text.replace(INK, "currentColor")
    for verdict, colour in COLOURS.items():
        text = text.replace(colour, f"var(--{verdict})")
    return Markup(text.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1))


def returns_figure(rows: Sequence[tuple[str, float, float, float]]) -> Markup:
    """Mean returns with their intervals, one row for each policy, the first at the top.

    A dot and its interval rather than a bar: returns are often negative, and a bar that is longer where the policy is
    worse misleads. Rows are (name, mean, low, high).
    """

    def draw(ax: Any) -> None:
        _, means, lows, highs = zip(*rows, strict=True)
        places = np.arange(len(rows))
        ax.hlines(places, lows, highs, color=COLOURS["expert"], alpha=0.4, linewidth=3)
        ax.plot(means, places, "o", color=COLOURS["expert"], markersize=6)
        for place, mean in enumerate(means):
            ax.annotate(number(mean), (mean, place), (0, 6), textcoords="offset points", ha="center")
        ax.set_yticks(places, [name for name, *_ in rows])
        ax.tick_params(axis="y", length=0)
        ax.spines[["top", "right", "left"]].set_visible(False)
        ax.set(ylim=(len(rows) - 0.5, -0.6), xlabel="Return (mean and 95 % interval)")

    told = "; ".join(f"{name} {number(mean)} ({number(low)} to {number(high)})" for name, mean, low, high in rows)
    return Markup('<figure class="picture">{}</figure>').format(
        inline_svg(draw, size=(5, 0.7 + 0.4 * len(rows)), label=f"Mean returns: {told}", salt="returns")
    )


def score_figure(audit: Audit, score: NDArray[Any], name: str) -> Markup:
    """Log-odds of each demonstration against a score (M,) that the audit never saw, called `name` on its axis."""

    def draw(ax: Any) -> None:
        verdicts = np.array(audit.verdicts)
        # Shapes as in the ranking, so that nothing rests on colour alone.
        shapes: dict[str, dict[str, Any]] = {
            "expert": {"marker": "o"},
            "uncertain": {"marker": "o", "fillstyle": "none", "markeredgewidth": 1.5},
            "adversary": {"marker": "D", "markersize": 5},
        }
        ax.axhline(0, color=COLOURS["uncertain"], linewidth=0.8)
        for verdict, colour in COLOURS.items():
            here = verdicts == verdict
            if here.any():
                style = {"markersize": 6, "linestyle": "none", "color": colour} | shapes[verdict]
                ax.plot(score[here], audit.log_odds[here], label=f"{verdict} ({here.sum()})", **style)
        ax.spines[["top", "right"]].set_visible(False)
        ax.set(xlabel=name, ylabel="Log-odds (nats)")
        ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=3, frameon=False, handletextpad=0.2)

    told = f"Log-odds of each demonstration against {name}, coloured by verdict."
    return Markup('<figure class="picture">{}</figure>').format(
        inline_svg(draw, size=(5, 3.4), label=told, salt="score")
    )


def _blocks(size: int, points: int) -> NDArray[np.int64]:
    """Where each of at most `points` blocks of near-equal length starts."""
    return np.unique(np.linspace(0, size, min(size, points), endpoint=False).astype(np.int64))


def _points(x: NDArray[Any], y: NDArray[Any]) -> str:
    return " ".join(f"{a:.0f},{b:.0f}" for a, b in zip(x, y, strict=True))


class Timelines:
    """Geometry of the timelines of an audit, on one vertical scale so that demonstrations can be compared.

    The box is 1000 wide and 1000 high and is stretched by the page: a line keeps its width, letters stay outside.
    The scale leaves out the most extreme 4 % of the steps, which are drawn at its edges: their size is told in words.
    """

    def __init__(self, audit: Audit) -> None:
        self.audit = audit
        low, high = np.quantile(audit.step_log_ratio, [0.02, 0.98])
        self.low, self.high = min(float(low), -0.1), max(float(high), 0.1)
        self.zero = round(1000 * self.high / (self.high - self.low))

    def height(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """From nats to units from the top."""
        return 1000 * (self.high - np.clip(values, self.low, self.high)) / (self.high - self.low)

    def one(self, index: int) -> dict[str, Any]:
        """The curves and marks of one demonstration."""
        ratio = self.audit.step_log_ratio[self.audit.steps(index)]
        size = len(ratio)
        starts = _blocks(size, POINTS)
        edges = np.append(starts, size)
        centres, counts = 500 * (edges[:-1] + edges[1:]) / size, np.diff(edges)
        mean = self.height(np.add.reduceat(running_mean(ratio), starts) / counts)
        # The curve and the band reach both sides of the box, so that even a single step leaves a line.
        x = np.concatenate([[0], centres, [1000]])
        ends = (self.height(most.reduceat(ratio, starts)) for most in (np.maximum, np.minimum))
        top, bottom, middle = (np.pad(y, 1, mode="edge") for y in (*ends, mean))
        worst = self.audit.worst_steps(index)
        places = [(n, float(ratio[n]), 100 * (n + 0.5) / size, float(self.height(ratio[[n]])[0]) / 10) for n in worst]
        marks = [dict(zip(("step", "value", "left", "top"), place, strict=True)) for place in places]
        return {
            "band": _points(np.concatenate([x, x[::-1]]), np.concatenate([top, bottom[::-1]])),
            "mean": _points(x, middle),
            "strip": self._strip(ratio),
            "marks": marks,
        }

    def _strip(self, ratio: NDArray[np.float64]) -> dict[str, str]:
        """The running mean above and below zero, 2 units high, for a glance."""
        starts = _blocks(len(ratio), STRIP_POINTS)
        mean = np.add.reduceat(ratio, starts) / np.diff(np.append(starts, len(ratio)))
        x = np.append(starts, len(ratio)) * 1000 / len(ratio)
        scaled = np.where(mean > 0, mean / self.high, mean / -self.low).clip(-1, 1)
        # Square roots, so that faint doubt is seen beside certainty.
        height = np.sign(scaled) * np.sqrt(np.abs(scaled))

        def area(part: NDArray[np.float64]) -> str:
            corners = zip(np.repeat(x, 2)[1:-1], np.repeat(500 - 500 * part, 2), strict=True)
            return "0,500 " + " ".join(f"{a:.0f},{b:.0f}" for a, b in corners) + " 1000,500"

        return {"expert": area(height.clip(min=0)), "adversary": area(height.clip(max=0))}
