"""Domain checks: a DomainError that names the first invalid element and carries the mask.

For formulas without a value outside their domain. Functions that take users' pixels and directions
return a value and a mask instead.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools


def require_domain(valid_mask: npt.ArrayLike, values: npt.ArrayLike, expected: str) -> None:
    """Raise DomainError unless every element lies in the domain.

    Args:
        valid_mask: (...) true inside the domain.
        values: (...) or (..., n) arguments of the formula, quoted in the message.
        expected: the domain, in words.

    Raises:
        DomainError: names the first invalid value with its index; `valid_mask` holds the mask.
    """
    mask = np.asarray(valid_mask, dtype=bool)
    # Fast path: these checks run for every sample of a frame, and almost always pass.
    if mask.all():
        return
    first = tuple(int(i) for i in np.unravel_index(np.argmin(mask), mask.shape))
    location = f" (element {', '.join(map(str, first))})" if first else ""
    value = np.asarray(values)[first].tolist()
    raise DomainError(f"{value}{location} is outside the domain: {expected}", mask)


def has_finite_square(values: npt.NDArray[np.floating[Any]]) -> Bools:
    """Mask of values small enough to be squared and summed.

    The bound is a quarter of the square root of the largest float: the sum of a few such squares is
    finite too.
    """
    limit = 0.25 * math.sqrt(float(np.finfo(np.asarray(values).dtype).max))
    return np.asarray(np.abs(values) <= limit)
