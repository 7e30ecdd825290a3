"""What a recording says of itself beside its rows: frames a second, names of joints, tasks, lengths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rpil.data.arrays import Id
from rpil.data.json_files import Parsed
from rpil.data.names import quoted
from rpil.data.text import counted

SIZES = "total_episodes", "total_frames"


@dataclass(frozen=True)
class Metadata:
    """What a recording says of itself: attributes of a file, or LeRobot's ``meta``; empty where it says nothing."""

    version: str = ""
    fps: float | None = None
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # of the numbers in a column of lists
    tasks: Mapping[str, str] = field(default_factory=dict)  # by task_index, as text
    videos: tuple[str, ...] = ()  # observations that lie beside the table
    n_cameras: int = 0  # of videos and of images
    strays: tuple[str, ...] = ()  # data files that ``meta`` does not list
    sizes: Mapping[str, float] = field(default_factory=dict)  # declared numbers of demonstrations and steps
    lengths: Mapping[Id, int] = field(default_factory=dict)  # declared steps of each demonstration
    unusable: tuple[str, ...] = ()  # what ``meta`` says and cannot be used
    facts: Mapping[str, Mapping[str, Parsed]] = field(
        default_factory=dict
    )  # column of ``meta/episodes`` -> id -> value

    def notes(self, n_demonstrations: int, n_steps: int) -> tuple[str, ...]:
        """What ``meta`` says otherwise than the data, or cannot be used of it, in sentences."""
        found = {"total_episodes": (n_demonstrations, "demonstrations"), "total_frames": (n_steps, "steps")}
        unusable = f"Left out of meta, because it cannot be used: {', '.join(self.unusable)}."
        n, only = self.n_cameras, "what only they show" if self.n_cameras > 1 else "what only it shows"
        unseen = f"Pictures are not used ({counted(n, 'camera')}): {only}, as where an object lies, is not known here."
        strays = f"Left out, because meta does not list them: {quoted(self.strays, 5)}."
        values = {name: [*dict.fromkeys(map(str, by_id.values()))] for name, by_id in self.facts.items()}
        facts = [f"{name} ({quoted(some, 4)})" for name, some in values.items() if len(some) > 1]
        more = (
            f"meta has of each demonstration {', '.join(facts[:8])}: name one with --operator, --session or --outcome."
        )
        said = (unusable, bool(self.unusable)), (strays, bool(self.strays)), (unseen, n > 0), (more, bool(facts))
        return tuple(text for text, holds in said if holds) + tuple(
            f"meta/info.json says {name} = {self.sizes[name]}, but the data hold {n:,} {what}; the data decide."
            for name, (n, what) in found.items()
            if self.sizes.get(name, n) != n
        )
