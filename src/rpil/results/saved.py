"""Saved audits: an archive of an audit and of what its page shows beside it, from which the page is made again.

Another person may have written it. So types and shapes are those that the classes declare (`rpil.data.archive`), values
are compared with one another, and no command of it writes or runs anything; a page shows the rest as text.
"""

from __future__ import annotations

import json
import re
import shlex
from contextlib import suppress
from dataclasses import fields
from typing import TypeVar

import numpy as np

from rpil.data.archive import VERSION, Decoder, encode, read_archive, rpil_version, write_archive
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_readable
from rpil.data.guard import guarded
from rpil.inference.findings import FINDINGS
from rpil.numerics.types import Array
from rpil.results.choice import KEEP_RULES
from rpil.results.judged import SHARE, Judged
from rpil.results.result import AuditResult
from rpil.results.view import About, View, make_view

SCHEMA = "rpil audit"
AGAIN = "run rpil audit --save again"

MAX_DEMONSTRATIONS = 100_000
"""Of a saved audit: its page is made as it is read."""

NOT_SHARED = ("weights", "verdicts", "keep", "report", "save", "annotate")
"""Options of ``rpil audit`` that no command of a page has: files to write."""

A = TypeVar("A", bound=AuditResult)


def write_audit(path: StrPath, audit: AuditResult, about: About) -> None:
    """Write an audit to a file of any name; a `DataError` where it is too large to be read again."""
    if len(audit.ids) > MAX_DEMONSTRATIONS:
        raise DataError(f"{path}: more than {MAX_DEMONSTRATIONS:,} demonstrations are not saved; write their verdicts.")
    arrays: dict[str, Array] = {}
    header = {"schema": SCHEMA, "version": VERSION, "rpil": rpil_version()}
    content = {"audit": encode(audit, "audit", arrays), "about": encode(about, "about", arrays)}
    write_archive(path, header | content, arrays)


def read_audit(path: StrPath, kind: type[A]) -> tuple[A, View]:
    """The audit in a file that `write_audit` wrote, and the view of its page; a `DataError` where it is none."""
    path = check_readable(path)
    header, arrays = read_archive(path, SCHEMA, f"it is no audit that rpil saved; {AGAIN}", AGAIN)
    with guarded(path, "its parts do not belong together", AGAIN):
        decoder = Decoder(arrays)
        audit, about = decoder.value(header["audit"]), decoder.value(header["about"])
        if not isinstance(audit, kind) or not isinstance(about, About) or decoder.arrays:
            raise TypeError("other parts")
        check_sound(audit)
        if len(audit.ids) > MAX_DEMONSTRATIONS:
            raise DataError(f"{path}: it holds more than {MAX_DEMONSTRATIONS:,} demonstrations; save fewer.")
        is_sound = is_harmless(about.command) and re.fullmatch(r"([\w.-]{1,100}/[\w.-]{1,100})?", about.hub)
        if not is_sound:
            raise ValueError("a command, or a name on the hub")
        audit.suggest_labels()  # what cannot be asked or shown fails here and not later
        view = make_view(audit, about)
        json.dumps(view, allow_nan=False)
    return audit, view


def is_harmless(command: str) -> bool:
    """Whether a command is one ``rpil audit`` without `NOT_SHARED`, or nothing: a reader pastes it into a shell."""
    if not command.isprintable():
        return False
    plain = command.replace(" ~/", " ")  # the home folder of who pastes it
    with suppress(ValueError):  # of a quote that is not closed
        words = shlex.split(plain)
        is_audit = words[:2] in ([], ["rpil", "audit"]) and shlex.join(words) == plain
        return is_audit and {f"--{name}" for name in NOT_SHARED}.isdisjoint(w.partition("=")[0] for w in words)
    return False


def check_sound(audit: Judged) -> None:
    """A `ValueError` or other error where values of an audit from a file do not belong together."""
    n, known = len(audit.ids), audit.answers
    sizes = {"M": n, "N": int(audit.offsets[-1])}
    sound = len({*audit.ids}) == n > 0 and audit.offsets[0] == 0 and bool((audit.lengths > 0).all())
    for field in (one for one in fields(audit) if "axis" in one.metadata):
        column, limits = getattr(audit, field.name), field.metadata.get("limits")
        is_known = isinstance(column, np.ndarray) or bool(column)
        sound &= not is_known or len(column) == sizes[field.metadata["axis"]]
        sound &= not is_known or limits is None or _are_within(column, *limits)
    sound &= len(audit.verdicts) == len(known.labels) == len(audit.copy_of) == n
    sound &= audit.finding in FINDINGS and {*known.labels.tolist(), *audit.claimed.tolist()} <= {-1, 0, 1}
    sound &= audit.columns_within.shape[1] in (0, audit.columns.shape[1] + 1)
    sound &= {*audit.rejected_by} <= {"", *KEEP_RULES} and bool(np.isfinite(audit.step_weight).all())
    sound &= _are_within(np.concatenate([audit.copy_of, known.compared.ravel()]), 0, n - 1)
    sound &= _are_within(np.array([audit.prior.mean, audit.prior.low, audit.prior.high]), *SHARE)
    sound &= audit.fps is None or audit.fps > 0
    sound &= audit.order is None or bool(np.isfinite(audit.order).all())
    steps = dict(zip(audit.ids, audit.lengths.tolist(), strict=True))
    sound &= all(traces.fits(steps[name]) for name, traces in audit.traces.items())
    sound &= len({who.trust is None for who in audit.demonstrators}) <= 1
    groups = (*audit.competing, *(who.demonstrations for who in audit.demonstrators))
    named = {*audit.contradicting, *audit.pair, *(name for group in groups for name in group)}
    if not sound or not named <= {*audit.ids}:
        raise ValueError("values out of range")


def _are_within(values: Array, low: float, high: float) -> bool:
    """Whether all values are between two limits, as no NaN is."""
    return bool(((values >= low) & (values <= high)).all())
