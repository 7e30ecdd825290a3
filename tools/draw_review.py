"""The picture of the README: the page of `rpil review` on the episodes of docs/tutorials/make_episodes.py.

python tools/draw_review.py        # writes docs/review.png; needs chromium, and pip install '.[review,video]'
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
SIZE = 1280, 1140
COMMAND = "from rpil.cli.main import main; main()"
BROWSER = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=8000"]
"""Eight seconds of the page's own clock, in which video and frames load."""


def main() -> None:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or "google-chrome"
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, DOCS / "tutorials" / "make_episodes.py"], cwd=folder, check=True)
        serve = [sys.executable, "-u", "-c", COMMAND, "review", "reach", "--no-browser"]
        with subprocess.Popen(serve, cwd=folder, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            address = next(found[0] for line in server.stdout if (found := re.search(r"http://\S+", line)))
            picture = f"--screenshot={DOCS / 'review.png'}"
            size = f"--window-size={SIZE[0]},{SIZE[1]}"
            subprocess.run([chromium, *BROWSER, size, picture, address], check=True, stderr=subprocess.DEVNULL)
            server.terminate()
    print(f"review.png: {(DOCS / 'review.png').stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
