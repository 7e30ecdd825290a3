"""What the raw outputs of networks mean."""

from __future__ import annotations

import numpy as np
from scipy.special import softmax

from rpil.data.spaces import Box
from rpil.policies.heads import SoftmaxHead, StudentHead
from rpil.policies.student import StudentPolicy

RAW = np.random.default_rng(0).normal(size=(4, 10, 3))


def test_softmax_head_averages_probabilities():
    head = SoftmaxHead(3)
    mean = head.average(head.read(RAW))
    np.testing.assert_allclose(np.exp(mean), softmax(RAW, axis=-1).mean(axis=0))
    assert head.log_prob(mean, np.full(10, 2))[4] == mean[4, 2]


def test_student_head_reads_outputs_in_the_units_of_the_box():
    box = Box(np.array([-1.0, 0.0, 2.0]), np.array([1.0, 10.0, 3.0]))
    head = StudentHead(box, StudentPolicy.zero(box, np.zeros(1), 1.0))
    assert head.width == 3
    means = head.read(np.array([[[-1.0, -1.0, -1.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]]))
    np.testing.assert_allclose(means[0], [box.low, (box.low + box.high) / 2, box.high])
    np.testing.assert_allclose(head.average(head.read(RAW)), head.read(RAW).mean(axis=0))
