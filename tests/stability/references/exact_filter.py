"""Textbook extended Kalman filter in 700 digits, where every form is exact enough.

Results are sigmas and correlations, so that metres and radians, or narrow and wide directions, are
compared separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpmath import diag, eye, matrix, mpf, sqrt

from stability.references.angles import wrap
from stability.references.measurement import innovation, jacobian
from stability.references.motion import by_control, by_pose, move_along_circle, noise

Filtered = tuple[list[Any], Any]


def predict_exactly(mean: Any, covariance: Any, v: Any, turn: Any, alphas: Any) -> Filtered:
    """Mean and P after one control."""
    P, G, V = matrix(covariance), eye(3), matrix(3, 2)
    G[0, 2], G[1, 2] = by_pose(mean, v, turn)
    rows = [*by_control(mean, v, turn), [0, 1]]
    for i in range(3):
        for j in range(2):
            V[i, j] = rows[i][j]
    x, y, phi = move_along_circle(mean, v, turn)
    return [x, y, wrap(phi)], G * P * G.T + V * diag(noise(v, turn, alphas)) * V.T


def update_exactly(mean: Any, covariance: Any, seen: Sequence[Any]) -> Filtered:
    """Mean and P after measurements: rows of landmark x, y, r, gamma, R11, R12, R22."""
    P = matrix(covariance)
    for x, y, r, gamma, r11, r12, r22 in seen:
        H, R = matrix(2, 3), matrix([[r11, r12], [r12, r22]])
        rows = jacobian(mean, [x, y])
        for i in range(2):
            H[i, 0], H[i, 1], H[i, 2] = *rows[i], mpf(-i)
        S = H * P * H.T + R
        K = P * H.T * S**-1
        off = K * matrix(innovation(mean, [x, y], [r, gamma]))
        mean = [mean[i] + off[i] for i in range(3)]
        mean[2] = wrap(mean[2])
        A = eye(3) - K * H
        P = A * P * A.T + K * R * K.T
    return mean, P


def sigmas(covariance: Any) -> list[Any]:
    """Three standard deviations."""
    return [sqrt(covariance[i, i]) for i in range(3)]


def correlations(covariance: Any) -> list[Any]:
    """Correlations of x with y, x with phi, y with phi; 0 beside a sigma of zero."""
    s = sigmas(covariance)
    pairs = ((0, 1), (0, 2), (1, 2))
    return [covariance[i, j] / (s[i] * s[j]) if s[i] * s[j] else mpf(0) for i, j in pairs]
