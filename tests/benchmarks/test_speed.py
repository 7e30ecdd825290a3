"""The page of speeds: all rows are of one commit."""

import re
from pathlib import Path

import speed

PAGE = (Path(__file__).parents[2] / "docs" / "speed.md").read_text(encoding="utf-8")


def test_the_page_has_each_row_with_its_goal_and_one_commit():
    assert PAGE.startswith(speed.HEAD)
    rows = re.findall(r"^\| (\w+) \| (.+) \| (\*\*)?([^*|]+?)(?:\*\*)? \| ([\d.]*) \|$", PAGE, re.MULTILINE)
    goals = {key: goal for row in speed.ROWS.values() for key, goal in row.goals.items()}
    assert [key for key, *_ in rows] == list(goals)
    for key, _, bold, found, goal in rows:
        assert goal == ("" if goals[key] is None else f"{goals[key]:g}")
        assert bool(bold) == bool(goal and found != "not measured" and float(found) > float(goal))
    assert len(re.findall(r"^\*commit [0-9a-f]{12}, ", PAGE, re.MULTILINE)) == 1
