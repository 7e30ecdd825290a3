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
from rpil.faults.command_rules import CommandRule
from rpil.faults.measured_columns import MovingBlock, pilot
from rpil.faults.report import NUMBERS, FaultReport
from rpil.faults.rule import Learned
from rpil.faults.still import idle_runs
from rpil.formats.recording import Recording
from rpil.numerics.types import Array, Float

HEADER = ("action", "range", "at limits", "constant", "wraps", "lag", "tracking error")
IDLE_ENDS = "rpil check {} --format json lists the steps to keep under trims"
MENDS = {"idle head": IDLE_ENDS, "idle tail": IDLE_ENDS, "missing episodes": "rpil keep {} -o {} numbers them anew"}
"""The command that mends the findings of a rule; of others, `rpil keep` without the demonstrations."""
SAY_THEMSELVES = ("two conventions", "wraps", "action is state", "constant")
"""Rules whose sentences say what to do, as every demonstration can be mended."""


@dataclass(frozen=True)
class SetTable:
    """Facts of the set by name, a row for each action, and lines of what stops a training with what mends it."""

    facts: dict[str, str]
    actions: list[tuple[str, ...]]
    stumbles: list[str]

    def to_dict(self) -> dict[str, object]:
        """As plain text."""
        rows = [dict(zip(HEADER, row, strict=True)) for row in self.actions]
        return {"set": self.facts, "actions": rows, "stumbles": self.stumbles}

    def panels(self) -> list[list[tuple[str, ...]]]:
        """The rows of a table of the set, and of one of its actions where these are numbers, their headers first."""
        return [[("of the set", ""), *self.facts.items()], *([HEADER, *self.actions],) * bool(self.actions)]

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
    facts = {
        "episodes": f"{len(data):,}",
        "steps": f"{data.n_steps:,} ({data.lengths.min():,} to {data.lengths.max():,} an episode)",
        "rate": f"{told.fps:.4g} a second" if told.fps else "unknown",
        "cameras": f"{recording.origin.metadata.n_cameras:,}",
    }
    if block.actions.ndim == 2:
        head, tail, _, middle, *_ = idle_runs(moving, learned.tracked.is_command)
        idle = head + tail + middle
        facts["idle share"] = f"{100 * np.minimum(idle, lengths).sum() / lengths.sum():.0f} %"
    if len(learned.columns.names) and len(lengths) > 1:
        states = moving.values[~learned.columns.is_action] / learned.columns.spread[~learned.columns.is_action, None]
        spread = np.median(states[:, block.offsets[:-1]].std(axis=1)) if len(states) else np.nan
        facts["spread of first states"] = f"{spread:.2f} of the spread of all"
        facts["contradicting actions"] = (
            f"{100 * contradicting(states, block):.0f} % of steps near one of another episode"
        )
    for name, values in zip(recording.facts.outcome_names, recording.facts.outcomes, strict=True):
        if np.isin(values[~np.isnan(values)], (0, 1)).all():
            facts[f"successes, {name}"] = f"{100 * np.nanmean(values):.0f} % of episodes"
    rows = [] if block.actions.ndim == 1 else _actions(block, moving, learned)
    return SetTable(facts, rows, _stumbles(report, path))


def _actions(block: Block, moving: MovingBlock, learned: Learned) -> list[tuple[str, ...]]:
    """A row for each action; lag and tracking error where it is the command of a state."""
    measured, pairs, columns = CommandRule.measure(moving, learned), learned.tracked, learned.columns
    rows: list[tuple[str, ...]] = []
    for a, label in enumerate(learned.action_labels):
        own = block.actions[:, a].astype(float)
        low, high = float(own.min()), float(own.max())
        c = columns.names.index(label) if label in columns.names else -1
        p = [int(k) for k in np.flatnonzero((pairs.action == c) & pairs.fits)] if pairs.is_command else []
        error = f"{np.median(measured[7][:, p] - measured[5][:, p]) / settings.GAP_WIDTH:.3g}" if p else ""
        lags = [pair.lag for pair in learned.pairs if pair.action == c]
        lag = str(pairs.lag) if p else str(lags[0]) if lags else ""
        limits = f"{100 * np.mean((own == low) | (own == high)):.0f} %" if high > low else ""
        turn = f"by {moving.turn[c]:.4g}" if c >= 0 and moving.turn[c] else ""
        rows.append((label, f"{low:.4g} to {high:.4g}", limits, "constant" if low == high else "", turn, lag, error))
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
