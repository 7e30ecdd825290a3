"""Demonstrations in a notebook: everything in them is escaped, and long lists are cut."""

from __future__ import annotations

import numpy as np

from rpil.data.demonstrations import Demonstrations


def html(**changes):
    n = changes.pop("n", 7)
    given = {
        "observations": np.zeros((n, 2)),
        "actions": np.arange(n) % 2,
        "offsets": np.arange(n + 1),
        "observation_names": ("x", "<b>"),
    }
    return Demonstrations.from_arrays(**(given | changes))._repr_html_()


def test_names_are_escaped_and_can_be_encoded():
    text = html(ids=["<script>", "a\nb", *map(str, range(5))], source="<i>.npz")
    assert "<script>" not in text
    assert "<i>" not in text
    assert "<td>&lt;script&gt;</td>" in text
    assert "<td>a b</td>" in text
    assert "Observations: x, &lt;b&gt;<br>" in text
    text.encode()


def test_the_first_five_are_listed_and_the_others_counted():
    assert html().count("<tr><td>") == 5
    assert "and 2 more" in html()
    assert "more" not in html(n=5)
    assert "and 1,995 more" in html(n=2000)
    assert "7 demonstrations, 7 steps" in html()


def test_actions_are_named_with_their_range_or_their_classes():
    assert "Actions: 0, 1<" in html()
    actions = np.column_stack([np.linspace(-1, 2, 7), np.zeros(7)])
    assert "Actions: 0 from -1 to 2, 1 from 0 to 0<" in html(actions=actions)
    many = html(observations=np.zeros((7, 12)), observation_names=[f"joint {k}" for k in range(12)])
    assert "joint 7 and 4 more" in many
    assert "joint 8" not in many


def test_a_long_name_is_cut():
    text = html(ids=["x" * 1000, *map(str, range(6))])
    assert "<td>" + "x" * 37 + "...</td>" in text
