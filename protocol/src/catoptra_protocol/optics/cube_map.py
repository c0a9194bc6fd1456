"""The cube around the effective viewpoint: which virtual camera sees a direction, and where.

Faces are named as USARSim's CameraTextureClients: N, E, S, W turned by 0, 90, 180, 270 degrees of
yaw, C pitched straight down, and U (up), which the paper leaves out and which is needed only by
rims beyond `MAX_FIVE_FACE_RIM_RAD`. Face coordinates (s, t) are in [-1, 1], s right and t down in the
virtual camera.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.domain_checks import require_domain
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import rotation_from_rpy

# Directions up to this incidence angle are covered by five faces whatever their azimuth: the corner
# of a side face's upper edge, pi - atan(sqrt 2).
MAX_FIVE_FACE_RIM_RAD = math.pi - math.atan(math.sqrt(2.0))

# So that a quotient is finite whatever the direction's length.
_MIN_FORWARD_RATIO = 1e-150


class Face(IntEnum):
    """A face of the cube; the value is its index in every table of faces."""

    N = 0
    E = 1
    S = 2
    W = 3
    C = 4
    U = 5


def mirror_from_face(face: Face) -> Floats:
    """Return the (3, 3) rotation from a virtual camera (x forward, z down) to the mirror."""
    if face == Face.C:
        return _round_entries(rotation_from_rpy(0.0, -0.5 * math.pi, 0.0))
    if face == Face.U:
        return _round_entries(rotation_from_rpy(0.0, 0.5 * math.pi, 0.0))
    return _round_entries(rotation_from_rpy(0.0, 0.0, 0.5 * math.pi * face))


def _round_entries(rotation: Floats) -> Floats:
    """Return the rotation with its entries made exactly -1, 0, 1: quarter turns have no others."""
    return np.round(rotation) + 0.0


MIRROR_FROM_FACE_ROTATIONS: Floats = np.stack([mirror_from_face(face) for face in Face])
MIRROR_FROM_FACE_ROTATIONS.setflags(write=False)


def face_from_direction(direction: Floats) -> npt.NDArray[np.intp]:
    """Return the (...) face index of (..., 3) directions in the mirror frame: total and unique.

    A tie on an edge or a corner goes to the face that comes first in `Face`, so the zero vector to
    N. Raises DomainError naming a direction that is not finite: it has no face.
    """
    require_domain(np.isfinite(direction).all(axis=-1), direction, "a direction is finite")
    face: npt.NDArray[np.intp] = np.argmax(
        direction @ MIRROR_FROM_FACE_ROTATIONS[:, :, 0].T, axis=-1
    )
    return face


@np.errstate(under="ignore")
def face_coordinates(direction: Floats, face: npt.NDArray[np.intp]) -> Floats:
    """Return (..., 2) coordinates (s, t) of (..., 3) directions in the planes of given (...) faces.

    Those of the face itself lie in [-1, 1]. Domain: directions in front of the face, no flatter
    than 1e-150; raises DomainError naming one that is not.
    """
    local = np.einsum("...i,...ij->...j", direction, MIRROR_FROM_FACE_ROTATIONS[face])
    forward, aside = local[..., 0], np.abs(local[..., 1:]).max(axis=-1)
    inside = (forward > 0.0) & (forward >= _MIN_FORWARD_RATIO * aside) & (forward < math.inf)
    require_domain(inside, direction, "coordinates belong to directions in front of the face")
    coordinates: Floats = local[..., 1:] / local[..., :1]
    return coordinates


def visible_faces(rim_rad: float) -> tuple[Face, ...]:
    """Return the faces that a mirror with this rim looks into."""
    five = (Face.N, Face.E, Face.S, Face.W, Face.C)
    return five if rim_rad <= MAX_FIVE_FACE_RIM_RAD else (*five, Face.U)
