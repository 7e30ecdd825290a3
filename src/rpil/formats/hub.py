"""Data sets of the Hugging Face Hub, by names such as ``lerobot/pusht``: their numbers are downloaded, no videos."""

from __future__ import annotations

import re
from pathlib import Path

from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.guard import in_words

_NAME = re.compile(r"[A-Za-z0-9][\w.-]*/[A-Za-z0-9][\w.-]*")
_FILES = ["meta/**", "data/**", "*.parquet", "*.csv", "*.jsonl"]
"""What is downloaded of a data set."""

_FAILURES = {
    "GatedRepoError": "the Hub gives it only with a token; accept its terms there, then run hf auth login",
    "RepositoryNotFoundError": "the Hub has no such data set, or it is private; check the name, or run hf auth login",
    "LocalEntryNotFoundError": "the Hub could not be reached; check the network",
}
"""Why a data set cannot be downloaded, and what to do, by the error of the client."""


def downloaded(path: StrPath) -> StrPath:
    """The folder with the data set `owner/name` of the Hub; `path` itself where it is not such a name, or is there.

    A `DataError` where the client of the Hub is not installed, or cannot download it.
    """
    name = str(path)
    if not _NAME.fullmatch(name) or Path(name).exists() or Path(name).parent.exists():
        return path
    try:
        from huggingface_hub import snapshot_download
    except ImportError as error:
        remedy = "if it is a data set of the Hub, pip install 'rpil[hub]'"
        raise DataError(f"{name}: there is no such file or folder; {remedy}.") from error
    try:
        return Path(snapshot_download(name, repo_type="dataset", allow_patterns=_FILES))
    except Exception as error:  # of very many types
        kinds = [kind.__name__ for kind in type(error).__mro__ if kind.__name__ in _FAILURES]
        why = _FAILURES[kinds[0]] if kinds else f"the Hub did not give it ({in_words(error)}); try again"
        raise DataError(f"{name}: there is no such file or folder, and {why}.") from error
