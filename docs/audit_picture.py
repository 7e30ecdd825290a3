"""The picture of an audit in docs/command-line.md: what `rpil audit` prints on lunarlander_corrupted.npz.

python docs/audit_picture.py       # writes audit.svg beside this file
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from xml.sax.saxutils import escape

COMMAND = "rpil audit landings.npz"
WIDTH, CHARACTER, LINE, MARGIN = 82, 7.8, 18, 16  # in characters, and in pixels
COLOURS = {"outlier": "#ff7b72", "open": "#e3b341"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "audit.svg")
    path = parser.parse_args().output
    path.write_text(svg(printed_audit()), encoding="utf-8")
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def printed_audit() -> list[str]:
    """The lines that the command prints, in a folder that holds the landings."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(Path(__file__).parent / "lunarlander_corrupted.npz", Path(folder) / "landings.npz")
        script = "import sys; from rpil.cli.main import main; sys.argv[0] = 'rpil'; main()"
        command = [sys.executable, "-c", script, *COMMAND.split()[1:]]
        done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.splitlines()


def svg(printed: list[str]) -> str:
    """A terminal of lines of at most `WIDTH` characters."""
    wrapped = [part for line in printed for part in textwrap.wrap(line, WIDTH, drop_whitespace=False) or [""]]
    lines = [f"$ {COMMAND}", *(line.rstrip() for line in wrapped)]
    width, height = round(WIDTH * CHARACTER + 2 * MARGIN), len(lines) * LINE + 2 * MARGIN
    rows = "\n".join(
        f'<text x="{MARGIN}" y="{MARGIN + (k + 0.75) * LINE:g}">{coloured(line)}</text>' for k, line in enumerate(lines)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">\n'
        "<style>text { font: 13px ui-monospace, Menlo, Consolas, monospace; white-space: pre; fill: #e6edf3 }</style>\n"
        f'<rect width="{width}" height="{height}" rx="8" fill="#0d1117"/>\n{rows}\n</svg>\n'
    )


def coloured(line: str) -> str:
    """A line in which the verdict of a row of the ranking has its colour."""
    row = re.fullmatch(r"(\S+ +)(outlier|open)( .*|)", line)
    if row is None:
        return escape(line)
    before, verdict, after = row.groups()
    return f'{escape(before)}<tspan fill="{COLOURS[verdict]}">{verdict}</tspan>{escape(after)}'


if __name__ == "__main__":
    main()
