"""A set of demonstrations in one table: what it holds, how each action moves, and what a trainer will stumble over."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from rpil.data.demonstrations import Block
from rpil.data.text import printable
from rpil.faults import settings
from rpil.faults.measured_columns import MovingBlock, pilot
from rpil.faults.motion import CommandRule
from rpil.faults.report import NUMBERS, FaultReport
from rpil.faults.rule import Learned
from rpil.faults.still import idle_runs
from rpil.formats.recording import Recording
from rpil.numerics.types import Array, Float

FORMS = {"rate": "{:.4g} a second", "spread of first states": "{:.2f} of the spread of all"} | dict.fromkeys(
    ("idle share", "contradicting actions", "successes", "at limits"), "{:.0%}"
)
"""How numbers are printed; others as they are, or with four digits."""
IDLE_ENDS = "rpil check {} --format json lists the steps to keep under trims"
MENDS = {"idle head": IDLE_ENDS, "idle tail": IDLE_ENDS, "missing episodes": "rpil keep {} -o {} numbers them anew"}
"""The command that mends the findings of a rule; of others, `rpil keep` without the demonstrations."""
SAY_THEMSELVES = ("two conventions", "wraps", "action is state", "constant")
"""Rules whose sentences say what to do, as every demonstration can be mended."""


@dataclass(frozen=True)
class SetTable:
    """Facts of the set, and of each action, by name; None and False where there are none. And lines of what stops a
    training with what mends it."""

    facts: dict[str, object]
    actions: list[dict[str, object]]
    stumbles: list[str]

    def to_dict(self) -> dict[str, object]:
        """As plain numbers and text."""
        return {"set": self.facts, "actions": self.actions, "stumbles": self.stumbles}

    def panels(self) -> list[list[tuple[str, ...]]]:
        """The rows of a table of the set, and of one of its actions where these are numbers, their headers first."""
        facts = [(name, in_text(name, value) or "unknown") for name, value in self.facts.items()]
        rows = [tuple(map(in_text, row, row.values())) for row in self.actions]
        return [[("of the set", ""), *facts], *([tuple(self.actions[0]), *rows] for _ in self.actions[:1])]

    def lines(self) -> list[str]:
        """In Markdown, for a terminal and for a dataset card."""
        lines: list[str] = []
        for rows in self.panels():
            cells = [[escape(cell).replace("|", "\\|") for cell in row] for row in rows]
            widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
            table = [" | ".join(f"{cell:<{n}}" for cell, n in zip(row, widths, strict=True)) for row in cells]
            lines += [f"| {table[0]} |", f"|{'|'.join('-' * (n + 2) for n in widths)}|"]
            lines += [*(f"| {row} |" for row in table[1:]), ""]
        stumbles = ["What a trainer will stumble over:", *(f"- {one}" for one in self.stumbles)]
        return lines + stumbles * bool(self.stumbles)


def set_table(recording: Recording, report: FaultReport, path: str) -> SetTable:
    """The table of the recording at a path of which `report` was found; motion is that of a sample."""
    data, told = recording.demonstrations, recording.description
    learned = Learned.of(data)
    block, numbers = pilot(data)
    moving = MovingBlock.of(block, numbers, learned.columns)
    lengths = np.diff(block.offsets)
    facts: dict[str, object] = {
        "episodes": len(data),
        "steps": data.n_steps,
        "shortest": int(data.lengths.min()),
        "longest": int(data.lengths.max()),
        "rate": told.fps,
        "cameras": recording.origin.metadata.n_cameras if recording.origin.metadata.version else None,
    }
    if block.actions.ndim == 2:
        head, tail, _, middle = idle_runs(moving, learned.tracked.is_command)
        facts["idle share"] = float(np.minimum(head + tail + middle, lengths).sum() / lengths.sum())
    if len(learned.columns.names) and len(lengths) > 1:
        states = moving.values[~learned.columns.is_action] / learned.columns.spread[~learned.columns.is_action, None]
        spread = float(np.median(states[:, block.offsets[:-1]].std(axis=1))) if len(states) else None
        facts |= {"spread of first states": spread, "contradicting actions": contradicting(states, block)}
    for name, values in zip(recording.facts.outcome_names, recording.facts.outcomes, strict=True):
        if np.isin(values[~np.isnan(values)], (0, 1)).all():
            facts[f"successes, {name}"] = float(np.nanmean(values))
    rows = [] if block.actions.ndim == 1 else _actions(block, moving, learned)
    return SetTable(facts, rows, _stumbles(report, path))


def in_text(name: str, value: object) -> str:
    """A fact for a table; "" where there is none."""
    if value is None or isinstance(value, str | bool):
        return value if isinstance(value, str) else name * bool(value)
    return FORMS.get(name.partition(", ")[0], "{:,}" if isinstance(value, int) else "{:.4g}").format(value)


def _actions(block: Block, moving: MovingBlock, learned: Learned) -> list[dict[str, object]]:
    """Facts of each action; lag and tracking error where it is the command of a state."""
    measured, pairs, columns = CommandRule.measure(moving, learned), learned.tracked, learned.columns
    rows: list[dict[str, object]] = []
    for a, label in enumerate(learned.action_labels):
        own = block.actions[:, a].astype(float)
        low, high = float(own.min()), float(own.max())
        c = columns.names.index(label) if label in columns.names else -1
        p = [int(k) for k in np.flatnonzero((pairs.action == c) & pairs.fits)] if pairs.is_command else []
        error = float(np.median(measured[7][:, p] - measured[5][:, p]) / settings.GAP_WIDTH) if p else None
        lag = next((pair.lag for pair in learned.pairs if pair.action == c), None)
        limits = float(np.mean((own == low) | (own == high))) if high > low else None
        turn = float(moving.turn[c]) or None if c >= 0 else None
        row = {"action": label, "low": low, "high": high, "at limits": limits, "constant": low == high}
        rows.append(row | {"wraps": turn, "lag": pairs.lag if p else lag, "tracking error": error})
    return rows


def contradicting(states: Float[Array, "S T"], block: Block) -> float:
    """Share of steps, among those whose nearest state of another demonstration is near, whose action differs from that
    of the nearest by more than a standard deviation, or is another code."""
    rows = np.unique(np.linspace(0, states.shape[1] - 1, settings.NEIGHBOUR_ROWS).astype(int))
    owner = np.searchsorted(block.offsets, rows, side="right")
    points, actions = states[:, rows].T, np.asarray(block.actions[rows])
    squares = (points**2).sum(axis=1)
    apart = squares[:, None] + squares - 2.0 * points @ points.T
    apart[owner[:, None] == owner] = np.inf
    nearest = apart.argmin(axis=1)
    near = apart[np.arange(len(rows)), nearest] <= settings.NEAR_STATE**2 * points.shape[1]
    if actions.ndim == 1:
        differs = actions != actions[nearest]
    else:
        spread = np.maximum(actions.std(axis=0), 1e-12)
        differs = (np.abs(actions - actions[nearest]) / spread).max(axis=1) > 1.0
    return float(differs[near].mean()) if near.any() else 0.0


def _stumbles(report: FaultReport, source: str) -> list[str]:
    """Sentences on what is broken, or idle, with the command that mends it where there is one."""
    lines = []
    for one in report.lines:
        if one.grade != "broken" and one.rule not in MENDS:
            continue
        some = (one.id != "" or 0 < len(one.ids) < len(report.ids)) and one.rule not in SAY_THEMSELVES
        mend = MENDS.get(one.rule, f"rpil keep {{}} -o {{}} --without-faults {one.rule.replace(' ', '-')}" * some)
        mend = f"; {mend.format(shlex.quote(source), f'NEW{Path(source).suffix}')}" if mend else ""
        who = f"demonstration {printable(one.id)}: " if one.id != "" else ""
        lines.append(f"{NUMBERS[one.rule]} {who}{one.sentence}{mend}")
    return lines
