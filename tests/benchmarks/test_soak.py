"""The soak of `benchmarks/soak.py`: a few audits and answers leave nothing behind, and growth is seen."""

from __future__ import annotations

import sys

import pytest

import soak


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_audits_and_answers_leave_no_file_and_no_thread():
    settled, last = soak.soak(10, 2, show=False)
    assert soak.faults(settled, last, most_growth=0.1) == []  # ten audits are few: allocators still grow


def test_growth_is_seen():
    before = {"MB": 200.0, "files": 8, "threads": 1}
    assert soak.faults(before, before | {"MB": 203.9}) == []
    assert len(soak.faults(before, {"MB": 204.1, "files": 9, "threads": 2})) == 3
