"""Pictures of the report."""

from __future__ import annotations

from html_page import Page
from rpil.results.html.pictures import returns_figure


def test_returns_figure_has_its_numbers_in_the_description() -> None:
    rows = [("R-PIL", -104.25, -110.0, -98.5), ("Trusting <all>", -128.0, -140.0, -116.0)]
    figure = returns_figure(rows)
    (svg,) = Page(figure).all("svg")
    assert svg["aria-label"] == "Mean returns: R-PIL −104.2 (−110.0 to −98.5); Trusting <all> −128.0 (−140.0 to −116.0)"
    assert "−104.2" in Page(figure).text
    assert "Trusting <all>" in Page(figure).text
    assert "var(--upper)" in figure
    assert "currentColor" in figure
