"""Which column of a table holds what: found by name and type, or named by the user."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase

from rpil.data import text as spellings
from rpil.data.errors import DataError
from rpil.data.fit_data import FILE_SESSION
from rpil.data.text import plain_name, quoted, short_name
from rpil.formats.columns import LENGTH, STRETCH, TIME_OF_STEP, ColumnOptions, Columns, Names, by_column, check_names
from rpil.formats.table import NESTED, Kind

*_EPISODE_WORDS, _ID_ALONE = spellings.EPISODE_COLUMNS
_IDS: tuple[Kind, ...] = ("number", "text", "mixed", "time")
_ROLES: tuple[tuple[str, Sequence[re.Pattern[str]], tuple[Kind, ...]], ...] = (
    ("id", _EPISODE_WORDS, _IDS),
    ("id", [_ID_ALONE], _IDS),
    ("id", [spellings.PARTICIPANT], _IDS),
    ("order", spellings.ORDER_COLUMNS, ("number", "time", "text")),
    ("operator", [spellings.OPERATOR], ("number", "text")),
    ("task", [spellings.TASK], ("number", "text")),
    ("intervention", [spellings.INTERVENTION], ("number",)),
)
"""The patterns of the names of the columns of a role, and their kinds; the first line in which there are any counts."""

_REASONS: tuple[tuple[Kind | re.Pattern[str], str], ...] = (
    ("text", "text"),
    ("nested", NESTED),
    *spellings.NOT_SEEN,
    (spellings.OBSERVATION, ""),
    ("empty", "no values"),
    (spellings.ROW_INDEX, "number of the row"),
    ("time", TIME_OF_STEP),
    *((pattern, TIME_OF_STEP) for pattern in spellings.ORDER_COLUMNS),
    (spellings.OUTCOME, "reward, end or verdict"),
    (spellings.NEXT_STEP, "what follows the step"),
    (spellings.OF_EPISODE, "describes a demonstration as a whole"),
    (spellings.OPERATOR, "who demonstrated"),
    (spellings.TASK, "task"),
    (spellings.INTERVENTION, "whether a person had taken over"),
    *((pattern, "another spelling of the action") for pair in spellings.ACTION_COLUMNS[:2] for pattern in pair),
)
"""Why a column of this kind, or of a name like this, is no observation, empty where it is one; the first that fits."""

_NUMBERS: tuple[Kind, ...] = ("number", "list", "mixed")


def find_columns(
    kinds: Mapping[str, Kind],
    source: str,
    options: ColumnOptions = ColumnOptions(),
    default_id: str | None = None,
    lists: Mapping[str, Sequence[str]] = {},
) -> Columns:
    """The columns to read; a `DataError` where they cannot be found, and no `default_id` stands for the id.

    Each number in one of the `lists` is a column, of the kind "list" and the role of its list; other lists are images.
    """
    parts = [(part, name) for name in kinds for part in lists.get(name, (name,))]
    check_names([part for part, _ in parts], source)
    is_nested = {own for own, kind in kinds.items() if kind == "list" and own not in lists}
    of_each: dict[str, Kind] = {m: "nested" if own in is_nested else kinds[own] for m, own in parts}
    return _Search(dict(parts), of_each, source, options, lists).columns(default_id)


@dataclass(eq=False)
class _Search:
    """The search for the columns of one table; every column that is given a role leaves `free`."""

    owners: Mapping[str, str]  # of each column the list that it is from, or itself
    kinds: Mapping[str, Kind]
    source: str
    options: ColumnOptions
    lists: Mapping[str, Sequence[str]]

    def __post_init__(self) -> None:
        self.names = [*self.owners]
        self.plain = {name: plain_name(owner) for name, owner in self.owners.items()}
        self.excluded = {*self.matching(self.options.exclude, "exclude")}
        self.ignored = dict.fromkeys(self.excluded, "excluded as asked")
        self.free = {name: None for name in self.names if name not in self.ignored}

    def columns(self, default_id: str | None) -> Columns:
        """All roles."""
        options = self.options
        asked = self.matching(options.observations, "observations")
        actions = self.matching(options.action, "action")
        named = ((role, getattr(options, role)) for role in ("order", "operator", "task"))
        order, operator, task = (self.one(None if name in options.files else name, role) for role, name in named)
        given: set[str | None] = {*asked, *actions, order, operator, task}
        episode, other_ids = self.episode(given, default_id)
        for option, names, others in (("action", actions, [episode]), ("observations", asked, [episode, *actions])):
            if wrong := [name for name in names if name in others]:
                role = "the id" if wrong[0] == episode else "part of the action"
                said = f"column {wrong[0]!r} is {role} already; take it out of --{option}"
                raise DataError(f"{self.source}: {said}.")
        self.take(episode, *actions)
        actions, one_action = (actions, len(actions) == 1) if actions else self.actions(given)
        if not actions:
            raise self.no_column(f"holds the action: name it {spellings.ACTION[0]}, or name the columns", "action")
        self.take(*actions)
        orders = [order] if order else self.named_as("order")
        operator = operator or next(iter(self.named_as("operator")), None)
        task = task or next(iter(self.named_as("task")), None)
        index = tuple(name for name in self.free if self.plain[name] in ("index", "frame_index"))
        self.take(*(name for name in (*orders, operator, task) if name and name not in asked))
        session, outcomes = options.session, tuple(self.outcomes({*asked, *actions, episode}))
        if session != FILE_SESSION or FILE_SESSION in self.plain:  # which comes before the file itself
            session = self.one(session, "session")
            self.ignored |= {session: "session"} if session in self.free else {}
        observations = asked or self.observations()
        for name in self.free.keys() - {*observations}:
            self.ignored.setdefault(name, "not among the observations that were named")
        ignored = {name: self.ignored[name] for name in self.names if name in self.ignored}
        # What may divide a demonstration, unless its id is named.
        parts: Iterable[str] = () if options.id else (name for name in (*other_ids, operator, task) if name)
        times = [name for name in ignored if name not in self.excluded and self.plain[name] in spellings.TIMESTAMP]
        times = [name for name in times if self.kinds[name] in ("number", "time")]
        return Columns(
            *(episode, tuple(actions), tuple(observations), one_action, tuple(orders), index, tuple(parts), operator),
            *(task, by_column(ignored, self.lists), options, tuple(times), session, outcomes),
            lists=self.lists,
            intervention=next(iter(self.named_as("intervention", {*observations})), None),
        )

    def take(self, *names: str) -> None:
        """Give these columns a role."""
        for name in names:
            self.free.pop(name, None)

    def named_as(self, role: str, without: Collection[str | None] = ()) -> list[str]:
        """The free columns that have a `role` by their names, in the order of the patterns."""
        for patterns, kinds in ((patterns, kinds) for one, patterns, kinds in _ROLES if one == role):
            free = [name for name in self.free if self.kinds[name] in kinds and name not in without]
            if found := [name for pattern in patterns for name in free if pattern.fullmatch(self.plain[name])]:
                return found
        return []

    def episode(self, given: Collection[str | None], default_id: str | None) -> tuple[str, list[str]]:
        """The column of the demonstration, and others that are called so."""
        found = self.named_as("id", given)
        order = {plain: k for k, plain in enumerate(spellings.EPISODE)}
        found.sort(key=lambda name: order.get(self.plain[name], len(order)))
        wanted = self.one(self.options.id, "id") or (found[0] if found else default_id)
        if wanted is None and (self.options.split_gap or self.options.segment):
            wanted = STRETCH
        if wanted is None:
            what = f"says which demonstration a row is from: name it {spellings.EPISODE[0]}, or name the column"
            lacks = not self.options.action and not self.actions(given)[0]
            more = "; no column holds the action either: name it with --action" * lacks
            raise self.no_column(what, "id", f", or end demonstrations at pauses with --split-gap{more}")
        others = [name for name in found if name != wanted]
        self.ignored |= dict.fromkeys(others, "another id")
        return wanted, others

    def actions(self, given: Collection[str | None]) -> tuple[list[str], bool]:
        """The columns of the action by their names, which may be none, and whether it is one column."""
        free = [(name, self.plain[name]) for name in self.free if name not in given]
        for whole, part in spellings.ACTION_COLUMNS:
            found = [name for name, plain in free if whole.fullmatch(plain) and self.kinds[name] != "nested"]
            if found:  # `action` comes before `action_id`, which comes before `action_name`
                best = min(found, key=lambda m: (self.plain[m] not in spellings.ACTION, self.kinds[m] == "text"))
                return [name for name in found if self.owners[name] == self.owners[best]], True
            parts = ((name, plain) for name, plain in free if part.fullmatch(plain))
            numbers = [name for name, plain in parts if plain[-1].isdigit() or self.kinds[name] in (*_NUMBERS, "text")]
            if found := [name for name in numbers if not spellings.ABOUT_ACTION.fullmatch(self.plain[name])]:
                return found, len(found) == 1 and self.kinds[found[0]] == "text"
        driven = [(name, plain) for name, plain in free if self.kinds[name] in _NUMBERS]
        has_wheel = any(spellings.STEERING.fullmatch(plain) for _, plain in driven)  # which pedals alone may lack
        words = spellings.STEERING, spellings.PEDAL
        found = [name for name, plain in driven if has_wheel and any(one.fullmatch(plain) for one in words)]
        return found, len(found) == 1

    def observations(self) -> list[str]:
        """The columns called obs or observation, else those called state, else all numbers without another role."""
        for name in self.free:  # by the first reason that fits
            kind, plain = self.kinds[name], self.plain[name]
            fits = (why for key, why in _REASONS if (kind == key if isinstance(key, str) else key.fullmatch(plain)))
            if why := next(fits, ""):
                self.ignored.setdefault(name, why)
        free = [name for name in self.free if name not in self.ignored]
        if not free:
            raise self.no_column("holds observations: name them observation.*, or name the columns", "observations")
        named = [name for name in free if spellings.OBSERVATION.fullmatch(self.plain[name])]
        if not named:
            named = [name for name in free if spellings.STATE.fullmatch(self.plain[name])]
            named = [] if len(named) == 1 and self.kinds[named[0]] != "list" else named
        for name in {*free} - {*(named or free)}:
            self.ignored[name] = f"not named as an observation, as {self.owners[named[0]]} is"
        return named or free

    def outcomes(self, data: Collection[str]) -> Iterator[str]:
        """The outcomes, which are no observations; a `DataError` where the user names one among the `data` as well."""
        for wanted in self.options.outcomes:
            name = wanted.removeprefix("-")
            column = LENGTH if name == LENGTH else self.one(name, "outcome")
            if column is None or column in data:
                said = f"column {name!r} is the id, an observation or part of the action, and no outcome"
                raise DataError(f"{self.source}: {said}; name another.")
            if column != LENGTH:
                self.take(column)
                self.ignored[column] = "outcome"
            yield wanted.removesuffix(name) + column

    def one(self, wanted: str | None, option: str) -> str | None:
        """The one column that the user names for a role, if any."""
        found = [] if wanted is None else self.matching([wanted], option)
        if len(found) > 1:
            raise DataError(f"{self.source}: {wanted!r} names {quoted(found)}; name one column with --{option}.")
        return next(iter(found), None)

    def matching(self, wanted: Names, option: str) -> list[str]:
        """The columns that the user names; a `DataError` naming the closest ones where there is none."""
        found: dict[str, None] = {}
        texts = [wanted] if isinstance(wanted, str) else wanted
        for pattern in (p.strip() for text in texts for p in ([text] if text in self.plain else text.split(","))):
            hits = self.named(pattern)
            if not hits:
                close = get_close_matches(pattern, self.names[:10_000], 3) or self.names
                beside = {"operator": "demonstrator", "outcome": "value"}.get(option)
                way = f"correct --{option}{f', or give a CSV file (id,{beside})' * bool(beside)}"
                said = f"no column is called {pattern!r}; {way} (found {quoted(close)})"
                raise DataError(f"{self.source}: {said}.")
            found |= dict.fromkeys(hits)
        return list(found)

    def named(self, pattern: str) -> list[str]:
        """The columns of this name, or with the same words or the pattern, else as `rpil info` prints them."""
        if pattern in self.plain or pattern in self.lists:
            return [*self.lists.get(pattern, [pattern])]
        lower, plain = pattern.lower(), plain_name(pattern)
        if any(sign in pattern for sign in "*?["):
            each = ((name, (name, owner)) for name, owner in self.owners.items())
            found = [name for name, own in each if any(fnmatchcase(one.strip().lower(), lower) for one in own)]
        else:
            found = [name for name in self.names if self.plain[name] == plain]
        return found or [name for name in self.names if fnmatchcase(short_name(name).lower(), lower)]

    def no_column(self, what: str, option: str, more: str = "") -> DataError:
        """The error that no column is what it says; it lists the columns, with the kind of those that are not read."""
        owners = {owner: self.kinds[name] for name, owner in self.owners.items()}
        shown = [(quoted([name]), kind) for name, kind in [*owners.items()][:12]]
        listed = ", ".join(f"{name} ({kind})" if kind in ("nested", "text", "empty") else name for name, kind in shown)
        listed += ", ..." * (len(owners) > 12)
        if "nested" in owners.values():
            more += "; nested ones are no numbers: if each row is a demonstration, pass the rows to rpil.read in Python"
        return DataError(f"{self.source}: no column {what} with --{option} (found {listed}){more}.")
