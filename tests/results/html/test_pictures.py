"""Pictures of the report."""

from __future__ import annotations

import numpy as np
import pytest

from audits import make_audit
from html_page import Page
from rpil.results.html.pictures import MAX_CURVE_POINTS, Timelines, returns_figure


def test_timeline_places_curves_and_marks_at_their_steps() -> None:
    audit = make_audit(("typical", "unlike"), lengths=[40, 1000])
    timelines = Timelines(audit)
    shown = timelines.timeline(1)
    band = np.array([point.split(",") for point in shown["band"].split()], dtype=float)
    mean = np.array([point.split(",") for point in shown["mean"].split()], dtype=float)
    assert len(mean) == MAX_CURVE_POINTS + 2
    assert len(band) == 2 * len(mean)
    assert mean.min() >= 0
    assert mean.max() <= 1000
    assert (band[: len(mean), 1] <= band[::-1][: len(mean), 1]).all()
    # The adversary goes wrong in the middle half: lower (further from the top) there than at either end.
    assert mean[80:120, 1].mean() > timelines.zero > mean[:30, 1].mean()
    for mark, step in zip(shown["marks"], audit.worst_steps(1), strict=True):
        assert mark["step"] == step
        assert mark["left"] == pytest.approx((step + 0.5) / 10)
        assert mark["value"] == audit.step_log_ratio[40 + step]


def test_timeline_of_one_step_has_the_full_width() -> None:
    shown = Timelines(make_audit(("typical", "unlike"), lengths=[1, 5])).timeline(0)
    first, *_, last = shown["mean"].split()
    assert first.startswith("0,")
    assert last.startswith("1000,")


def test_returns_figure_has_its_numbers_in_the_description() -> None:
    rows = [("R-PIL", -104.25, -110.0, -98.5), ("Trusting <all>", -128.0, -140.0, -116.0)]
    figure = returns_figure(rows)
    (svg,) = Page(figure).all("svg")
    assert svg["aria-label"] == "Mean returns: R-PIL −104.2 (−110.0 to −98.5); Trusting <all> −128.0 (−140.0 to −116.0)"
    assert "−104.2" in Page(figure).text
    assert "Trusting <all>" in Page(figure).text
    assert "var(--upper)" in figure
    assert "currentColor" in figure
