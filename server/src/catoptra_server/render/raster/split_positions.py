"""Positions of 48 bits: a float32 number and, as another, what it lacks of the float64 one.

The difference of two such positions is as exact as float32 can hold it, wherever in the world both
are: the shader subtracts the viewpoint from the corners (`glsl/face.vert`). With one float32 number
each, a thing two centimetres away is displaced by 7 px of a 640 px image, 11 km from the scene's
centre. A frame of 60 000 triangles takes 1.05 times as long on llvmpipe.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats

SPLIT_FORMAT = "3f 3f"
"""Buffer format of one split position."""
COARSE_FORMAT = "3f 12x"
"""Buffer format that reads the first of its two numbers alone."""


def split_positions(positions: Floats) -> npt.NDArray[np.float32]:
    """(..., 6) float32 parts of (..., 3) positions: rounded values, then the remainders."""
    rounded = positions.astype(np.float32)
    return np.concatenate((rounded, (positions - rounded).astype(np.float32)), axis=-1)
