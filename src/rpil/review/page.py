"""The page of a review."""

from __future__ import annotations

from rpil.results.view import View


def page_of(state: View, view: View) -> str:
    """The page, which begins with a view."""
    return f"<!DOCTYPE html><title>{view['title']}</title>"
