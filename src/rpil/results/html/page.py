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
from rpil.data.text import counted, printable
from rpil.results.view import View
from rpil.results.vocabulary import numbered

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


def render_page(
    view: View, sections: Sequence[tuple[str, str | Markup]] = (), top: Markup = Markup(""), live: str = ""
) -> str:
    """The view of an audit as one self-contained HTML page.

    Below its table stand `sections` of a heading and a body, which is `Markup` or is escaped; below its heading `top`.
    `live` is the script of a page that asks its server; without one a page asks nobody.
    """
    template = html_environment("rpil.results", "html").get_template("page.html")
    return template.render(view=view, sections=sections, top=top, live=Markup(live))


def write_page(path: str | os.PathLike[str], view: View, sections: Sequence[tuple[str, str | Markup]] = ()) -> None:
    """Write the page of `render_page` to `path`, which is replaced only once the new page is complete."""
    page = render_page(view, sections)
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(page)
