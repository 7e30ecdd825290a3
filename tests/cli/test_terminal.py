"""An audit as sentences for the terminal."""

from __future__ import annotations

import pytest

from audits import make_audit
from rpil.audit.label_choice import NEXT_STEPS
from rpil.cli import terminal
from rpil.inference.trust import FINDINGS


@pytest.mark.parametrize("finding", ["nobody stands out", "nothing could be learned"])
def test_every_finding_has_a_sentence_and_a_next_step(finding, capsys):
    verdicts = ("uncertain",) * 9 + ("expert",)
    terminal.print_audit(make_audit(verdicts, finding=finding, labelled=(9,), lengths=[10] * 10))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"{finding.capitalize()}: {FINDINGS[finding]}"
    assert lines[-1].startswith("10 demonstrations (100 steps) are ranked")
    assert lines[-1].endswith("except on labelled ones.")
    assert terminal.next_step(make_audit(finding=finding)) == f"Next: {NEXT_STEPS[finding]}"
