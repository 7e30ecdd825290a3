"""The page of a review: that of the report, with a question above the table."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from markupsafe import Markup

from rpil.results.html.page import Article, html_environment, render_page
from rpil.results.view import View


def page_of(state: View, view: View) -> str:
    """The page of a view; `state` is what `rpil.cli.questions.server.Review.state` says of the question."""
    question = html_environment("rpil.cli.questions", "").get_template("question.html").render(state)
    return render_page([Article(view, top=Markup(question))], live=_script())


@cache
def _script() -> str:
    return files("rpil.cli.questions").joinpath("review.js").read_text(encoding="utf-8")
