"""Errors that users meet."""

import copy
import time

import pytest

from rpil.data.errors import DataError, MissingExtraError


def test_an_error_of_another_process_arrives():
    error = MissingExtraError("Playing", "gym")
    assert str(copy.copy(error)) == str(error)  # as pickling does
    assert "pip install 'rpil[gym]'" in str(error)


@pytest.mark.parametrize(
    ("python", "shell"),
    [
        ("with action= or action_kind=.", "with --action or --action-kind."),
        ("with skip_bad=True or memory=.", "with --skip-bad or --memory."),
        *[("or first run rpil convert a.csv --split-gap 3.",) * 2],
    ],
)
def test_an_option_is_spelt_for_python_and_for_the_shell(python, shell):
    error = copy.copy(DataError(f"id=4.csv: read it {shell}"))  # as pickling does
    assert (str(error), error.in_shell) == (f"id=4.csv: read it {python}", f"id=4.csv: read it {shell}")
    assert str(DataError("--segment is 0.")) == "segment= is 0."


@pytest.mark.parametrize("text", ["x" * 100_000, "x y\n" * 30_000, "it's " * 30_000, "\"'" * 50_000, "\\" * 90_000])
def test_a_long_text_is_quoted_by_its_beginning(text):
    said = str(DataError(f"labels.csv, demonstration '3': unknown label {text!r}; write 'good' or 'bad'."))
    assert said.startswith(f"labels.csv, demonstration '3': unknown label {text!r}"[:90])
    assert said.endswith("; write 'good' or 'bad'.")
    assert len(said) < 200
    assert str(copy.copy(DataError(said))) == said  # as pickling does


LONG = "a b/" * 40


@pytest.mark.parametrize(
    "sentence",
    [
        f"d.csv: no column is called 'x'; perhaps: rpil audit '{LONG}' --id trip --action '{LONG}' --exclude '{LONG}'.",
        f"d.csv: no column is called 'x'; perhaps id='trip', action='{LONG}'.",
        f"{LONG}: the robot's file is damaged, the users' too, and the demonstrations' names are lost.",
    ],
)
def test_what_is_to_be_copied_is_whole(sentence):
    assert str(DataError(sentence)) == sentence


@pytest.mark.parametrize("piece", ["'", "\\'", '"\\', "--", "--a '", "rpil x ", "' a "])
def test_a_hostile_text_takes_no_time(piece):
    begun = time.process_time()
    DataError(100_000 * piece)
    assert time.process_time() - begun < 5
