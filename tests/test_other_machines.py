"""`tools/other_machines.py`: it is on the machine that it says, and tells what differs there."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import pytest

from command_line import npz


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "tools"))
    return import_module("other_machines")


@pytest.mark.parametrize(
    ("simd", "no_avx512", "no_avx2"),
    [
        (["X86_V3", "X86_V4", "AVX512_ICL"], "X86_V4 AVX512_ICL", "X86_V3 X86_V4 AVX512_ICL"),
        (["SSE42", "AVX", "FMA3", "AVX2"], None, "FMA3 AVX2"),
        (["ASIMDHP"], None, None),
    ],
)
def test_numpy_is_left_what_the_machine_has(tool, monkeypatch, simd, no_avx512, no_avx2, capsys):
    monkeypatch.setattr(tool, "simd_families", lambda: simd)
    found = {machine.name: machine for machine in tool.chosen("no-avx512,no-avx2")}
    said = capsys.readouterr().out
    for name, left_out in (("no-avx512", no_avx512), ("no-avx2", no_avx2)):
        if left_out is None:
            assert f"{name}: skipped" in said
        else:
            assert found[name].variables == {"NPY_DISABLE_CPU_FEATURES": left_out}


def test_a_processor_stands_for_no_newer_one(tool, monkeypatch, capsys):
    monkeypatch.setattr(tool, "processor_flags", lambda: frozenset({"pni", "sse4_2", "avx2"}))
    names = [machine.name for machine in tool.chosen("prescott,nehalem,haswell,skylakex,sigint")]
    assert names == ["prescott", "nehalem", "sigint"]
    said = capsys.readouterr().out
    assert "haswell: skipped, this processor has no fma" in said
    assert "skylakex: skipped, this processor has no avx512f" in said
    with pytest.raises(SystemExit, match="choose among plain, prescott"):
        tool.chosen("pentium")


def test_findings_pairs_and_words_are_compared(tool):
    plain = {"set": {"finding": "in doubt", "pair": ["1", "2"], "words": {"1": "open", "2": "open"}}}
    other = {"set": {"finding": "two groups", "pair": ["2", "1"], "words": {"1": "open", "2": "outlier"}}}
    assert tool.differences(plain, plain) == []
    assert [line.partition(",")[0] for line in tool.differences(plain, other)] == [
        "set: the finding is two groups",
        "set: the pair is ['2'",
        "set: 2 is outlier",
    ]


def test_a_machine_that_is_not_as_asked_is_told(tool):
    machine = tool.Machine("x", {tool.CHOICES[1]: "X86_V4"}, kernels=frozenset({"Haswell"}))
    made = {"kernels": {"libscipy.so": "SkylakeX", "libnumpy.so": "Haswell"}, "simd": ["X86_V4"], "interruptible": True}
    assert tool.not_as_asked(machine, made) == [
        "OPENBLAS_CORETYPE has no effect in libscipy.so: SkylakeX",
        "NPY_DISABLE_CPU_FEATURES has no effect on X86_V4",
    ]
    made = {"kernels": {"a.so": "Haswell"}, "simd": [], "interruptible": False}
    assert tool.not_as_asked(machine, made) == ["SIGINT is not as it should be"]


IGNORED = """
import signal

def test_it():
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
"""


@pytest.mark.slow
def test_sets_are_judged_and_tests_run_on_each_machine(tool, monkeypatch, tmp_path, capsys):
    npz(tmp_path / "small.npz")
    (tmp_path / "test_ignored.py").write_text(IGNORED)
    monkeypatch.setattr(tool, "SETS", ("small",))

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["other_machines.py", *map(str, words)])
        return tool.main(), capsys.readouterr().out

    code, said = run("--sets", "--only", "prescott,sigint", "--data", tmp_path)
    assert code == 0
    assert "small: nothing could be learned; 6 open; pair" in said
    assert said.count("1 sets: 0 differences") == 2
    code, said = run("--tests", tmp_path / "test_ignored.py", "--only", "plain,sigint")
    assert (code, said.count("1 passed"), said.count("1 failed")) == (1, 1, 1)
    assert "FAILED" in said
    assert "1 differences and failures" in said
