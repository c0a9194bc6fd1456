"""Beliefs: valid and invalid covariances."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.localization.ekf import Belief, covariance_square_root
from catoptra_protocol.errors import DomainError

ZERO = np.zeros((3, 3))


def is_covariance(matrix: np.ndarray) -> bool:
    return covariance_square_root(matrix)[1]


def test_belief_copies_freezes_and_wraps() -> None:
    mean = np.array([0.0, 0.0, 4.0])
    belief = Belief(mean, ZERO)
    mean[0] = 9.0
    assert belief.mean[0] == 0.0
    assert belief.mean[2] == pytest.approx(4.0 - 2 * math.pi)
    with pytest.raises(ValueError, match="read-only"):
        belief.covariance[0, 0] = 1.0


@pytest.mark.parametrize(
    ("mean", "covariance", "message"),
    [
        (np.zeros(2), ZERO, "not"),
        (np.zeros(3), np.zeros((2, 2)), "not"),
        (np.array([0.0, math.nan, 0.0]), ZERO, "finite"),
        (np.zeros(3), ZERO + math.inf, "finite"),
        (np.zeros(3), np.diag([1.0, -1e-6, 1.0]), "negative"),
        (np.zeros(3), np.array([[1, 2, 0], [2, 1, 0], [0, 0, 1.0]]), "negative"),
        (np.zeros(3), np.array([[0, 1, 0], [1, 1, 0], [0, 0, 1.0]]), "negative"),
    ],
)
def test_belief_rejects_an_invalid_covariance(mean, covariance, message) -> None:
    with pytest.raises(DomainError, match=message):
        Belief(mean, covariance)


@pytest.mark.parametrize("scale", [0.0, 1e-300, 1e-20, 1.0, 1e20, 1e300])
def test_definiteness_does_not_depend_on_scale(scale: float) -> None:
    good = np.array([[2, 1, 0], [1, 2, 1], [0, 1, 2.0]]) * scale
    assert is_covariance(good)
    if scale:
        assert not is_covariance(good - np.diag([0, 1.5, 0]) * scale)


def test_metres_do_not_hide_radians() -> None:
    covariance = np.diag([1e6, 1e6, 1e-12])
    covariance[2, 0] = covariance[0, 2] = 1.1e-3  # a correlation of 1.1
    assert not is_covariance(covariance)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_square_root_squares_to_the_covariance_at_any_rank(rank: int) -> None:
    factor = np.random.default_rng(rank).normal(size=(3, rank)) * np.array([[10], [1], [1e-4]])
    covariance = factor @ factor.T
    root, valid = covariance_square_root(covariance)
    assert valid
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-12, atol=1e-18)


def test_belief_keeps_a_read_only_square_root_of_its_covariance() -> None:
    covariance = np.array([[0.09, 0.03, 0.0], [0.03, 0.05, -0.002], [0.0, -0.002, 0.001]])
    belief = Belief(np.zeros(3), covariance)
    root = belief.square_root
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-13, atol=1e-16)
    with pytest.raises(ValueError, match="read-only"):
        root[0, 0] = 1.0
