"""Where a formula ends: an error that names the first element outside, and carries the mask.

For formulas that have no value there and no use for a mask; those that users put pixels and
directions into return value and validity instead.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools


def require_domain(valid_mask: npt.ArrayLike, values: npt.ArrayLike, expected: str) -> None:
    """Raise DomainError unless all is inside; it names the first value that is not.

    inside: (...) mask. values: (...) or (..., n) what was asked. expected: the domain, in words.
    """
    mask = np.asarray(valid_mask, dtype=bool)
    if mask.all():
        return
    first = tuple(int(i) for i in np.unravel_index(np.argmin(mask), mask.shape))
    place = f" (element {', '.join(map(str, first))})" if first else ""
    value = np.asarray(values)[first].tolist()
    raise DomainError(f"{value}{place} is outside the domain: {expected}", mask)


def has_finite_square(values: npt.NDArray[np.floating[Any]]) -> Bools:
    """Return which values have a finite square, and some more of the same size beside it."""
    most = 0.25 * math.sqrt(float(np.finfo(np.asarray(values).dtype).max))
    return np.asarray(np.abs(values) <= most)
