"""The report: the view of an audit as one HTML file that needs no network and no server."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rpil.data.files import replacing
from rpil.data.text import MAX_IDS, counted, printable
from rpil.inference.findings import DECIDED
from rpil.results.answering import NEXT_STEPS
from rpil.results.facts import TWO_GROUPS
from rpil.results.overview import headline
from rpil.results.result import AuditResult
from rpil.results.view import About, View, make_view
from rpil.results.vocabulary import numbered

Sections = Sequence[tuple[str, str | Markup]]
Live = tuple[View, Markup, Markup]
"""Of a page that asks its server: the view, what stands below the heading, and the script."""

_UNSAFE_IN_SCRIPT = {ord(character): f"\\u{ord(character):04x}" for character in "<>&"}


@cache
def html_environment(package: str, folder: str) -> Environment:
    """The environment of the Jinja templates in a folder of a package; what they insert is escaped and `printable`."""
    loader = PackageLoader(package, folder)
    jinja = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: value if isinstance(value, Markup) else printable(value, kept="\n\t"),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters |= {"percent": format_percent, "count": counted, "numbered": numbered, "plain": _plain}
    jinja.filters |= {"hash": _csp_hash, "data": _as_data}
    # Scripts and styles are no templates: braces mean something else there.
    jinja.globals["asset"] = lambda name: Markup(loader.get_source(jinja, name)[0])
    return jinja


def format_percent(share: float) -> str:
    """A share in whole percent; only exactly 0 and 1 become 0 % and 100 %."""
    if 0 < share < 0.005:
        return "<1 %"
    if 0.995 < share < 1:
        return ">99 %"
    return f"{100 * share:.0f} %"


def _csp_hash(code: str) -> Markup:
    """The hash by which a Content-Security-Policy allows the code of an element, and no other code."""
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    return Markup("'sha256-{}'").format(digest)


def _as_data(value: object) -> Markup:
    """JSON for a script element that holds data: in ASCII, and without the characters that could end the element."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.translate(_UNSAFE_IN_SCRIPT))  # it has no character that HTML knows


def _plain(value: object) -> str:
    """A value of the provenance as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_plain(one)}" for name, one in value.items())
    return "; ".join(map(_plain, value)) if isinstance(value, list | tuple) else str(value)


def render_page(audit: AuditResult, about: About, sections: Sections = (), live: Live | None = None) -> str:
    """An audit as one self-contained HTML page.

    Below its table stand `sections` of a heading and a body, which is `Markup` or is escaped. A page that is `live`
    asks its server, and names nobody beside the question; any other asks nobody.
    """
    template = html_environment("rpil.results", "html").get_template("page.html")
    view, top, script = live or (make_view(audit, about), Markup(""), Markup(""))
    sentence, next_step = headline(audit, 0 if live else MAX_IDS), NEXT_STEPS[audit.finding]
    decided = audit.finding in DECIDED or {*audit.verdicts} != {"open"}
    given = {"audit": audit, "about": about, "view": view, "sections": sections, "top": top, "live": script}
    differ = [note for note in audit.notes if TWO_GROUPS in note]
    return template.render(**given, sentence=sentence, next_step=next_step, decided=decided, differ=differ)


def write_page(path: str | os.PathLike[str], audit: AuditResult, about: About, sections: Sections = ()) -> None:
    """Write the page of `render_page` to `path`, which is replaced only once the new page is complete."""
    page = render_page(audit, about, sections)
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(page)
