"""The pictures show the numbers of the audit, on the axes that they are given."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from audits import make_audit
from rpil.data.errors import MissingExtraError
from rpil.results.vocabulary import COLOURS, SIDES


@pytest.fixture(autouse=True)
def closed_figures() -> Iterator[None]:
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    yield
    plt.close("all")


def test_a_picture_is_drawn_on_given_axes_or_on_new_ones_and_needs_an_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib.pyplot as plt

    open_before = plt.get_fignums()
    pictures, ax = [getattr(make_audit().plot, name) for name in ("ranking", "steps", "sessions")], Figure().subplots()
    for picture in pictures:
        assert picture(ax=ax) is ax
    assert plt.get_fignums() == open_before
    assert pictures[0]().figure is not pictures[0]().figure
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for picture in pictures:
        with pytest.raises(MissingExtraError, match=r"^To draw a picture needs an optional package.*rpil\[plot\]"):
            picture()


def test_ranking_shows_every_demonstration_in_order_with_its_colour() -> None:
    audit = make_audit()
    ax = audit.plot.ranking()
    order = audit.ranking()
    assert [text.get_text() for text in ax.get_yticklabels()] == [str(audit.ids[m]) for m in order]
    assert ax.yaxis_inverted()
    for line in ax.lines:
        verdict = line.get_label().split()[0]
        rows = line.get_ydata()
        assert line.get_color() == COLOURS[SIDES[verdict]]
        assert all(audit.verdicts[order[row]] == verdict for row in rows)
        np.testing.assert_array_equal(line.get_xdata(), audit.reliability[order[rows]])
    assert [text.get_text() for text in ax.get_legend().texts] == ["open (6)", "outlier (4)"]


def test_the_running_mean_is_over_a_twentieth() -> None:
    for n, k in ((39, 0), (60, 1)):  # over one value, and over three but at the ends
        audit = make_audit(("open",), lengths=[n], step_log_ratio=np.arange(float(n)))
        mean = audit.plot.steps().lines[2].get_ydata()
        np.testing.assert_allclose(mean[k : n - k], np.arange(k, n - k))


def drawn(ax: Axes) -> dict[float, float]:
    """The log-odds at each place."""
    dots = [line for line in ax.lines if line.get_marker() == "o"]
    return {x: y for line in dots for x, y in zip(*line.get_data(), strict=True)}


def test_sessions_are_drawn_one_after_the_other_in_the_order_of_recording() -> None:
    sessions = ("late",) * 3 + ("early", "late") + ("early",) * 5
    order = np.array([9.0, 7.5, 8.0, 1.0, 7.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    audit = make_audit(sessions=sessions, order=order)
    shown = audit.plot.sessions()
    by_place = [3, 5, 6, 7, 8, 9, 4, 1, 2, 0]
    assert drawn(shown) == dict(enumerate(audit.log_odds[by_place].tolist()))
    bounds = [line.get_xdata()[0] for line in shown.lines if line.get_linestyle() == ":"]
    assert bounds == [5.5]
    assert [text.get_text() for text in shown.get_xticklabels()] == ["early", "late"]
