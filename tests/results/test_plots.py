"""The pictures show the numbers of the audit, on the axes that they are given."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from audits import make_audit
from rpil.data.errors import DataError, MissingExtraError
from rpil.results import plots
from rpil.results.vocabulary import COLOURS, SIDES

PICTURES = "ranking", "steps", "sessions"


@pytest.fixture(autouse=True)
def closed_figures() -> Iterator[None]:
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    yield
    plt.close("all")


def test_importing_plots_does_not_import_matplotlib() -> None:
    code = "import sys, rpil.results.plots; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("picture", PICTURES)
def test_without_matplotlib_the_extra_is_named(picture: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(MissingExtraError, match=r"^To draw a picture needs an optional package.*rpil\[plot\]"):
        getattr(make_audit().plot, picture)()


@pytest.mark.parametrize("picture", PICTURES)
def test_a_picture_is_drawn_on_given_axes_without_pyplot_or_on_new_ones(picture: str) -> None:
    import matplotlib.pyplot as plt

    ax, plot = Figure().subplots(), make_audit().plot
    assert getattr(plot, picture)(ax=ax) is ax
    assert plt.get_fignums() == []
    assert getattr(plot, picture)().figure is not getattr(plot, picture)().figure


def test_running_mean_is_the_mean_of_the_window_cut_at_the_ends() -> None:
    values = np.array([1.0, 2.0, 6.0, 3.0])
    np.testing.assert_allclose(plots.running_mean(values), values)
    many = np.random.default_rng(0).normal(size=60)
    expected = [many[max(k - 1, 0) : k + 2].mean() for k in range(60)]
    np.testing.assert_allclose(plots.running_mean(many), expected)


def test_ranking_shows_every_demonstration_in_order_with_its_interval_and_colour() -> None:
    audit = make_audit()
    ax = audit.plot.ranking()
    order = audit.ranking()
    assert [text.get_text() for text in ax.get_yticklabels()] == [str(audit.ids[m]) for m in order]
    assert ax.yaxis_inverted()
    (bars,) = ax.collections
    np.testing.assert_array_equal([segment[:, 0] for segment in bars.get_segments()], audit.reliability_interval[order])
    for line in ax.lines:
        verdict = line.get_label().split()[0]
        rows = line.get_ydata()
        assert {line.get_color(), *map(to_hex, bars.get_color()[rows])} == {COLOURS[SIDES[verdict]]}
        assert all(audit.verdicts[order[row]] == verdict for row in rows)
        np.testing.assert_array_equal(line.get_xdata(), audit.reliability[order[rows]])
    assert [text.get_text() for text in ax.get_legend().texts] == ["similar (5)", "open (1)", "outlier (4)"]


def test_ranking_of_many_demonstrations_shows_ranks_and_no_ids() -> None:
    ax = make_audit(("similar", "outlier") * 50).plot.ranking()
    assert ax.get_ylabel() == "Rank"
    assert len(ax.get_yticks()) < 20


def test_timeline_marks_the_worst_steps_of_the_demonstration_asked_for() -> None:
    audit = make_audit(ids="abcdefghij", lengths=[500] * 10)
    ax = audit.plot.steps("h")
    ratio = audit.step_log_ratio[audit.offsets[7] : audit.offsets[8]]
    points, _, mean, marks = ax.lines
    np.testing.assert_array_equal(points.get_ydata(), ratio)
    np.testing.assert_allclose(mean.get_ydata(), plots.running_mean(ratio))
    assert list(marks.get_xdata()) == audit.worst_steps(7)
    assert str(audit.worst_steps(7)[0]) in [text.get_text().strip() for text in ax.texts]
    assert ax.get_title() == "Demonstration h"


def test_timeline_shows_the_least_trusted_demonstration_by_default() -> None:
    audit = make_audit()
    ax = audit.plot.steps()
    assert ax.get_title() == f"Demonstration {audit.ids[audit.ranking()[-1]]}"


def test_timeline_of_an_unknown_demonstration_is_refused() -> None:
    with pytest.raises(DataError, match=r"No demonstration is called 'x'; choose one of the ids 0, 1, 2, 3, 4, \.\.\."):
        make_audit().plot.steps("x")


@pytest.mark.parametrize("picture", ["ranking", "steps"])
def test_names_are_text_and_not_formulas(picture: str, tmp_path: Path) -> None:
    audit = make_audit(("similar", "outlier"), ids=("$\\frac$ \ud800", "cost $5$ \x07"))
    shown = getattr(audit.plot, picture)()
    texts = [*shown.get_yticklabels(), shown.title]
    assert r"cost $5$ \x07" in {text.get_text().removeprefix("Demonstration ") for text in texts}
    for ending in ("png", "svg"):
        shown.figure.savefig(tmp_path / f"picture.{ending}")
    assert "cost $5$" in (tmp_path / "picture.svg").read_text(encoding="utf-8")


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


def test_without_sessions_the_order_of_the_data_is_drawn() -> None:
    audit = make_audit()
    shown = audit.plot.sessions()
    assert drawn(shown) == dict(enumerate(audit.log_odds.tolist()))
    assert shown.get_xlabel() == "Place in the data"
    assert not [line for line in shown.lines if line.get_linestyle() == ":"]
