"""Shapes in types are checked while the tests run."""

import runpy
import sys

import numpy as np
import pytest
from jaxtyping import TypeCheckError

import typecheck
from rpil.numerics import types
from rpil.numerics.blocks import at_actions


def test_first_calls_of_each_test_are_checked():
    with pytest.raises(TypeCheckError):
        at_actions(np.zeros((3, 2)), np.zeros(4, dtype=int))
    for _ in range(typecheck.CHECKED_CALLS - 1):
        at_actions(np.zeros((3, 2)), np.zeros(3, dtype=int))
    at_actions(np.zeros((3, 2)), np.zeros(3, dtype=object).astype(int).reshape(3))
    with pytest.raises(IndexError):  # NumPy's own, for no type is checked any more
        at_actions(np.zeros((3, 2)), np.zeros(3))


def test_users_without_jaxtyping_have_the_array_type_alone(monkeypatch):
    monkeypatch.delitem(sys.modules, "jaxtyping")
    own = runpy.run_path(types.__file__)
    assert own["Float"][own["Array"], "N D"] is np.ndarray
