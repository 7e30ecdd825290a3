"""The demonstrations of a recording that a user chooses, and those that are set aside because values are missing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.id_values import check_ids
from rpil.formats.columns import ColumnOptions, Ids
from rpil.formats.damage import left_out_lines
from rpil.formats.recording import Recording

_RANGE = re.compile(r"(\d{1,18})\s*-\s*(\d{1,18})")


def with_chosen(recording: Recording, options: ColumnOptions) -> Recording:
    """The recording of the demonstrations that the options choose.

    A `DataError` where an id is unknown, or none is left. On disk the rows of the others are skipped in each pass.
    """
    only, without = _listed(options.only), _listed(options.without)
    if not (only or without or options.skip_bad):
        return recording
    ids, source = recording.ids, recording.description.source
    mask = np.full(len(ids), not only)
    mask[[*_numbers(only, ids, source, "only")]] = True
    mask[[*_numbers(without, ids, source, "without")]] = False
    if not mask.any():
        raise DataError(f"{source}: <option> and <option> leave no demonstration; correct them.", ("only", "without"))
    n_asked = int(mask.sum())
    aside = [m for m in sorted(recording.found.statistics.faulty) if options.skip_bad is True and mask[m]]
    mask[aside] = False
    if not mask.any():
        raise DataError(f"{source}: in every demonstration a value is missing or infinite; exclude the column.")
    if mask.all():
        return recording
    found, names = recording.chosen(mask), tuple(ids[m] for m in aside)
    asked = f"{n_asked:,} of {len(ids):,} demonstrations are read, as asked."
    notes = (*found.description.notes, *([asked] if n_asked < len(ids) else []), *left_out_lines((), names))
    described = replace(found.description, notes=notes)
    return replace(found, description=described, ids=ids, set_aside=names)


def _listed(wanted: Ids) -> list[Id]:
    """The ids that a user names, of Python or of NumPy; an empty text names none."""
    if isinstance(wanted, str) or not isinstance(wanted, Iterable):
        return [] if wanted is None or wanted == "" else [wanted]
    return [*wanted]


def _numbers(wanted: Sequence[Id], ids: Sequence[Id], source: str, option: str) -> Iterator[int]:
    """The numbers of the demonstrations that a user names; a `DataError` naming those that are not there."""
    places = {str(m): k for k, m in enumerate(ids)}
    for given in map(str, wanted):
        for name in [given] if given in places else map(str.strip, given.split(",")):
            ends = _RANGE.fullmatch(name)
            named = [name] if ends is None or name in places else sorted(ends.groups(), key=int)
            check_ids(named, places, source, "<option>", option)
            low, high = named[0], named[-1]
            if low == high:
                yield places[low]
            else:
                yield from (k for m, k in places.items() if m.isdecimal() and int(low) <= int(m) <= int(high))
