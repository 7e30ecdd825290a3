"""Meanings of the names of columns, in the spellings that people use; and names and numbers as text and as cells.

A spreadsheet computes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a line's end, and a formula can send
data elsewhere (OWASP, CSV injection). So tables get an apostrophe before such a text, and reading removes it. Plain
numbers, such as -5, stay what they are.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from math import inf
from typing import TYPE_CHECKING, Any
from unicodedata import category, combining, normalize

if TYPE_CHECKING:
    import pyarrow as pa

MAX_LISTED_NAMES, MAX_IDS = 5, 20
"""Names in one sentence, and ids in one printed line."""

_PATH = r"(?<![\w.:])(?<!:/)"  # before a path, and not before the name of a bucket in an address


def printable(name: object, kept: str = "") -> str:
    """The text of a name, with escapes in the place of characters that cannot be seen, such as control characters,
    marks that reverse the direction of writing, and lone surrogates, which no file can hold; those in `kept` stay."""
    return "".join(sign if sign in kept or category(sign)[0] != "C" else repr(sign)[1:-1] for sign in str(name))


def one_line(name: object) -> str:
    """The `printable` text of a name with spaces in the place of lines and tabs."""
    return " ".join(printable(name, kept="\n\t").split())


def listed(names: Iterable[object], most: int = MAX_LISTED_NAMES, last: str = " and ") -> str:
    """Up to `most` of the names in one line, with `last` before the last one, and how many more there are."""
    texts = [printable(name) or "no name" for name in names]
    if len(texts) > most:
        return f"{', '.join(texts[:most])} and {len(texts) - most:,} more"
    return last.join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def counted(size: int, noun: str) -> str:
    """``1 step``, ``2,000 steps``."""
    return f"{size:,} {noun}{'' if size == 1 else 's'}"


def duration(steps: float, seconds: float | None) -> str:
    """The time that steps take, at so many `seconds` each, as ``4.2 s``; where these are unknown ``85 steps``."""
    if seconds is None:
        return counted(round(steps), "step")
    time = steps * seconds
    return f"{time:.1f} s" if time >= 1 else f"{time:.2f} s"


def moment(step: int, seconds: float | None) -> str:
    """When a step is, from the first on: ``49.8 s``, or ``step 995``."""
    return f"step {step}" if seconds is None else duration(step, seconds)


def for_others(text: str) -> str:
    """The text with ``~`` for the home folder and without those of others, for reports, which are passed on."""
    home = os.path.expanduser("~")
    text = text if home == "/" else re.sub(rf"{_PATH}{re.escape(home)}(?![\w.-])", "~", text)
    return re.sub(rf"{_PATH}/(?:home|Users)/[^/\s'\"]+", "...", text)


_PLAIN_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\Z"
# A text of apostrophes and then a formula gets one more, so that removing one always gives the text.
_FORMULA = re.compile(rf"'*(?!{_PLAIN_NUMBER})[=+\-@\t\r\n＝＋－＠]")


def to_cell(value: object) -> object:
    """The value, with an apostrophe before text that would be a formula."""
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value


def from_cell(text: str) -> str:
    """The text that `to_cell` made a cell of."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text[1:]) else text


def each_text(change: Callable[[str], object], column: pa.ChunkedArray) -> pa.ChunkedArray:
    """A column with its texts changed, and any other column as it is; each different text is looked at once."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not (pa.types.is_string(column.type) or pa.types.is_large_string(column.type)):
        return column
    old = column.unique().drop_null()
    new = pa.array([change(text) for text in old.to_pylist()], column.type)
    if new.equals(old):
        return column
    return pa.chunked_array([new.take(pc.index_in(column, old).combine_chunks())])


DataFrame = Any
"""A frame of pandas, which need not be installed, or a table of pyarrow."""


def data_frame(columns: Mapping[str, Sequence[object]]) -> DataFrame:
    """The columns as a data frame of pandas, or where that is not installed as a table of pyarrow."""
    lists = {name: list(values) for name, values in columns.items()}
    try:
        return import_module("pandas").DataFrame(lists)
    except ImportError:
        return import_module("pyarrow").table(lists)


EPISODE = ("episode_index", "episode_id", "episode_ids", "episode")
ACTION = ("action", "actions")
STEP = "step_index"
TIMESTAMP = ("timestamp_s", "timestamp", "timestamps")

_NUMBER = r"(?:_(?:index|ids?|idx|no|num|number|nr|name|key))?"
_EPISODE_STEMS = (
    *("episode", "ep|eps", "traj|trajectory|trajectories", "demo|demonstration", "rollout", "run", "trial"),
    *("sequence|seq", "session", "recording", "game|match", "group", "trip|drive", ""),
)
EPISODE_COLUMNS = [re.compile(rf"(?:{stem})s?{_NUMBER}" if stem else "id|uuid") for stem in _EPISODE_STEMS]
OF_EPISODE = re.compile(
    r"(?:episode|ep|traj|trajectory|demo|demonstration)_.*|is_good|noise_level|agent_level|trial_ids"
)
_ACTION_STEMS = ("(?:expert_)?actions?", "acts?", "ctrl|controls?", "cmds?|commands?", "a", "u")
ACTION_COLUMNS = [
    (re.compile(rf"(?:{stem})(?:_(?:ids?|index|idx|label|class|code|name))?"), re.compile(rf"(?:{stem})(?:{rest})"))
    for stem, rest in zip(_ACTION_STEMS, [r"_\w+|\d+"] * 4 + [r"_?\d+"] * 2, strict=True)
]
STEERING = re.compile(
    r"(?:user_)?(?:steer(?:ing)?|throttle|rudder|aileron|joystick|stick)s?(?:_.*|\d+)?|user_angle"
    r"|(?!last|prev|next)\w+_cmd"  # a command is often a turn that a map asks for, as nav_command
)
PEDAL = re.compile(r"(?:user_)?(?:gas|brak(?:e|ing)|pedal)s?(?:_.*|\d+)?")
"""Names of columns of what drivers and pilots steer with; with a pedal alone the wheel may have another name."""
ABOUT_ACTION = re.compile(r".*_(?:mask|probs?|logp|log_?probs?|dim|time|timestamp|is_pad|names?|labels?|type)")
OBSERVATION = re.compile(r"(?:expert_)?(?:observations?|obs)(?:_.*|\d.*|)")
_OBSERVED = re.compile(r"^\s*(expert_)?(observations?|obs)[._/ -]?", re.I)
STATE = re.compile(r"states?(?:_.*|\d.*|)")
OUTCOME = re.compile(
    r"(?:.*_)?(?:rewards?|rews?|returns?|scores?|success(?:es|ful)?|succeeded|dones?|terminals?|terminated|terminations?"
    r"|truncated|truncations?|timeouts?)(?:_.*)?|weights?|expert_proba|log_odds|labels?|quality|ratings?|grades?|verdicts?"
    r"|(?:is_)?(?:experts?|good|bad|optimal|fail(?:ed|ures?)?)|outcomes?|skills?(?:_levels?)?|advantages?|q_values?|splits?_\w+"
)
OWN_TABLES = {"labels.csv", "verdicts.csv", "labels-verdicts.csv"}  # as rpil calls what it writes, beside data perhaps
_OWN_COLUMN = re.compile(r"weights?|expert_proba|log_odds|labels?|verdicts?")  # as rpil and its users write them
NOT_SEEN = (
    (re.compile(r"(?:.*_)?subtask_(?:term|start)_signals?(?:_.*)?"), "labels of subtasks"),
    (re.compile(r"(?:.*_)?datagen_info(?:_.*)?"), "commands and labels of the program that made the data"),
    (re.compile(r"(?:observations?|obs)_actions?|(?:.*_)?(?:last|prev|previous)_actions?(?:_\d+)?"), "the last action"),
)
"""Names of columns that nobody saw, though they are called observations, and what they are; the first that fits."""
NEXT_STEP = re.compile(r"next_.*|.*_next")
_UNIT = r"(?:_(?:s|ms|us|ns|secs?|seconds?|msecs?|nsecs?|nanosec|ros|utc|unix|epoch|index))?"
ORDER_COLUMNS = [
    re.compile(pattern)
    for pattern in (
        rf"frames?{_NUMBER}",
        rf"(?:steps?|time_?steps?){_NUMBER}|ticks?",
        rf"t{_UNIT}|ts",
        rf"(?:.*_)?(?:time|timestamps?){_UNIT}|(?:elapsed|clock){_UNIT}|date|datetime",
        rf"(?:.*_)?stamps?{_UNIT}",
        r"index|idx|rows?|row_(?:id|index|idx|no|num|number)|line",
    )
]
# pandas writes its row index under these names; as an observation it would reveal the order of the rows.
ROW_INDEX = re.compile(r"index_level_\d+|unnamed_\d+|")
OPERATOR = re.compile(
    r"(?:operator|demonstrator|teleoperator|user|subject|participant|annotator|pilot|driver|person|worker)s?" + _NUMBER
)
PARTICIPANT = re.compile(rf"(?:participant|subject)s?{_NUMBER}")  # may have given one demonstration each
TASK = re.compile(rf"tasks?{_NUMBER}|(?:language_)?instructions?|task_description")
INTERVENTION = re.compile(r"(?:.*_)?(?:interventions?|intervened|takeovers?|is_human)(?:_(?:flags?|active))?")
_WORDS = re.compile(r"[\W_]+")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
_LONGEST_NAME = 40  # in a message


def is_data(name: str) -> bool:
    """Whether a column called `name` would be read as demonstration, step, action or, by its prefix, observation."""
    plain = plain_name(name)
    words = plain in (*EPISODE, STEP) or OBSERVATION.fullmatch(plain)
    return bool(words or any(pattern.fullmatch(plain) for pattern in ACTION_COLUMNS[0]))


def may_be_outcome(name: str) -> bool:
    """Whether a column called `name` may say how a demonstration ended, as a reward or a success does."""
    plain = re.sub(r"^(?:episode|ep|traj|trajectory|demo|demonstration)_", "", plain_name(name))
    return bool(OUTCOME.fullmatch(plain)) and not _OWN_COLUMN.fullmatch(plain)


def action_columns(names: Sequence[str], n_actions: int) -> list[str]:
    """Names for the columns of a continuous action so that they are read as such: by number where names fail."""
    columns = [f"action.{re.sub(r'^actions?[._]', '', name)}" for name in names]
    whole, part = ACTION_COLUMNS[0]
    plain = [plain_name(column) for column in columns]
    misread = (whole, ABOUT_ACTION)
    as_read = all(part.fullmatch(name) and not any(w.fullmatch(name) for w in misread) for name in plain)
    return columns if as_read and len(set(plain)) == n_actions else [f"action.{a}" for a in range(n_actions)]


def plain_name(name: str) -> str:
    """The words of a name in lower case, no accents, joined by _: ``next.Reward``, ``nextReward`` are next_reward."""
    letters = name if name.isascii() else "".join(c for c in normalize("NFKD", name) if not combining(c))
    return _WORDS.sub("_", _CAMEL.sub("_", letters)).strip("_").lower()


def short_name(name: str) -> str:
    """An observation's name without the prefix that says that it is one."""
    return _OBSERVED.sub("", name, count=1) if is_observation(name) else name


def natural_key(name: str) -> list[tuple[float, str]]:
    """By which names sort with their numbers as numbers: demo_2 before demo_10."""
    return [(int(part), "") if part.isdecimal() else (inf, part) for part in re.split(r"(\d{1,18})", name) if part]


def is_observation(name: str) -> bool:
    """Whether the name starts with obs or observation."""
    return bool(OBSERVATION.fullmatch(plain_name(name)))


def quoted(names: Iterable[object], most: int = 12) -> str:
    """Up to `most` of the names, quoted, and of a long one the beginning, for a message."""
    texts = [repr(name) for name in names]
    texts = [text if len(text) <= _LONGEST_NAME else f"{text[:_LONGEST_NAME]}...{text[-1]}" for text in texts]
    return ", ".join(texts[:most]) + (", ..." if len(texts) > most else "")
