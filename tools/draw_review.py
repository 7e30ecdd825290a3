"""The picture of the README: the page of `rpil review` on the episodes of docs/tutorials/make_episodes.py.

python tools/draw_review.py        # writes docs/review.png; needs chromium, and pip install '.[review,video]'

Beside it lies docs/review.json with what the page was made of then: the hash of its files and all its texts. A test
compares them with those of today, so that the picture is drawn again when the page has changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Iterator
from http.cookiejar import CookieJar
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

ROOT = Path(__file__).parents[1]
DOCS, SOURCE = ROOT / "docs", ROOT / "src" / "rpil"
SIZE = 1280, 1140
COMMAND = "from rpil.cli.main import main; main()"
BROWSER = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=8000"]
"""Eight seconds of the page's own clock, in which video and frames load."""
OF_ONE_RUN = {"provenance", "run", "command", "path"}
"""Keys of what a page is given that differ from run to run."""


@contextlib.contextmanager
def served() -> Iterator[str]:
    """The address of the page, while `rpil review` serves it."""
    with tempfile.TemporaryDirectory() as folder:
        with contextlib.chdir(folder):
            runpy.run_path(str(DOCS / "tutorials" / "make_episodes.py"))["main"]()
        serve = [sys.executable, "-u", "-c", COMMAND, "review", "reach", "--no-browser"]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        with subprocess.Popen(serve, cwd=folder, text=True, **pipes) as server:
            try:
                assert server.stdout is not None
                yield next(found[0] for line in server.stdout if (found := re.search(r"http://\S+", line)))
            finally:
                server.terminate()


def made_of(address: str) -> dict[str, Any]:
    """The hash of the files of the page, and its texts, in which numbers are #: their last digits depend on the
    processor."""
    files = [*SOURCE.glob("results/html/**/*"), *SOURCE.glob("cli/questions/*")]
    pages = sorted(path for path in files if path.suffix in (".html", ".css", ".js"))
    content = b"".join(path.read_bytes() for path in pages)
    browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
    browser.open(address).read()
    page = browser.open(urljoin(address, "/")).read().decode()
    view = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)[1])
    article = page[page.index("<article>") : page.index('id="made"')].partition("of this run in")
    shown = re.findall(r">([^<>]+)<", f"{article[0]}<{article[2]}")
    texts = {re.sub(r"[-+\u2212]?\d[\d,.]*", "#", " ".join(text.split())) for text in (*texts_of(view), *shown)}
    return {"files": hashlib.sha256(content).hexdigest(), "texts": sorted(texts)}


def texts_of(value: object) -> Iterator[str]:
    """All texts in a value of JSON, but `OF_ONE_RUN`."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, each in value.items():
            if key not in OF_ONE_RUN:
                yield from texts_of(each)
    elif isinstance(value, list):
        for each in value:
            yield from texts_of(each)


def main() -> None:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or "google-chrome"
    with served() as address:
        picture = f"--screenshot={DOCS / 'review.png'}"
        size = f"--window-size={SIZE[0]},{SIZE[1]}"
        subprocess.run([chromium, *BROWSER, size, picture, address], check=True, stderr=subprocess.DEVNULL)
        found = json.dumps(made_of(address), indent=1, ensure_ascii=False)
    (DOCS / "review.json").write_text(found + "\n", encoding="utf-8")
    print(f"review.png: {(DOCS / 'review.png').stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
