"""Errors that users meet."""

from __future__ import annotations

import copy

from rpil.data.errors import MissingExtraError, user_stack_level


def test_an_error_of_another_process_arrives():
    error = MissingExtraError("Playing", "gym")
    assert str(copy.copy(error)) == str(error)  # as pickling does
    assert "pip install 'rpil[gym]'" in str(error)


def test_stack_level_is_that_of_the_first_caller_outside_the_library():
    inside = {"__name__": "rpil.data.some", "user_stack_level": user_stack_level}
    exec("def inner(): return user_stack_level()\ndef outer(): return inner()", inside)
    assert inside["inner"]() == 2  # the frame of `inner` itself is 1
    assert inside["outer"]() == 3
