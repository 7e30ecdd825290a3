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
        ways = f"pip install huggingface_hub, or give hf://datasets/{name}"
        raise DataError(f"{name}: there is no such file or folder; if it is a data set of the Hub, {ways}.") from error
    try:
        return Path(snapshot_download(name, repo_type="dataset", allow_patterns=_FILES))
    except Exception as error:  # of very many types
        raise DataError(
            f"{name}: there is no such file or folder, nor could it be downloaded from the Hub ({in_words(error)}); "
            "check the name."
        ) from error
