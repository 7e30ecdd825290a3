"""Findings that the user declares expected: a file that names rules and demonstrations, to be left out."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches

from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.guard import guarded
from rpil.data.json_files import LARGEST_TABLE, read_json
from rpil.faults.report import RULES
from rpil.faults.rule import Fault
from rpil.faults.rule_numbers import RULE_NAMES

ALL = "all"
"""Stands for all demonstrations."""


def rule_name(word: str, where: str) -> str:
    """The rule of `RULES` that a user names by its number, or with spaces, hyphens or underscores; a `DataError` where
    there is none."""
    name = RULE_NAMES.get(word.strip().upper(), word.strip().lower().replace("-", " ").replace("_", " "))
    if name not in RULES:
        near = get_close_matches(name, RULES, 1)
        remedy = f"perhaps it is {near[0]!r}" if near else f"the rules are {', '.join(RULES)}"
        raise DataError(f"{where}: there is no rule {word!r}; {remedy}.")
    return name


def read_expected(path: StrPath) -> dict[str, set[str]]:
    """Rule to the ids, as text, of the demonstrations in which its findings are so on purpose.

    The file is a JSON object of rule to a list of ids or ``"all"``: ``{"spike": [3, 7]}``.

    Raises
    ------
    DataError
        One sentence that names the file and the line: another form, or a rule that does not exist.
    """
    path = check_readable(check_extension(path, (".json",), "what is expected"))
    with guarded(path.name, "it is not valid JSON in UTF-8", "write rules with lists of ids"):
        content = read_json(path, LARGEST_TABLE, "utf-8-sig")
    if not isinstance(content, dict):
        raise DataError(f'{path.name}: it holds no object of rule to list of ids; write, say, {{"spike": [3, 7]}}.')
    expected: dict[str, set[str]] = {}
    for word, names in content.items():
        listed = [names] if isinstance(names, str | int) else names
        if not isinstance(listed, list) or not all(isinstance(name, str | int) for name in listed):
            raise DataError(f"{path.name}: {word!r} needs a list of demonstration ids, or the word {ALL}.")
        expected.setdefault(rule_name(word, path.name), set()).update(map(str, listed))
    return expected


def leave_out(found: Iterable[Fault], expected: Mapping[str, Collection[str]]) -> tuple[list[Fault], int]:
    """The findings that are not expected, and the number of those that are."""
    found = list(found)
    kept = [f for f in found if not {str(f.id), ALL} & set(expected.get(f.rule, ()))]
    return kept, len(found) - len(kept)
