"""Saved models of `golden`, written by an earlier state of the code: they load, and say what they said then.

``tools/make_golden.py`` wrote them. Where one no longer loads, either a class of `rpil` got another name in files,
which is to be undone, or the format has changed, which asks for another version of it and for files written anew.
"""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sklearn.metrics.pairwise import rbf_kernel

import rpil
from archives import members
from problems import coefficients

GOLDEN = Path(__file__).parent / "golden"
EXPECTED = json.loads((GOLDEN / "expected.json").read_text(encoding="utf-8"))
OBSERVATIONS = np.array(EXPECTED["observations"])
FILES = sorted(path.name for path in GOLDEN.glob("*.rpil"))


def same(found, expected, rounding):
    """Numbers but for rounding; texts as they are."""
    expected = np.asarray(expected)
    if expected.dtype.kind == "U":
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=rounding)


def rounding_of(model):
    """How much the outputs of a model may differ between processors, whose kernels sum in other orders.

    Nystroem's features are sums of similarities times large numbers of both signs. The condition number of such a sum
    is that of the sizes of its terms; times the machine epsilon it is the rounding to expect.
    """
    features = model.features_
    if features.kind != "nystroem":
        return 1e-12
    z = (OBSERVATIONS - features.location) / features.spread
    folded = np.hstack([z, np.abs(z)])
    similarity = rbf_kernel(folded, features.landmarks, gamma=features.kernel_width / folded.shape[1])
    of_features = np.abs(coefficients(model)[0][:, -len(features.landmarks) :].T)
    return np.finfo(float).eps * float((similarity @ np.abs(features.mixing) @ of_features).max())


def test_a_fresh_process_loads_every_file_and_none_is_missing():
    """Nothing but what `rpil.load` itself imports is there; the order has no kind of model first for all the others."""
    assert sorted(EXPECTED["models"]) == FILES
    names = sorted(FILES, key=lambda name: hashlib.sha256(name.encode()).digest())
    program = "import sys, rpil\nfor path in sys.argv[1:]: rpil.load(path)"
    subprocess.run([sys.executable, "-c", program, *(str(GOLDEN / name) for name in names)], check=True)


@pytest.mark.parametrize("file", FILES)
def test_it_says_what_it_said_and_is_saved_as_it_was(file, tmp_path):
    """An older rpil of the same format reads what this one writes."""
    model, expected = rpil.load(GOLDEN / file), EXPECTED["models"][file]
    rpil.save(model, tmp_path / file)
    assert parts(tmp_path / file) == parts(GOLDEN / file)
    assert type(model).__name__ == expected["class"]
    assert isinstance(model, getattr(rpil, expected["class"]))
    rounding = rounding_of(model)
    assert rounding < 1e-9
    same(model.predict(OBSERVATIONS), expected["predict"], rounding)
    if "predict_proba" in expected:
        same(model.predict_proba(OBSERVATIONS), expected["predict_proba"], rounding)


def parts(path):
    content = members(path)
    header = json.loads(content.pop("header.json"))
    del header["rpil"]  # which wrote it
    return header, content


def test_a_file_of_the_version_before_is_refused_in_one_sentence():
    with pytest.raises(rpil.DataError, match=r"discrete_rment\.rpil: rpil .* saved it in version 7 of the format"):
        rpil.load(GOLDEN / "version_7" / "discrete_rment.rpil")
