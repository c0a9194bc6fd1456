"""First fold of a projection: the angle at which its image radius turns back.

Two directions with one image radius cannot be told apart, so a camera model ends at its first fold,
whatever its formula claims: a published calibration of a fish-eye lens turns back at 118.3 degrees
where its formula reaches 146.6.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats

# A companion matrix finds a simple root to a dozen digits.
_MAX_STEP = 1e-6


def first_root(coefficients: Floats, *, low: float, high: float) -> float:
    """Smallest real root of a polynomial in an interval; inf if there is none.

    Args:
        coefficients: (n,) from the constant term on.
        low: Lower end, excluded.
        high: Upper end, included.
    """
    terms = np.trim_zeros(np.asarray(coefficients, dtype=np.float64), "b")
    if len(terms) < 2:
        return math.inf
    roots = np.polynomial.polynomial.polyroots(terms)
    scale = np.maximum(np.abs(roots), 1.0)
    # A double root, where the slope only touches 0, comes as a pair beside the axis.
    real = roots.real[np.abs(roots.imag) <= 1e-7 * scale]
    inside = real[(real > low) & (real <= high)]
    return float(_polish(terms, float(inside.min()))) if len(inside) else math.inf


def _polish(terms: Floats, root: float) -> float:
    """A root after three Newton steps: companion matrices lose digits."""
    derivative = np.polynomial.polynomial.polyder(terms)
    for _ in range(3):
        slope = float(np.polynomial.polynomial.polyval(root, derivative))
        step = float(np.polynomial.polynomial.polyval(root, terms)) / slope if slope else math.inf
        # Next to a double root the slope vanishes, and a step would leave it.
        if abs(step) > _MAX_STEP * max(abs(root), 1.0):
            break
        root -= step
    return root
