"""The choices of the options are those of the library."""

from __future__ import annotations

from rpil.cli import main as cli
from rpil.mixture.adversaries.named import ADVERSARIES
from rpil.policies.features import FEATURES


def test_choices_are_those_of_the_library():
    for command, option, expected in (
        ("audit", "features", FEATURES),
        ("audit", "adversary", ["auto", *ADVERSARIES["discrete"], *ADVERSARIES["continuous"]]),
    ):
        (parameter,) = [param for param in cli.main.commands[command].params if param.name == option]
        assert {name.replace("-", " ") for name in parameter.type.choices} == set(expected)
