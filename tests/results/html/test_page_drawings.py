"""Drawings of steps: binned, packed into bytes, and unpacked again without more error than a level."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from audits import make_audit
from rpil.results.html.page import LEVELS, NO_VALUE, drawings, packed
from rpil.results.judged import MAX_POINTS, bin_starts


def unpacked(curves, name):
    codes = np.frombuffer(base64.b64decode(curves[name]), dtype=np.uint8)
    values = curves["from"] + codes / LEVELS * (curves["to"] - curves["from"])
    return np.where(codes == NO_VALUE, np.nan, values)


def test_packed_curves_share_a_scale_and_keep_what_is_missing():
    one, other = np.array([0.0, 5.0, np.nan, 10.0]), np.array([-10.0, 2.5, np.inf, 1.0])
    curves = packed({"one": one, "other": other})
    level = 20 / LEVELS
    np.testing.assert_allclose(unpacked(curves, "one"), one, atol=level / 2 + 1e-9)
    np.testing.assert_allclose(unpacked(curves, "other"), [-10.0, 2.5, np.nan, 1.0], atol=level / 2 + 1e-9)
    assert (curves["from"], curves["to"]) == (-10.0, 10.0)


def test_drawing_has_the_steps_of_its_demonstration():
    audit = make_audit(("open", "outlier"), lengths=[40, 1200])
    drawn = drawings(audit, [1])["1"]
    ratio, trust = audit.step_log_ratio[40:].reshape(400, 3), audit.step_trust(1).reshape(400, 3)
    level = (ratio.max() - ratio.min()) / LEVELS
    for name, values in (("min", ratio.min(1)), ("mean", ratio.mean(1)), ("max", ratio.max(1))):
        np.testing.assert_allclose(unpacked(drawn["ratio"], name), values, atol=level)
    np.testing.assert_allclose(unpacked(drawn["trust"], "mean"), trust.mean(1), atol=1 / LEVELS)


@pytest.mark.parametrize("n_steps", [1, 7, MAX_POINTS, MAX_POINTS + 1, 12345])
def test_points_are_nearly_equal_and_hold_every_step(n_steps: int) -> None:
    starts = bin_starts(n_steps)
    widths = np.diff(np.append(starts, n_steps))
    assert (len(starts), starts[0]) == (min(n_steps, MAX_POINTS), 0)
    assert widths.min() >= 1
    assert widths.max() - widths.min() <= 1
