"""`rpil.audit` says what the command says, of a path and of what is in memory."""

import hashlib
import json
import re

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import rpil
from command_line import ok
from problems import make, make_continuous
from rpil.data.errors import DataError
from rpil.formats import table as flat
from rpil.formats.recording import from_demonstrations, from_tables
from small import FAST, SMALL


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Demonstrations of two operators, as CSV and Parquet, with columns of other names than usual."""
    demonstrations = make("random", 0, n_good=8, n_bad=3, steps=(20, 30)).demonstrations
    table = flat.from_demonstrations(demonstrations, {}).rename_columns({"episode_index": "trip", "action": "steer"})
    who = pa.array(["Ann" if int(name[1:]) % 2 else "Bob" for name in table["trip"].to_pylist()])
    path = tmp_path_factory.mktemp("drives")
    pa.csv.write_csv(table.append_column("driver", who), path / "drive.csv")
    pq.write_table(table.append_column("driver", who), path / "drive.parquet")
    return path


COLUMNS = {"id": "trip", "action": "steer"}
OPTIONS = ["--id", "trip", "--action", "steer"]


def audit(data, *answers, **more):
    return rpil.audit(data, *answers, settings=FAST, **more)


def printed(path, *more):
    found = json.loads(ok("audit", path, *OPTIONS, *more, "--format", "json", "-q").stdout)
    of_the_command = ("schema", "run", "input", "faults", "provenance")
    return {name: value for name, value in found.items() if name not in of_the_command}


def said(found):
    rows = json.loads(json.dumps(found.to_dict()))
    rows.pop("provenance")
    return rows | {"keep": json.loads(json.dumps(found.choice.to_dict()))}


def test_it_says_what_the_command_says(folder):
    found = audit(folder / "drive.csv", **COLUMNS)
    assert said(found) == printed(folder / "drive.csv")
    assert np.ptp(found.log_odds) > 1
    of_operators = audit(folder / "drive.csv", operator="driver", **COLUMNS)
    assert said(of_operators) == printed(folder / "drive.csv", "--operator", "driver")
    assert len(of_operators.demonstrators) == 2
    np.testing.assert_array_equal(of_operators.log_odds, found.log_odds)  # without answers operators change none


@pytest.mark.parametrize(("settings", "maker"), [(FAST, make), (SMALL, make_continuous)])
def test_an_audit_is_that_of_a_fit_and_keeps_no_policy(settings, maker):
    toy, judged, fitted = maker("random", 0, n_good=80, n_bad=40, steps=(20, 60)), [], []
    data = from_tables(from_demonstrations(toy.demonstrations, "arrays"))
    audit = rpil.audit(data, settings=settings, progress=judged.append)
    model = rpil.RPIL("folded", settings=settings, progress=fitted.append).fit(data)
    np.testing.assert_array_equal(audit.step_weight, 1.0)
    assert (model.audit_.step_weight != 1).any(), "the learner does not wait for answers"
    assert audit.deviations == model.audit_.deviations
    assert "the policy" in fitted
    assert "the policy" not in judged
    assert ("a pass over everything: scores" in judged) == (settings is SMALL)


def test_answers_come_from_a_mapping_or_a_file(folder, tmp_path):
    ids = audit(folder / "drive.csv", **COLUMNS).ids
    (tmp_path / "labels.csv").write_text(f"id,label\n{ids[0]},good\n{ids[9]},bad\n{ids[1]},better than {ids[8]}\n")
    expected = printed(folder / "drive.csv", "--labels", tmp_path / "labels.csv")
    from_file = audit(folder / "drive.csv", labels=tmp_path / "labels.csv", **COLUMNS)
    assert said(from_file) == expected
    words = [(ids[0], "Expert"), (ids[9], "bad"), (ids[1], f"better than {ids[8]}")]
    assert said(audit(folder / "drive.csv", words, **COLUMNS)) == expected
    assert expected["finding"] == "answered"
    assert [file["path"] for file in from_file.provenance["files"]][1:] == [str(tmp_path / "labels.csv")]
    without = audit(folder / "drive.csv", tmp_path / "labels.csv", without=ids[9], **COLUMNS)
    assert np.flatnonzero(without.answers.labels).tolist() == [0]
    (ended := tmp_path / "ended.csv").write_text("id,value\n" + "".join(f"{m},{k % 3}\n" for k, m in enumerate(ids)))
    by_path, by_text = (audit(folder / "drive.csv", outcome=one, **COLUMNS) for one in (ended, str(ended)))
    assert (by_path.provenance, said(by_path)) == (by_text.provenance, said(by_text))
    model = rpil.RPIL(settings=FAST).fit(rpil.read(folder / "drive.csv", **COLUMNS), outcome=ended)
    np.testing.assert_array_equal(model.audit_.answers.outcomes, by_path.answers.outcomes)
    assert rpil.open(folder / "drive.csv", outcome=ended, **COLUMNS).options.files == [str(ended)]


def test_it_takes_what_is_in_memory(folder):
    from_path = audit(folder / "drive.parquet", **COLUMNS)
    in_memory = audit(pq.read_table(folder / "drive.parquet"), **COLUMNS)
    np.testing.assert_array_equal(in_memory.log_odds, from_path.log_odds)
    recording = rpil.open(folder / "drive.parquet", **COLUMNS)
    assert audit(recording).run_id == from_path.run_id
    demonstrations = recording.demonstrations.select(slice(None))
    found = audit(demonstrations)
    assert (found.run_id, found.ids) == (from_path.run_id, demonstrations.ids)
    for given, way in (({"id": "trip"}, r"\."), ({"outcome": "rewards"}, ", or give outcome a number for each")):
        with pytest.raises(DataError, match=f"Demonstrations has no columns to choose: name .* where it is read{way}"):
            audit(demonstrations, **given)


def test_it_says_where_it_comes_from(folder):
    path = folder / "drive.csv"
    made = audit(path, random_state=2, **COLUMNS).provenance
    assert made["command"] == f"rpil.audit({str(path)!r}, random_state=2, id='trip', action='steer')"
    assert made["seed"] == 2
    assert made["files"][0]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert made["settings"] == {"judge.groups.noise_shares": "(0.1,)"}
    for use in (rpil.audit, lambda data, settings: rpil.RPIL(settings=settings).fit(data)):
        with pytest.raises(DataError, match=r"^settings= is a dict; give rpil\.Settings\(\.\.\.\)\.$"):
            use(rpil.read(path, **COLUMNS), settings={"judge": {}})
    given = rpil.read(path, **COLUMNS)
    made = audit(given, outcome=np.arange(len(given)) / 7).provenance
    assert (made["files"], made["seed"], "\n" in made["command"]) == ([], 0, False)


@pytest.mark.parametrize(
    ("function", "options", "message"),
    [
        (rpil.audit, {"actions": "a"}, "there is no option 'actions'; did you mean action?"),
        (rpil.audit, {"label": {}}, "there is no option 'label'; did you mean labels?"),
        (rpil.open, {"id": "trip", "tasks": "x"}, "there is no option 'tasks'; did you mean task?"),
        (rpil.read, {"observation": "x"}, "there is no option 'observation'; did you mean observations?"),
        (rpil.read, {"lines": "x"}, "there is no option 'lines'"),
    ],
)
def test_an_unknown_option_is_named_with_the_one_that_was_meant(folder, function, options, message):
    with pytest.raises(TypeError, match=f"^{re.escape(message)}$"):
        function(folder / "drive.parquet", **options)
