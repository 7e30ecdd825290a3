"""``rpil keep`` and ``rpil convert``: the trusted demonstrations, and tables of all, as new files."""

from pathlib import Path

import numpy as np

from command_line import ok, refused
from rpil import formats


def test_keep_names_what_leaving_out_loses():
    rng = np.random.default_rng(0)
    starts = [*rng.normal(size=12), 90.0]
    rows = [f"{m},{start + rng.normal():.3f},{n % 2}" for m, start in enumerate(starts) for n in range(10)]
    Path("drive.csv").write_text("\n".join(["episode,side,action", *rows]) + "\n")
    Path("labels.csv").write_text("id,label\n12,bad\n" + "".join(f"{m},good\n" for m in range(12)))
    call = ["keep", "drive.csv", "--verdicts", "labels.csv", "-o"]
    first, *rejected, lost = ok(*call, "kept.csv").stdout.splitlines()
    assert first == "Kept 12 of 13 demonstrations: kept.csv"
    assert rejected == ["Rejected: 1 by your labels.", "  by your labels: 12"]
    assert lost.startswith("No kept demonstration starts with side above ")
    assert ok(*call, "again.csv", "-q").stdout.splitlines()[1:] == rejected
    audit = ["audit", "drive.csv", "--labels", "labels.csv", "--keep", "k.json"]
    said = ok(*audit, "--report", "r.html").stdout.splitlines()
    counts, _, again = said[(at := said.index("Keep: k.json")) + 1 : at + 4]
    assert (counts, again) == ("12 of 13 kept. Rejected: 1 by your labels.", lost)
    page = Path("r.html").read_text()
    assert page.index("What is lost without them") < page.index(lost)
    assert lost not in ok(*audit, "--quiet").stdout


def test_convert_writes_operator_and_task_of_each_demonstration():
    rows = [f"{m},{k},{k / 7},{m % 2},{'AB'[m % 2]},lift it" for m in range(4) for k in range(5)]
    Path("in.csv").write_text("\n".join(["run,t,x,turn,operator,task", *rows]) + "\n")
    ok("convert", "in.csv", "-o", "out.parquet", "--action", "turn", "--exclude", "t")
    assert dict(formats.read_demonstrators("operator", "out.parquet")) == {"0": "A", "1": "B", "2": "A", "3": "B"}
    assert formats.read_recording("out.parquet").tasks == dict.fromkeys("0123", "lift it")
    refused("named twice|would join", "convert", "in.csv", "-o", "in.csv")
