"""Inline SVG for sections of a report: Matplotlib figures in the colours of the page."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup, escape

from rpil.numerics.types import Array, Float
from rpil.results.html.number_format import format_number
from rpil.results.plots import COLOURS
from rpil.results.result import AuditResult
from rpil.results.words import SIDES, Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FIGURE = Markup('<figure class="picture">{}</figure>')
INK = "#1c2024"
MARKER_STYLES: dict[Side, dict[str, Any]] = {
    "upper": {"marker": "o"},
    "open": {"marker": "o", "fillstyle": "none", "markeredgewidth": 1.5},
    "lower": {"marker": "D", "markersize": 5},
}
"""Shapes as in the ranking of the page, so that verdicts do not rest on colour alone."""


def inline_svg(draw: Callable[[Axes], object], size: tuple[float, float], description: str, salt: str) -> Markup:
    """What `draw` draws on the axes of a Matplotlib figure of a `size` in inches, as SVG in the colours of the page.

    The `description` is for readers who cannot see it; the `salt` makes its ids differ from those in other pictures.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    ink = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    # A Figure of our own, not one of pyplot, so that the caller's backend and open figures stay as they are.
    style: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": salt, "font.size": 9} | dict.fromkeys(ink, INK)
    with rc_context(style):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure.subplots())
        stream = io.StringIO()
        no_metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(stream, format="svg", transparent=True, metadata=no_metadata)
    # The document type, the name spaces and the global style rule are not allowed, or mean nothing, inside HTML.
    text = "<svg" + stream.getvalue().partition("<svg")[2]
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:xlink)?="[^"]*"', "", text).replace("xlink:href", "href")
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r"font-family: [^;\"]+;?", "", text)
    text = text.replace(INK, "currentColor")
    for side, colour in COLOURS.items():
        text = text.replace(colour, f"var(--{side})")
    return Markup(text.replace("<svg", f'<svg role="img" aria-label="{escape(description)}"', 1))


def returns_figure(rows: Sequence[tuple[str, float, float, float]]) -> Markup:
    """Mean returns with their intervals: one row (name, mean, low, high) for each policy, the first at the top.

    A dot with an interval, not a bar: returns are often negative, and then the bar of a worse policy is longer.
    """

    def draw(ax: Axes) -> None:
        _, means, lows, highs = zip(*rows, strict=True)
        places = np.arange(len(rows))
        ax.hlines(places, lows, highs, color=COLOURS["upper"], alpha=0.4, linewidth=3)
        ax.plot(means, places, "o", color=COLOURS["upper"], markersize=6)
        for place, mean in enumerate(means):
            ax.annotate(format_number(mean), (mean, place), (0, 6), textcoords="offset points", ha="center")
        ax.set_yticks(places, [name for name, *_ in rows], parse_math=False)
        ax.tick_params(axis="y", length=0)
        ax.spines[["top", "right", "left"]].set_visible(False)
        ax.set(ylim=(len(rows) - 0.5, -0.6), xlabel="Return (mean and 95 % interval)")

    numbers = ((name, *map(format_number, interval)) for name, *interval in rows)
    intervals = "; ".join(f"{name} {mean} ({low} to {high})" for name, mean, low, high in numbers)
    return _FIGURE.format(inline_svg(draw, (5, 0.7 + 0.4 * len(rows)), f"Mean returns: {intervals}", "returns"))


def score_figure(audit: AuditResult, score: Float[Array, " M"], name: str) -> Markup:
    """Log-odds of each demonstration against a score that the audit did not see; `name` is the label of its axis."""

    def draw(ax: Axes) -> None:
        verdicts = np.array(audit.verdicts)
        ax.axhline(0, color=COLOURS["open"], linewidth=0.8)
        for verdict in audit.verdict_counts():
            mask, side = verdicts == verdict, SIDES[verdict]
            if mask.any():
                style: dict[str, Any] = {"markersize": 6, "linestyle": "none"} | MARKER_STYLES[side]
                ax.plot(
                    score[mask], audit.log_odds[mask], color=COLOURS[side], label=f"{verdict} ({mask.sum()})", **style
                )
        ax.spines[["top", "right"]].set_visible(False)
        ax.set_xlabel(name, parse_math=False)
        ax.set_ylabel("Log-odds (nats)")
        ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=3, frameon=False, handletextpad=0.2)

    description = f"Log-odds of each demonstration against {name}, coloured by verdict."
    return _FIGURE.format(inline_svg(draw, (5, 3.4), description, "score"))
