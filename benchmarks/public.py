"""What `rpil check` and `rpil audit` find in data sets that others published; docs/public.md is what this prints.

    python benchmarks/public.py FOLDER > docs/public.md

FOLDER holds a clone of each repository in `SETS`, called OWNER+NAME; one that is not there is named on stderr, with the
command that brings it. Videos that are Git LFS pointers are not looked at. Two minutes on two cores.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

MAX_SENTENCES, MAX_OF_A_RULE = 6, 2
HEAD = """# What it found in public data sets

`python benchmarks/public.py FOLDER` prints this page: the worst that `rpil check` and `rpil audit` say of data sets
that others published, unchanged, and what we saw when we looked. That a set is here does not mean that it is bad: most
of what was found is small, and who publishes data does others a service. The audits below are of a version before 0.3,
which also said "in doubt"."""


@dataclass(frozen=True)
class PublicSet:
    """A data set in a repository of GitHub, as it was at a commit.

    `path` is the place in the repository, and `seen` is what we saw when we looked at what was found.
    """

    repository: str
    commit: str
    path: str
    robot: str
    seen: str
    has_videos: bool = False


SETS = (
    PublicSet(
        "WangzyNicole/Bimanual-Cloth-Manipulation",
        "4c2af680cb06",
        "dataset",
        "two SO-101 arms fold cloth, LeRobot 2.1",
        "LeRobot stops with an error when it loads these times, and in episode 0 one camera is black in every frame. "
        "The first episodes were made at half the speed of the last ones: perhaps practice. The offset of "
        "action.arm1_j1 in 0 is a false alarm: in all 25 episodes the action is the next state.",
        has_videos=True,
    ),
    PublicSet(
        "chenfei-source/smolVLA-robot-manipulation",
        "de907422c1fc",
        "data",
        "a Piper arm, LeRobot 3.0",
        "The folder says 105 episodes, and 19 were published.",
    ),
    PublicSet(
        "YifanTian07/G1-policy-train",
        "d1d3bb45f16a",
        "",
        "the arms and hands of a humanoid, LeRobot 2.1",
        "At 7.0 s of 71 the joints of the "
        "right arm go in one step as far as in four before, and their commands as far as in two: perhaps frames "
        "are missing. The jump of a command in 9 is three usual steps, and the ring finger in 53 stays while its "
        "command moves a little: false alarms.",
    ),
    PublicSet(
        "yipiandanxinxiangyangkai/open_50",
        "6fbd82859730",
        "",
        "two arms with hands, LeRobot 3.0",
        "In episode 47 a joint leaps by 1.8 between two frames, stays there for a tenth of a second and leaps "
        "back; in 1 another leaps by .9 while its command stays. Both are of the sensor.",
    ),
    PublicSet(
        "SamueleSandrini/record-test",
        "c6d0de303c6f",
        "",
        "an SO-101 arm, LeRobot 3.0",
        "Nothing is wrong; four episodes are too few to say more.",
    ),
)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds the clones")
    folder = parser.parse_args(arguments).folder
    parts = [HEAD]
    for each in SETS:
        clone = folder / each.repository.replace("/", "+")
        if clone.exists():
            parts.append(section(each, clone / each.path))
        else:
            print(f"{each.repository}: git clone https://github.com/{each.repository} {clone}", file=sys.stderr)
    print("\n\n".join(parts))
    return 0


def section(public: PublicSet, path: Path) -> str:
    """What is printed of a data set."""
    check = asked("check", path, *(["--video"] if public.has_videos else []))
    audit = asked("audit", path)
    # A clone may lack videos that the repository has.
    found = [each for each in check["findings"] if each["rule"] != "video file"]
    counts: Counter[str] = Counter()
    sentences = []
    for each in found:
        counts[each["rule"]] += 1
        if counts[each["rule"]] <= MAX_OF_A_RULE:
            sentences.append(f"{each['id']}: {each['rule']}: {each['sentence']}".removeprefix(": "))
    return "\n\n".join(
        [
            f"## {public.repository}",
            f"{public.robot[:1].upper()}{public.robot[1:]}: {check['demonstrations']} demonstrations, "
            f"{check['steps']:,} steps, at commit {public.commit}.",
            f"- `rpil check`: {counted(counts)}.\n{listed(sentences)}"
            f"- `rpil audit`: {audit['finding']}.\n{listed(audit['doubts'])}".rstrip(),
            f"**Seen:** {public.seen}",
        ]
    )


def asked(command: str, path: Path, *options: str) -> dict[str, Any]:
    """What a command of rpil says, as JSON."""
    words = [sys.executable, "-m", "rpil", command, path.name, "--format", "json", "--quiet", *options]
    found: dict[str, Any] = json.loads(subprocess.run(words, cwd=path.parent, capture_output=True, check=True).stdout)
    return found


def counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {rule}" for rule, n in counts.items()) or "no recording faults"


def listed(sentences: Sequence[str]) -> str:
    """At most `MAX_SENTENCES` items below an item."""
    return "".join(f"  - {item}\n" for item in sentences[:MAX_SENTENCES])


if __name__ == "__main__":
    sys.stdout.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    raise SystemExit(main())
