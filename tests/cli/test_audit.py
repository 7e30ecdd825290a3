"""rpil audit: the finding, the ranking, JSON, reports, weights, and groups of which one must be labelled."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
from pathlib import Path

import click
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from browser import browsing, needs_chromium
from command_line import at_terminal, npz, ok
from problems import make_continuous
from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.persistence import load


def test_commands_with_continuous_actions():
    name = "swings.csv"
    toy = make_continuous("random", 0, n_good=10, n_bad=10, steps=(40, 60))
    formats.write(Path(name), Demonstrations.from_arrays(toy.observations, toy.actions, toy.offsets), {})
    audit = json.loads(ok("audit", name, "--json", "--report", "r.html", "--weights", "w.csv").stdout)
    verdicts = {entry["id"]: entry["verdict"] for entry in audit["demonstrations"]}
    assert [verdicts[m] for m in range(20)] == np.where(toy.is_good, "similar", "outlier").tolist()
    page = Path("r.html").read_text()
    assert name in page
    assert re.search(r"\bnan\b", page) is None
    assert len(Path("w.csv").read_text().splitlines()) == len(toy.actions) + 1
    ok("fit", name, "-o", "policy", "--features", "raw")
    assert load("policy").predict(toy.observations).shape == toy.actions.shape
    other = json.loads(ok("audit", name, "--json", "--adversary", "own-policy").stdout)
    assert other["adversary"] == "own policy"


def printed_ranking(result):
    """The rows of the table, and the titles of its columns."""
    lines = result.stdout.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("id "))
    stop = next(k for k in range(start, len(lines)) if re.match(r"\d+ demonstrations \(", lines[k]))
    return re.split(r"\s{2,}", lines[start].strip()), [re.split(r"\s{2,}", line) for line in lines[start + 1 : stop]]


def test_audit_prints_finding_table_and_next_step(folder):
    result = ok("audit", folder / "good.parquet")
    titles, rows = printed_ranking(result)
    assert "\n6 of 12 act differently from the rest: " in result.stdout
    assert titles[:3] == ["id", "verdict", "score"]
    assert [int(row[0]) < 6 for row in rows] == [False] * 6
    scores = [float(row[2]) for row in rows]
    assert scores == sorted(scores)
    assert "P(similar)" not in result.stdout
    assert "\n12 demonstrations (1,160 steps): 6 similar, 6 outliers. All: --all.\n" in result.stdout
    assert "\nNo recording faults found.\n" in result.stdout
    assert "\nWhich is better: " in result.stdout
    assert result.stderr == ""
    lines = ok("audit", folder / "good.parquet", "--quiet").stdout.splitlines()
    assert lines == result.stdout.splitlines()[: len(lines)]
    assert not re.search("Which is better|Then run", "\n".join(lines))


def test_parts_of_the_score_add_up(folder):
    Path("labels.csv").write_text("id,label\n3,good\n9,bad\n")
    who = "".join(f"{m},{'abcd'[m // 3]}\n" for m in range(12))
    Path("who.csv").write_text(f"id,demonstrator\n{who}")
    told = "audit", folder / "good.parquet", "--demonstrators", "who.csv"
    titles, rows = printed_ranking(ok(*told, "--labels", "labels.csv", "--all", "--verdicts", "v.csv"))
    assert titles == ["id", "place", "verdict", "score", "P(good)", "why"]
    table = pa.csv.read_csv("v.csv").to_pydict()
    parts = [np.array(table[f"from_{part}"]) for part in ("actions", "demonstrator", "label")]
    np.testing.assert_allclose(sum(parts), table["log_odds"], atol=1e-9)
    of_operator = dict(zip(table["id"], parts[1], strict=True))
    assert all((of_operator[m] > 0) == (m < 6) for m in range(12) if m not in (3, 9))
    assert {int(row[0]): float(row[3]) for row in rows} == pytest.approx(
        dict(zip(table["id"], table["log_odds"], strict=True)), abs=0.06
    )
    without = ok(*told, "--all").stdout
    assert "\nOutliers by operator: c 3 of 3, d 3 of 3.\n" in without
    assert re.search(r"^c: \d\.\d\d of the median length", without, re.MULTILINE)
    assert "--session operator" in without


def test_audit_without_groups_prints_no_verdicts():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(1200, 2))
    y = (x[:, 0] + rng.logistic(size=1200) > 0).astype(int)  # all act by one policy
    npz("data.npz", observations=x, actions=y, episode_ids=np.repeat(np.arange(20), 60))
    result = ok("audit", "data.npz")
    assert "\nNo outliers: nobody differs clearly; here is a ranking, and no verdicts.\n" in result.stdout
    assert "\n20 demonstrations (1,200 steps) are ranked; all are open. All: --all.\n" in result.stdout
    titles, rows = printed_ranking(result)
    assert titles[:3] == ["id", "place", "score"]  # and no probability, where there is no verdict
    assert [row[1] for row in rows] == [str(place) for place in range(20, 12, -1)]
    titles, rows = printed_ranking(ok("audit", "data.npz", "--all"))
    assert "P(similar)" not in titles
    assert [row[1] for row in rows] == [str(place) for place in range(20, 0, -1)]


def test_audit_prints_json(folder):
    result = ok("audit", folder / "good.parquet", "--json")
    assert result.stderr == ""
    audit = json.loads(result.stdout, parse_constant=pytest.fail)
    # The issue's, and what is needed where the data do not settle it.
    assert list(audit) == [
        "schema",
        "run", "input", "n_demonstrations", "n_steps", "finding", "anchor", "adversary", "prior", "identifiable",
        "groups", "pair", "question", "doubts", "notes", "contradicting", "assumptions", "demonstrations",
        "demonstrators", "provenance", "faults", "keep",
    ]  # fmt: skip
    assert audit["provenance"]["command"] == f"rpil audit {folder / 'good.parquet'} --json"
    digest = hashlib.sha256((folder / "good.parquet").read_bytes()).hexdigest()
    assert [file["sha256"] for file in audit["provenance"]["files"]] == [digest]
    assert audit["faults"]["findings"] == []
    assert audit["n_demonstrations"] == 12
    assert audit["n_steps"] == formats.read(folder / "good.parquet").n_steps
    assert audit["finding"] == "outliers"
    assert audit["prior"].keys() == {"mean", "low", "high"}
    assert 0 < audit["prior"]["low"] < audit["prior"]["mean"] < audit["prior"]["high"] < 1
    assert audit["identifiable"] is True
    assert len(audit["demonstrations"]) == 12
    for entry in audit["demonstrations"]:
        kinds = {
            "id": int, "n_steps": int, "log_odds": float, "evidence": dict, "expert_proba": float, "reliability": float,
            "rank": int, "verdict": str, "label": str, "said": str, "rejected_by": str, "reason": str,
            "worst_steps": list, "facts": dict,
        }  # fmt: skip
        assert {key: type(value) for key, value in entry.items()} == kinds
        assert entry["verdict"] == ("similar" if entry["id"] < 6 else "outlier")
        assert list(entry["evidence"]) == ["actions", "demonstrator", "label"]
        assert sum(entry["evidence"].values()) == pytest.approx(entry["log_odds"], abs=1e-9)
        assert all(0 <= step < entry["n_steps"] for step in entry["worst_steps"])
    assert ok("audit", folder / "good.parquet", "--json", "--quiet").stdout == result.stdout
    other = ok("audit", folder / "good.parquet", "--json", "--adversary", "normalised-complement")
    assert json.loads(other.stdout)["adversary"] == "normalised complement"


def test_audit_does_not_choose_features(folder, monkeypatch):
    def never(*_):
        pytest.fail("features were chosen")

    def printed(*more):
        found = json.loads(ok("audit", folder / "good.parquet", "--json", *more).stdout)
        assert found["provenance"].pop("command").endswith(" ".join(["--json", *more]))
        return found

    folded = printed("--features", "folded")
    chosen = load(folder / "policy").audit_.to_dict()
    monkeypatch.setattr("rpil.estimators.final_policy.choose_features", never)
    assert printed() == folded
    for rows in (folded["demonstrations"], chosen["demonstrations"]):
        for row in rows:
            del row["reason"]  # it may quote the final policy, which is of the chosen features
    assert folded["demonstrations"] == chosen["demonstrations"]


def test_audit_writes_a_report_and_weights(folder):
    Path("labels.csv").write_text("id,label\n0,good\n9,bad\n")
    told = ["audit", folder / "good.parquet", "--labels", "labels.csv"]
    result = ok(*told, "--json", "--report", "r.html", "--weights", "w.parquet")
    json.loads(result.stdout)
    *written, note = result.stderr.splitlines()
    assert written == ["Weights: w.parquet", "Report: r.html"]
    assert note.startswith("note: w.parquet: every step weighs the same")
    assert "good.parquet" in Path("r.html").read_text()
    weights = pq.read_table("w.parquet").to_pydict()
    assert list(weights) == ["episode_index", "step_index", "weight", "expert_proba", "log_odds"]
    demonstrations = formats.read(folder / "good.parquet")
    assert weights["episode_index"] == np.repeat(demonstrations.ids, demonstrations.lengths).tolist()
    good = np.array(weights["episode_index"]) < 6
    assert np.mean(np.array(weights["weight"])) == pytest.approx(1)
    assert np.array(weights["weight"])[good].min() > np.array(weights["weight"])[~good].max()
    result = ok(*told, "--weights", "w.csv", "--features", "nystroem")
    assert "Weights: w.csv" in result.stdout
    assert pa.csv.read_csv("w.csv").num_rows == demonstrations.n_steps


def proposed_labels_file(result):
    """The labels file that is printed to be pasted."""
    return [line[4:] for line in result.stdout.partition("Then run: ")[0].splitlines() if line.startswith("    ")]


def test_answered_question_decides_between_two_groups(folder):
    file = folder / "shifted.parquet"
    result = ok("audit", file, "--seed", 2)
    printed = " ".join(result.stdout.split())
    assert "Two groups act differently: 6 and 6; without an answer nobody can say which is good." in printed
    groups = re.findall(r"Group [AB], 6: ([\d, ]+)", result.stdout)
    assert sorted(sorted(map(int, group.split(", "))) for group in groups) == [[*range(6)], [*range(6, 12)]]
    first, second = map(int, re.search(r"Which is better: (\d+).*? or (\d+).*?\?", printed).groups())
    assert (first < 6) != (second < 6)
    assert "are ranked; all are open." in result.stdout
    assert "\nThe two groups: " in result.stdout
    assert result.stderr == ""
    again = result.stdout.partition("Then run: ")[2]
    assert shlex.split(again) == ["rpil", "audit", str(file), "--seed", "2", "--labels", "labels.csv"]
    assert proposed_labels_file(result) == ["id,label", f"{first},better than {second}"]
    better, worse = sorted((first, second))
    Path("labels.csv").write_text(f"id,label\n{better},good\n{worse},bad\n")
    result = ok(*shlex.split(again)[1:], "--json")
    audit = json.loads(result.stdout)
    assert audit["identifiable"] is True
    assert (audit["finding"], audit["anchor"]) == ("answered", "answers")
    assert result.stderr == ""
    for entry in audit["demonstrations"]:
        assert entry["verdict"] in (("good" if entry["id"] < 6 else "bad"), "open")
    ranking = [entry["id"] for entry in audit["demonstrations"]]
    assert sorted(ranking[:6]) == [*range(6)]


def test_two_groups_in_json(folder):
    result = ok("audit", folder / "shifted.parquet", "--json")
    audit = json.loads(result.stdout)
    assert audit["identifiable"] is False
    assert audit["finding"] == "two groups"
    assert sorted(map(sorted, audit["groups"])) == [[*range(6)], [*range(6, 12)]]
    assert [name in group for name, group in zip(audit["pair"], audit["groups"], strict=True)] == [True, True]
    assert audit["doubts"] == audit["contradicting"] == []
    assert all(note.startswith("The two groups: ") for note in audit["notes"])
    assert len(audit["notes"]) == 2
    assert result.stderr == ""


@pytest.mark.slow
@needs_chromium
def test_marks_made_in_the_report_are_labels_of_the_next_audit(folder, tmp_path):
    data = folder / "good.parquet"
    before = json.loads(ok("audit", data, "--report", "r.html", "--json").stdout)
    with browsing(tmp_path / "profile") as browser:
        browser.send("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
        browser.open(Path("r.html"))
        browser.click('[data-filter=verdict][data-value="outlier"]')
        browser.press("b", "j", "b", "Escape")
        browser.click('[data-filter=verdict][data-value="similar"]')
        browser.press("g")
        marked = "document.querySelector('[data-role=marked]').innerText === 'Your marks: 1 good, 2 bad.'"
        browser.wait(marked)
        browser.reload()
        browser.wait(marked)
        browser.click("[data-role=labels]")
        file = tmp_path / "labels.csv"
        while not (file.exists() and file.stat().st_size):  # Chromium holds the name by an empty file first
            browser.evaluate("new Promise(done => setTimeout(done, 20))")
        assert browser.errors == []
    after = json.loads(ok("audit", data, "--labels", tmp_path / "labels.csv", "--json").stdout)
    assert after["anchor"] == "answers"
    assert (tmp_path / "labels.csv").read_text().count("bad") == 2
    old, new = ({one["id"]: one["log_odds"] for one in each["demonstrations"]} for each in (before, after))
    assert all(abs(old[name] - new[name]) > 0.01 for name in old)


@pytest.mark.slow
@pytest.mark.parametrize("width", [80, 200])
def test_the_table_fits_a_terminal_and_no_id_is_wrapped(folder, width):
    table = pq.read_table(folder / "good.parquet")
    ids = [f"operator_{m % 3}/drive_{m:03}" for m in table["episode_index"].to_pylist()]
    place = table.column_names.index("episode_index")
    pq.write_table(table.set_column(place, "episode_index", pa.array(ids)), "named.parquet")
    Path("labels.csv").write_text(f"id,label\n{ids[0]},good\n{ids[-1]},bad\n")
    Path("operators.csv").write_text("id,demonstrator\n" + "".join(f"{m},{m[:10]}\n" for m in dict.fromkeys(ids)))
    options = ["--labels", "labels.csv", "--operator", "operators.csv", "--quiet", "--all"]
    lines = at_terminal(width, "audit", "named.parquet", *options).splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("id"))
    rows = lines[start + 1 : start + 13]
    assert {row.split()[0] for row in rows} == {*ids}
    assert all(len(click.unstyle(line)) <= width for line in lines[start : start + 13])
    assert all(re.search(r"\b(good|open|bad|similar|outlier)\b", row) for row in rows)
