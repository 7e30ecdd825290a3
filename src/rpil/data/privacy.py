"""Remove from texts that others may read where a person's folders are."""

from __future__ import annotations

import os
import re
from contextlib import suppress

_START = r"(?<![\w.:])(?<!:/)"  # of a path, and not of the name of a bucket in an address
_OTHER_HOMES = re.compile(rf"{_START}/(?:home|Users)/[^/\s'\"]+")


def for_others(text: str) -> str:
    """The text with paths in the current folder relative to it, and ``~`` for the home folder.

    Reports, runs and weights are passed on; a shell of the same person still finds what ``~`` names.
    """
    here, home = "/", os.path.expanduser("~")
    with suppress(FileNotFoundError):  # of a current folder that was deleted
        here = os.getcwd()
    if here != "/":
        inside = rf"(?<![\w.:/]){re.escape(here)}"
        text = re.sub(rf"{inside}/?(?![\w./-])", ".", re.sub(rf"{inside}/(?=[^/\s'\"])", "", text))
    text = text if home == "/" else re.sub(rf"{_START}{re.escape(home)}(?![\w.-])", "~", text)
    return _OTHER_HOMES.sub("...", text)
