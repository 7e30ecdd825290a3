"""Run the blocks of a page of docs/tutorials, in their order and in one folder, and draw the page's pictures.

python tools/tutorials.py            # every tutorial; pictures that its blocks save are copied beside the page

- ```python is run, and ```sh line by line (lines that begin with rpil or python).
- ```text shows what the block before it printed; `...` stands for anything. It is compared, not written.
- A comment before a block says more: `<!-- writes: labels.csv -->` makes the block a file,
  `<!-- bad: 5 11 -->` answers the questions of `rpil label` by the truth, `<!-- refused -->` expects an error.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from click.testing import CliRunner

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
BLOCK = re.compile(r"(?:^<!-- (.*?) -->\n+)?^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
QUESTION = re.compile(r"Which is better: (\S+?)(?: \(.*?\))? or .*\?|good or bad: (\S+?)(?: \(.*\))?\?")
SAME = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@dataclass(frozen=True)
class Block:
    """A block of a page: its kind, its text, and the comment before it."""

    kind: str
    text: str
    comment: str

    @property
    def bad(self) -> set[str]:
        return set(self.comment.removeprefix("bad: ").split()) if self.comment.startswith("bad: ") else set()


def blocks(page: Path) -> list[Block]:
    return [Block(kind, text, comment or "") for comment, kind, text in BLOCK.findall(page.read_text(encoding="utf-8"))]


def run(page: Path, folder: Path) -> list[str]:
    """Run the blocks in a folder; what was printed other than the page says, as text."""
    names: dict[str, object] = {"__name__": "__main__"}
    printed, wrong = "", []
    for each in blocks(page):
        if each.comment.startswith("writes: "):
            (folder / each.comment.removeprefix("writes: ")).write_text(each.text, encoding="utf-8")
        elif each.kind == "text":
            if not doctest.OutputChecker().check_output(each.text, printed, SAME):
                wrong.append(f"{page.name} says\n{each.text}\nand what is printed is\n{printed}")
        elif each.kind in ("python", "sh"):
            with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as out:
                if each.kind == "python":
                    exec(compile(each.text, page.name, "exec"), names)
                else:
                    for line in each.text.splitlines():
                        call(shlex.split(line, comments=True), page, each)
            printed = out.getvalue()
    return wrong


def call(words: Sequence[str], page: Path, block: Block) -> None:
    """A line of the shell; what it writes is printed."""
    from rpil.cli.main import main

    if words[0] == "python":
        shutil.copy(page.parent / words[1], words[1])
        sys.argv, before = [*words[1:]], sys.argv
        runpy.run_path(words[1], run_name="__main__")
        sys.argv = before
    elif words[:2] == ["rpil", "label"]:
        print(answer(words, block.bad))
    else:
        assert words[0] == "rpil", words
        done = CliRunner().invoke(main, [*words[1:]])
        refused = block.comment == "refused"
        assert done.exit_code == (2 if refused else 0), (words, done.output)
        print(done.stderr if refused else done.stdout, end="")


def answer(words: Sequence[str], bad: set[str]) -> str:
    """What `rpil label` prints, where a person answers by the truth."""
    script = "import sys; from rpil.cli.main import main; sys.argv[0] = 'rpil'; main()"
    command = [sys.executable, "-c", script, *words[1:], "--quiet"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    seen = ""
    with subprocess.Popen(command, **pipes, bufsize=0, env=os.environ | {"PYTHONIOENCODING": "utf-8"}) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        while piece := process.stdout.read(1):
            seen += piece.decode()
            if seen.endswith("\n> "):
                one, alone = QUESTION.findall(seen)[-1]
                word = ("b" if alone in bad else "g") if alone else ("2" if one in bad else "1")
                seen += f"{word}\n"
                process.stdin.write(f"{word}\n".encode())
    assert process.returncode == 0, seen
    return seen


def pictures(page: Path) -> list[str]:
    """The names of the pictures on a page."""
    return re.findall(r"!\[[^\]]+\]\(([\w-]+\.png)\)", page.read_text(encoding="utf-8"))


def main() -> None:
    import matplotlib

    matplotlib.use("agg")
    for page in sorted(TUTORIALS.glob("*.md")):
        with tempfile.TemporaryDirectory() as folder:
            for wrong in run(page, Path(folder)):
                print(wrong)
            for name in pictures(page):
                shutil.copy(Path(folder) / name, TUTORIALS / name)
                print(f"{name}: {(TUTORIALS / name).stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
