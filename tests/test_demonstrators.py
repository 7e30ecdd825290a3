"""Who gave which demonstration: exact sums, shrinkage both ways, and no harm where it means nothing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from problems import make
from rpil import RPIL, DataError, load, save
from rpil.data import formats
from rpil.data.demonstrators import Demonstrators


def test_demonstrators_inform_only_where_two_or_more_gave_two_or_more():
    for names, reason in (("aaaa", "One demonstrator, 'a', gave all"), ("abcd", "No demonstrator gave two")):
        assert not Demonstrators.from_names(names).informative
        assert reason in Demonstrators.from_names(names).note
    assert Demonstrators.from_names("aab").informative
    assert not Demonstrators().note
    assert not Demonstrators.from_names([None] * 4).informative  # unknown demonstrators are not one and the same
    assert Demonstrators.from_names(["a", None, "a", None]).index.tolist() == [0, 1, 0, 2]


# --- a fit ----------------------------------------------------------------------------------------------------------


def people(seed: int = 0, short: int = 8):
    """Ann gives good demonstrations and Bob random ones; then short good ones by Ann, Bob and somebody unknown."""
    toy = make("random", seed, n_good=9, n_bad=6, steps=(40, 40))
    lengths = np.diff(toy.offsets)
    kept = np.concatenate([np.arange(40) < (40 if not 6 <= m < 9 else short) for m in range(15)])
    first = toy.offsets[6]  # the same steps for all three
    observations, actions = toy.observations.copy(), toy.actions.copy()
    for m in (7, 8):
        observations[toy.offsets[m] : toy.offsets[m] + short] = observations[first : first + short]
        actions[toy.offsets[m] : toy.offsets[m] + short] = actions[first : first + short]
    ids = np.repeat(np.arange(15), lengths)
    who = {**dict.fromkeys(range(7), "Ann"), 7: "Bob", **dict.fromkeys(range(9, 15), "Bob")}
    return observations[kept], actions[kept], ids[kept], who


@pytest.fixture(scope="module")
def fitted():
    X, y, groups, who = people()
    return RPIL().fit(X, y, groups, demonstrators=who)


def test_a_short_demonstration_borrows_from_its_demonstrator(fitted):
    audit = fitted.audit_
    known_good, known_bad, unknown = audit.log_odds[[6, 7, 8]]
    assert known_good > unknown + 0.5 > known_bad + 1.0
    ann, bob = audit.demonstrators
    assert (ann.name, bob.name) == ("Ann", "Bob")  # whoever is unknown is not listed
    assert (ann.n_demonstrations, ann.experts) == (7, 7)
    assert bob.adversaries >= 6
    assert ann.trust.low > bob.trust.high
    assert any("speak for each other" in said for said in audit.assumptions)
    told = json.loads(json.dumps(audit.to_dict(), allow_nan=False))["demonstrators"]
    assert told[0]["name"] == "Ann"
    assert told[0]["trust"].keys() == {"mean", "low", "high"}


def test_saving_keeps_them(fitted, tmp_path):
    save(fitted, tmp_path / "model")
    loaded = load(tmp_path / "model")
    assert loaded.audit_.demonstrators == fitted.audit_.demonstrators


def test_useless_demonstrators_change_no_bit():
    X, y, groups, _ = people()
    model = RPIL()
    alone = model.fit(X, y, groups).log_odds_
    for useless, said in ((["Ann"] * 15, "One demonstrator"), (range(15), "No demonstrator gave two")):
        with pytest.warns(UserWarning, match=said):
            model.fit(X, y, groups, demonstrators=useless)
        np.testing.assert_array_equal(model.log_odds_, alone)
        assert model.audit_.demonstrators == ()
        assert any(said in sentence for sentence in model.audit_.assumptions)


@pytest.mark.parametrize(
    ("demonstrators", "match"),
    [
        ({99: "Ann"}, "no demonstration is called '99'; the ids are '0', '1', '2', '3', '4', ...; correct the demonst"),
        ({0: ["Ann"]}, r"demonstration 0: the demonstrator \['Ann'\] is no name; give text or a number"),
        (["Ann", "Bob"], r"shape \(2,\); give one for each of the 15 demonstrations"),
        (np.zeros((15, 2)), r"shape \(15, 2\)"),
    ],
)
def test_bad_input_is_one_sentence(demonstrators, match):
    X, y, groups, _ = people()
    with pytest.raises(DataError, match=match) as error:
        RPIL().fit(X, y, groups, demonstrators=demonstrators)
    assert ". " not in str(error.value)


# --- files ----------------------------------------------------------------------------------------------------------


def test_reading_demonstrators(tmp_path):
    (tmp_path / "who.csv").write_text("id,demonstrator\n0,Ann\n1, Bob\n")
    (tmp_path / "who.json").write_text('{"0": "Ann", "1": "Bob"}')
    np.savez(tmp_path / "each.npz", episode_ids=np.repeat([5, 2], 3), who=np.array(["x", "y"]), n=np.zeros((2, 2)))
    (tmp_path / "data.csv").write_text("episode_index,who,action\n0,Ann,1\n0,Ann,0\n1,Bob,0\n")
    (tmp_path / "two.csv").write_text("episode_index,who,action\n0,Ann,1\n0,Bob,0\n1,,0\n")
    for name in ("who.csv", "who.json"):
        assert formats.read_demonstrators(str(tmp_path / name), tmp_path / "data.csv") == {"0": "Ann", "1": "Bob"}
    assert formats.read_demonstrators("who", tmp_path / "data.csv") == {"0": "Ann", "1": "Bob"}
    assert formats.read_demonstrators("who", tmp_path / "each.npz") == {"5": "x", "2": "y"}
    formats.write(tmp_path / "data.parquet", formats.read(_npz(tmp_path)), {"demonstrator_ids": np.array([3.0, 4.0])})
    assert formats.read_demonstrators("demonstrator_ids", tmp_path / "data.parquet") == {"0": "3", "1": "4"}
    for where, file, match in (
        ("who", "two.csv", "'0': both 'Ann' and 'Bob' gave it"),
        ("nothing", "data.csv", "holds no 'nothing'"),
        ("n", "each.npz", r"shape \(2, 2\)"),
        (str(tmp_path / "missing.csv"), "data.csv", "no such file"),
        (str(tmp_path / "data.csv"), "data.csv", "columns must be id and demonstrator"),
    ):
        with pytest.raises(DataError, match=match):
            formats.read_demonstrators(where, tmp_path / file)


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("empty.csv", "", "the file is empty; write it again"),
        ("nobody.csv", "id,demonstrator\n", "it names no demonstrator; give at least one"),
        ("nobody.json", "{}", "it names no demonstrator; give at least one"),
        ("column.csv", "id,who\n0,Ann\n", "the columns must be id and demonstrator .found 'id', 'who'"),
        ("two.csv", "id,demonstrator\n0,Ann\n0,Bob\n", "demonstration '0': both 'Ann' and 'Bob' gave it; name one"),
        ("two.json", '{"0": "Ann", "0": "Bob"}', "demonstration '0': both 'Ann' and 'Bob' gave it; name one"),
        ("short.csv", "id,demonstrator\n0\n", "demonstration '0': it has no demonstrator; name one, or leave it out"),
        ("long.csv", "id,demonstrator\n0,Ann,Bob\n", "line 2: it has more values than there are columns; give"),
        ("no-id.csv", "id,demonstrator\n,Ann\n", "line 2: it names no demonstration; give"),
        ("null.json", '{"0": null}', "demonstration '0': the demonstrator is neither text nor a whole number"),
        ("list.json", '["Ann"]', "it must hold one object"),
        ("cut.json", '{"0": "Ann"', "it cannot be read as JSON; write it again"),
        ("bytes.csv", b"\xff\xfe\x00", "it cannot be read as CSV; write it again"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, name, content, match):
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(DataError, match=f"{name}.*{match}") as error:
        formats.read_demonstrators(str(tmp_path / name), _npz(tmp_path))
    assert ". " not in str(error.value)


def _npz(folder):
    path = folder / "small.npz"
    np.savez(path, observations=np.eye(4), actions=np.array([0, 1, 0, 1]), episode_ids=np.repeat([0, 1], 2))
    return path
