"""A page for those who delivered demonstrations: which are rejected and why, and the files in which they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.files import replacing
from rpil.data.folders import is_hidden

if TYPE_CHECKING:
    from rpil.cli.commands import AuditRun
    from rpil.data.persons import AnswerRow


def write_supplier_page(path: str, run: AuditRun, said: Sequence[AnswerRow], with_names: bool) -> None:
    """Write the page about what `run` rejects, with what was `said` of it, and by whom if `with_names`."""
    from rpil.results.html.page import html_environment

    known = said if with_names else [row._replace(by="") for row in said]
    template = html_environment("rpil.results", "html").get_template("supplier.html")
    page = template.render(run=run, said=known, files=_files(Path(run.source)), name=Path(run.source).name)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")


def _files(source: Path) -> Iterator[dict[str, str | int]]:
    """Size and SHA-256 of each file of the data, by its path in them."""
    from rpil.results.provenance import digest

    for file in sorted(source.rglob("*")) if source.is_dir() else [source]:
        name = file.relative_to(source if source.is_dir() else source.parent)
        if not file.is_dir() and not any(map(is_hidden, name.parts)):
            yield digest(file) | {"path": name.as_posix()}
