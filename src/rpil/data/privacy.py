"""Remove from texts what others may not read: secrets in addresses, and where a person's folders are."""

from __future__ import annotations

import os
import re
from contextlib import suppress

_USER = re.compile(r"(:/{1,3})(?:[^/\s'\"@:]{0,200}:[^\s'\"]{0,500}|[^/\s'\"@]+)@")
_SECRET = re.compile(
    r"([?&;#][\w.-]{0,50}(?:auth|code|credential|jwt|key|pass|pw|sas|secret|sig|token)[\w.-]{0,50}=)"
    r"[^&\s'\"]*[^&\s'\".,:;)]",
    re.IGNORECASE,
)
_START = r"(?<![\w.:])(?<!:/)"  # of a path, and not of the name of a bucket in an address
_OTHER_HOMES = re.compile(rf"{_START}/(?:home|Users)/[^/\s'\"]+")


def without_secrets(text: str) -> str:
    """The text with ``***`` in the place of what addresses in it keep secret: users, keys, tokens and passwords."""
    return _SECRET.sub(r"\1***", _USER.sub(r"\1***@", text))


def for_others(text: str) -> str:
    """The text without secrets, with paths in the current folder relative to it, and ``~`` for the home folder.

    Reports, runs and weights are passed on; a shell of the same person still finds what ``~`` names.
    """
    text, here, home = without_secrets(text), "/", os.path.expanduser("~")
    with suppress(FileNotFoundError):  # of a current folder that was deleted
        here = os.getcwd()
    if here != "/":
        inside = rf"(?<![\w.:/]){re.escape(here)}"
        text = re.sub(rf"{inside}/?(?![\w./-])", ".", re.sub(rf"{inside}/(?=[^/\s'\"])", "", text))
    text = text if home == "/" else re.sub(rf"{_START}{re.escape(home)}(?![\w.-])", "~", text)
    return _OTHER_HOMES.sub("...", text)
