"""The page of a review."""

from __future__ import annotations

from rpil.results.view import View


def page_of(view: View) -> str:
    """The page, which begins with a view."""
    return "<!DOCTYPE html><title>%s</title>" % view["view"]["title"]  # type: ignore
