"""Which column of a table holds what: found by name and type, or named by the user."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from rpil.data.errors import DataError
from rpil.data.names import (
    ABOUT_ACTION,
    ACTION,
    ACTION_COLUMNS,
    EPISODE,
    EPISODE_COLUMNS,
    NEXT_STEP,
    NOT_SEEN,
    OBSERVATION,
    OF_EPISODE,
    OPERATOR,
    ORDER_COLUMNS,
    OUTCOME,
    ROW_INDEX,
    STATE,
    TASK,
    TIMESTAMP,
    may_be_outcome,
    plain_name,
    quoted,
    short_name,
)
from rpil.data.recorded_facts import FILE_SESSION
from rpil.formats.columns import LENGTH, ColumnOptions, Columns, Kind, Names, check_names

if TYPE_CHECKING:
    import pyarrow as pa


def find_columns(
    names: Sequence[str],
    kinds: Mapping[str, Kind],
    source: str,
    options: ColumnOptions = ColumnOptions(),
    default_id: str | None = None,
    head: pa.Table | None = None,
) -> Columns:
    """The columns to read; a `DataError` where columns cannot be found, and no `default_id` stands for the id.

    By the first row of `head` a column of numbers with a unit is named among those that are not read.
    """
    check_names(names, source)
    return _Search(names, kinds, source, options, default_id, head).columns()


class _Search:
    """The search for the columns of one table; every column that is given a role leaves `free`."""

    def __init__(
        self,
        names: Sequence[str],
        kinds: Mapping[str, Kind],
        source: str,
        options: ColumnOptions,
        default_id: str | None = None,
        head: pa.Table | None = None,
    ) -> None:
        self.head = head
        self.names, self.kinds, self.source, self.options, self.default_id = names, kinds, source, options, default_id
        self.plain = {name: plain_name(name) for name in names}
        self.chosen_parts: dict[str, list[str]] = {}
        self.excluded_parts: dict[str, bool] = {}
        self.ignored = dict.fromkeys(self.matching(options.exclude, "exclude"), "excluded as asked")
        self.free = {name: plain for name, plain in self.plain.items() if name not in self.ignored}

    def columns(self) -> Columns:
        """All roles."""
        options = self.options
        asked = self.matching(options.observations, "observations")
        actions = self.matching(options.action, "action")
        order, operator, task = (self.one(getattr(options, role), role) for role in ("order", "operator", "task"))
        given: set[str | None] = {*asked, *actions, order, operator, task}
        episode, other_ids = self.episode(given)
        self.refuse_two_roles(episode, actions, asked)
        self.take(episode, *actions)
        self.refuse_written_lists({*asked, *actions})
        one_action = len(actions) == 1
        if not actions:
            actions, one_action = self.actions(given)
        self.take(*actions)
        orders = [order] if order else self.first_named(ORDER_COLUMNS, ("number", "time", "counter", "text"))
        operator = operator or next(iter(self.first_named([OPERATOR], ("number", "text"))), None)
        task = task or next(iter(self.first_named([TASK], ("number", "text"))), None)
        index = tuple(name for name, plain in self.free.items() if plain in ("index", "frame_index"))
        self.take(*(name for name in (*orders, operator, task) if name and name not in asked))
        session, outcome = self.session(), self.outcome({*asked, *actions, episode})
        observations = asked or self.observations()
        parts = () if options.id else tuple(name for name in (*other_ids, operator, task) if name)
        for name in self.free.keys() - {*observations}:
            self.ignored.setdefault(name, "not among the observations that were named")
        ignored = {name: self.ignored[name] for name in self.names if name in self.ignored}
        excluded, numbers = {*self.matching(options.exclude, "exclude")}, ("number", "time", "counter")
        times = (name for name in ignored.keys() - excluded if self.plain[name] in TIMESTAMP)
        found = Columns(
            *(episode, tuple(actions), tuple(observations), one_action, tuple(orders), index, parts),
            *(operator, task, ignored, options.action_kind, order is not None),
            tuple(name for name in times if self.kinds.get(name) in numbers),
            *(session, outcome),
            chosen_parts=self.chosen_parts,
            excluded_parts=self.excluded_parts,
            source=self.source,
            observations_given=bool(asked),
            allows_missing=options.allow_missing or options.skip_bad,
        )
        return replace(found, outcomes=self.outcomes({*found.all}))

    def take(self, *names: str) -> None:
        """Give these columns a role."""
        for name in names:
            self.free.pop(name, None)

    def refuse_two_roles(self, episode: str, actions: Sequence[str], asked: Sequence[str]) -> None:
        """A `DataError` where the user names the id as an action, or either of them as an observation."""
        for option, names, others in (("action", actions, [episode]), ("observations", asked, [episode, *actions])):
            for name in (name for name in names if name in others):
                role = "the id" if name == episode else "part of the action"
                raise DataError(f"{self.source}: column {name!r} is {role} already; take it out of {option}=.")

    def session(self) -> str | None:
        """The column of the session, which is no observation; a column called "file" comes before the file itself."""
        if self.options.session == FILE_SESSION and FILE_SESSION not in self.plain:
            return FILE_SESSION
        session = self.one(self.options.session, "session")
        self.ignored |= {session: "session"} if session in self.free else {}
        return session

    def outcome(self, data: set[str]) -> str | None:
        """The outcome, which is no observation; a `DataError` where the user names it among the `data` as well."""
        wanted = self.options.outcome
        name = (wanted or "").removeprefix("-")
        if wanted is None or name == LENGTH:
            return wanted
        column = self.one(name, "outcome")
        if column is None or column in data:
            role = "the id, an observation or part of the action"
            raise DataError(f"{self.source}: column {name!r} is {role} and cannot be the outcome too; name another.")
        self.take(column)
        self.ignored[column] = "outcome"
        return wanted.removesuffix(name) + column

    def outcomes(self, read: set[str]) -> tuple[str, ...]:
        """Columns of numbers that are not `read` for another role and may be an outcome by their names."""
        named = (name for name in self.names if name not in read and may_be_outcome(name))
        return tuple(name for name in named if self.kinds.get(name, "number") in ("number", "list"))

    def matching(self, wanted: Names, option: str) -> list[str]:
        """The columns that the user names; a `DataError` naming the closest ones where there is none."""
        found: dict[str, None] = {}
        for text in [wanted] if isinstance(wanted, str) else wanted:
            for pattern in [text] if text in self.plain else text.split(","):
                hits = list(self.named(pattern.strip()))
                if option == "exclude":
                    self.excluded_parts[pattern.strip()] = bool(hits)
                elif not hits:
                    hits = self.with_part(pattern.strip(), option)
                if not hits and not (option == "exclude" and "list" in self.kinds.values()):
                    close = get_close_matches(pattern, self.names[:10_000], 3) or self.names
                    raise DataError(
                        f"{self.source}: no column is called {pattern.strip()!r}; correct <option> "
                        f"(found {quoted(close)}).",
                        option,
                    )
                found |= dict.fromkeys(hits)
        return list(found)

    def named(self, pattern: str) -> Iterator[str]:
        if pattern in self.plain:
            yield pattern
            return
        lower, plain = pattern.lower(), plain_name(pattern)
        is_pattern, found = any(sign in pattern for sign in "*?["), False
        for name in self.names:
            if fnmatchcase(name.strip().lower(), lower) if is_pattern else self.plain[name] == plain:
                found = True
                yield name
        # As `rpil info` prints it, without the word observation.
        yield from (name for name in self.names if not found and fnmatchcase(short_name(name).lower(), lower))

    def with_part(self, pattern: str, option: str) -> list[str]:
        """The columns of lists of which `pattern` may name a number; numbers have names when they are read."""
        start, *more = re.split(r"[*?\[]", pattern.lower())
        own = {name for pair in ACTION_COLUMNS for p in pair for name, plain in self.free.items() if p.fullmatch(plain)}
        lists = ((name, f"{short_name(name)}.".lower().lstrip(".")) for name in self.free if self.is_list(name))
        found = [
            name
            for name, prefix in lists
            if start.startswith((prefix, f"{name.lower()}."))
            or (more and prefix.startswith(start) and (option == "action") == (name in own))
        ]
        for name in found:
            self.chosen_parts.setdefault(name, []).append(pattern)
        return found

    def is_list(self, name: str) -> bool:
        return self.kinds.get(name) == "list"

    def one(self, wanted: str | None, option: str) -> str | None:
        """The one column that the user names for a role, if any."""
        if wanted is None:
            return None
        found = self.matching([wanted], option)
        if len(found) > 1:
            raise DataError(f"{self.source}: {option} needs one column, but {quoted(found)} are called {wanted!r}.")
        return found[0]

    def first_named(self, patterns: Sequence[re.Pattern[str]], kinds: Iterable[Kind]) -> list[str]:
        """The free columns of one of the `kinds` whose names match, in the order of the patterns."""
        free = [(name, plain) for name, plain in self.free.items() if self.kinds.get(name, "number") in kinds]
        return [name for pattern in patterns for name, plain in free if pattern.fullmatch(plain)]

    def episode(self, given: set[str | None]) -> tuple[str, list[str]]:
        """The column of the demonstration, and others that are called so."""
        kinds: list[Kind] = ["number", "text", "mixed", "time", "list"]
        found = [name for name in self.first_named(EPISODE_COLUMNS[:-1], [*kinds, "counter"]) if name not in given]
        found = found or [name for name in self.first_named(EPISODE_COLUMNS[-1:], kinds) if name not in given]
        found.sort(key=lambda name: EPISODE.index(plain) if (plain := self.plain[name]) in EPISODE else len(EPISODE))
        wanted = self.one(self.options.id, "id") or (found[0] if found else self.default_id)
        if wanted is None:
            raise DataError(
                f"{self.source}: no column says which demonstration a row is from: name it {EPISODE[0]}, or name the "
                f"column with <option> (found {self.listed()}).",
                "id",
            )
        others = [name for name in found if name != wanted]
        self.ignored |= dict.fromkeys(others, "another id")
        return wanted, [name for name in others if self.kinds.get(name) != "list"]

    def actions(self, given: set[str | None]) -> tuple[list[str], bool]:
        """The columns of the action, and whether it is one column."""
        free = [(name, plain) for name, plain in self.free.items() if name not in given]
        for whole, part in ACTION_COLUMNS:
            found = [name for name, plain in free if whole.fullmatch(plain) and self.kinds.get(name) != "nested"]
            # `action` comes before `action_id`, which comes before `action_name`.
            found.sort(key=lambda name: (self.plain[name] not in ACTION, self.kinds.get(name) == "text"))
            parts = [name for name, plain in free if part.fullmatch(plain)]
            numbers = [name for name in parts if self.plain[name][-1].isdigit() or self.is_number(name)]
            numbers = [name for name in numbers if not ABOUT_ACTION.fullmatch(self.plain[name])]
            if found:
                return found[:1], True
            if numbers:
                return numbers, False
        raise DataError(
            f"{self.source}: no column holds the action: name it {ACTION[0]}, or name the columns with <option> "
            f"(found {self.listed()}).",
            "action",
        )

    def refuse_written_lists(self, given: set[str]) -> None:
        """A `DataError` where an observation or action is text such as "[0.5, 1.0]"."""
        for name, plain in self.free.items() | {(name, "") for name in given}:
            is_data = name in given or any(pattern.fullmatch(plain) for pattern in (OBSERVATION, ACTION_COLUMNS[0][0]))
            if is_data and self.kinds.get(name) == "written list":
                raise DataError(
                    f"{self.source}: column {name!r} holds lists that are written as text; write one column for each "
                    "number, or leave it out with <option>.",
                    "exclude",
                )

    def listed(self) -> str:
        """The columns for a message, with the kind of those that cannot be read."""
        unread = ("nested", "text", "written list", "empty")
        kinds = {name: f" ({self.kinds[name]})" if self.kinds.get(name) in unread else "" for name in self.names[:12]}
        texts = [quoted([name]) + kind for name, kind in kinds.items()]
        return ", ".join(texts) + (", ..." if len(self.names) > 12 else "")

    def is_number(self, name: str) -> bool:
        return self.kinds.get(name, "number") in ("number", "list", "mixed", "counter")

    def observations(self) -> list[str]:
        """The columns called obs or observation, else those called state, else all numbers without another role."""
        for name, plain in self.free.items():
            reason = self.reason(name, plain)
            if reason:
                self.ignored.setdefault(name, reason)
        free = {name: plain for name, plain in self.free.items() if name not in self.ignored}
        named = [name for name, plain in free.items() if OBSERVATION.fullmatch(plain)]
        if not named:
            named = [name for name, plain in free.items() if STATE.fullmatch(plain)]
            named = [] if len(named) == 1 and self.kinds.get(named[0]) != "list" else named
        for name in free.keys() - set(named or free):
            self.ignored[name] = f"not named as an observation, as {named[0]} is"
        if not free:
            raise DataError(
                f"{self.source}: no column holds observations: name them observation.*, or name the columns with "
                f"<option> (found {self.listed()}).",
                "observations",
            )
        return named or list(free)

    def reason(self, name: str, plain: str) -> str:
        """Why a column without another role is no observation; empty where it is one."""
        kind, prefixed = self.kinds.get(name, "number"), OBSERVATION.fullmatch(plain)
        if kind == "text" and (text := _quantity(self.head, name)):
            return f"text, as {text!r}; to observe it, write its numbers alone"
        if kind in ("text", "written list"):
            return kind
        if kind == "nested":
            return "images or nested values"
        if unseen := next((why for pattern, why in NOT_SEEN if pattern.fullmatch(plain)), ""):
            return unseen
        if prefixed:
            return ""
        if kind == "empty":
            return "no values"
        if kind == "counter" or ROW_INDEX.fullmatch(plain):
            return "number of the row"
        if kind == "time" or any(pattern.fullmatch(plain) for pattern in ORDER_COLUMNS):
            return "time or number of the step"
        for pattern, why in _REASONS:
            if pattern.fullmatch(plain):
                return why
        return ""


def _quantity(head: pa.Table | None, name: str) -> str:
    """The first value of a column of text, where it is a number with a unit; else nothing."""
    first = head[name][0].as_py() if head is not None and head.num_rows and name in head.column_names else None
    return first if isinstance(first, str) and _QUANTITY.fullmatch(first.strip()) else ""


_QUANTITY = re.compile(r"[+-]?\d[\d.,]*\s*[^\d\s.,:/-][^\d]*")
_REASONS = (
    (OUTCOME, "reward, end or verdict"),
    (NEXT_STEP, "what follows the step"),
    (OF_EPISODE, "describes a demonstration as a whole"),
    (OPERATOR, "who demonstrated"),
    (TASK, "task"),
    *((pattern, "another spelling of the action") for pair in ACTION_COLUMNS[:2] for pattern in pair),
)
