"""Light between pixels by cubics: for what is shown moved, where a straight line would blur it.

Along one axis l(f) = (1 - f) l'_0 + f l'_1, l'_k = l_k - f (1 - f) / 2 (second difference at k):
Catmull and Rom's cubic, exact for quadratics. In two dimensions the second differences of both axes
are taken off and the rest is interpolated bilinearly: 12 pixels, their cubic without corners.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_server.effects.effect import Real

Whole = npt.NDArray[np.intp]


def with_differences(light: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Return (h w, 9) of a (h, w, 3) picture: light, its second differences along u and along v.

    At the border they are 0.
    """
    height, width = light.shape[:2]
    table = np.zeros((height, width, 9), dtype=light.dtype)
    table[..., :3] = light
    middle = light + light
    table[:, 1:-1, 3:6] = light[:, 2:] - middle[:, 1:-1] + light[:, :-2]
    table[1:-1, :, 6:9] = light[2:] - middle[1:-1] + light[:-2]
    return table.reshape(-1, 9)


def cubic_aside(
    table: npt.NDArray[Real], pixels: Whole, aside: npt.NDArray[Real], *, width: int
) -> npt.NDArray[Real]:
    """Return the (n, 3) light (2, n) px aside of the middles of (n,) pixels, numbered row by row.

    Only where all pixels within two of a place lie in the picture; elsewhere it has no meaning.
    """
    whole = np.floor(aside)
    share = aside - whole
    step = whole.astype(np.intp)
    corner = pixels + step[0] + width * step[1]
    above, below = (
        _between(_rows(table, at), _rows(table, at + 1), share[0])
        for at in (corner, corner + width)
    )
    mixed = _between(above, below, share[1])
    bulge = share * (share.dtype.type(1.0) - share) * share.dtype.type(0.5)
    light: npt.NDArray[Real] = mixed[:, :3]
    light -= bulge[0][:, None] * mixed[:, 3:6]
    light -= bulge[1][:, None] * mixed[:, 6:]
    return light


def _rows(table: npt.NDArray[Real], at: Whole) -> npt.NDArray[Real]:
    return table.take(at, axis=0, mode="clip")


def _between(
    one: npt.NDArray[Real], other: npt.NDArray[Real], share: npt.NDArray[Real]
) -> npt.NDArray[Real]:
    """Return the mixture; the other one's memory is used for it."""
    other -= one
    other *= share[:, None]
    other += one
    return other
