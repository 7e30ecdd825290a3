"""Plain words: docstrings of src that begin with a riddle, and commit subjects that are no short imperative.

``python tools/lint_words.py`` prints them, and ends with code 1 where there are any; `make lint` calls it.
A docstring begins with a verb or a noun, never with What, Those, That or Of. A subject has at most 65 letters and
begins with a verb in the imperative.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RIDDLE = re.compile(r"(What|Those|That|Of)\b")
MAX_SUBJECT = 65
SINCE = "d587d9d50409"
"""The commit after which subjects are looked at; those before it stay as they are."""

NOT_IMPERATIVE = re.compile(r"[A-Z]?[a-z]*(?:ing|ed|[^s]s)\b|(?:A|An|The|No|Not|Of|What|Those|That|It|There)\b")
VERBS = {"Bring", "Ring", "Embed", "Feed", "Need", "Seed", "Speed", "Focus", "Canvas", "Bias", "Alias", "Process"}
"""Imperatives that end as other forms do."""


def docstrings(source: str) -> Iterator[tuple[int, str]]:
    """The line and the text of every docstring, those of constants and fields as well."""
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        for one in body if isinstance(body, list) else ():
            value = one.value if isinstance(one, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield one.lineno, value.value.strip()


def riddles(root: Path = ROOT / "src") -> list[str]:
    """The docstrings that begin with one of the four words."""
    found = []
    for path in sorted(root.rglob("*.py")):
        for line, text in docstrings(path.read_text(encoding="utf-8")):
            if RIDDLE.match(text):
                found.append(f"{path.relative_to(root)}:{line}: {text.splitlines()[0]}")
    return found


def subject_faults(subject: str) -> list[str]:
    """The faults of one commit subject; merges have none."""
    if subject.startswith("Merge "):
        return []
    first, found = subject.split(" ")[0], []
    if len(subject) > MAX_SUBJECT:
        found.append(f"{len(subject)} letters")
    if not subject[:1].isupper() or subject.endswith("."):
        found.append("begins small, or ends with a full stop")
    if first not in VERBS and NOT_IMPERATIVE.fullmatch(first):
        found.append(f"{first} is no imperative")
    return found


def subjects(since: str = SINCE) -> list[str]:
    """Commit subjects since a commit; none where the history is not there, as in a shallow clone."""
    command = ["git", "log", "--format=%h %s", f"{since}..HEAD"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return run.stdout.splitlines() if run.returncode == 0 else []


def main() -> int:
    faults = riddles()
    for line in subjects():
        commit, _, subject = line.partition(" ")
        faults += [f"{commit}: {subject}: {fault}" for fault in subject_faults(subject)]
    print("\n".join(faults) or "Words: plain.")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
