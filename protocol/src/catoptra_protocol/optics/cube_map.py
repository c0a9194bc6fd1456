"""Cube map around the effective viewpoint: face and face coordinates of a direction.

Faces are named as USARSim's CameraTextureClients: N, E, S, W turned by 0, 90, 180, 270 degrees of
yaw, C pitched straight down, and U (up), which the paper omits and only rims beyond
`MAX_FIVE_FACE_RIM_RAD` need. Face coordinates (s, t) are in [-1, 1], s right and t down in the
virtual camera.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan, matmul
from catoptra_protocol.optics.numerics import Floats, require_domain
from catoptra_protocol.optics.transforms import rotation_from_rpy

# Directions up to this incidence angle are covered by five faces whatever their azimuth: the corner
# of a side face's upper edge, pi - atan(sqrt 2).
MAX_FIVE_FACE_RIM_RAD = math.pi - arctan(math.sqrt(2.0))

# Bounds face coordinates by 1e150, so that the quotient is finite for directions of any length.
_MIN_FORWARD_RATIO = 1e-150


class Face(IntEnum):
    """Face of the cube; the value is the index of the face in every table."""

    N = 0
    E = 1
    S = 2
    W = 3
    C = 4
    U = 5


def _mirror_from_face(face: Face) -> Floats:
    """Rotation (3, 3) from the virtual camera of a face (x forward, z down) to the mirror frame."""
    if face == Face.C:
        return _round_entries(rotation_from_rpy(0.0, -0.5 * math.pi, 0.0))
    if face == Face.U:
        return _round_entries(rotation_from_rpy(0.0, 0.5 * math.pi, 0.0))
    return _round_entries(rotation_from_rpy(0.0, 0.0, 0.5 * math.pi * face))


def _round_entries(rotation: Floats) -> Floats:
    """Set the entries of a rotation by quarter turns to exactly -1, 0 or 1."""
    # Adding 0.0 turns -0.0 into 0.0: signed zeros would decide ties of argmax by accident.
    return np.round(rotation) + 0.0


MIRROR_FROM_FACE_ROTATIONS: Floats = np.stack([_mirror_from_face(face) for face in Face])
MIRROR_FROM_FACE_ROTATIONS.setflags(write=False)


def face_from_direction(direction: Floats) -> npt.NDArray[np.intp]:
    """Face that sees a direction: exactly one for every finite direction.

    A tie on an edge or a corner goes to the first of the tied faces in `Face`; the zero vector
    belongs to N.

    Args:
        direction: (..., 3) in the mirror frame, of any length.

    Returns:
        (...) indices into `Face`.

    Raises:
        DomainError: a direction is not finite; the message names the first one.
    """
    require_domain(np.isfinite(direction).all(axis=-1), direction, "a direction is finite")
    # Column 0 of each rotation is the optical axis: the largest projection wins, and argmax returns
    # the first of equal ones, which makes edges and corners unique.
    face: npt.NDArray[np.intp] = np.argmax(
        matmul(direction, MIRROR_FROM_FACE_ROTATIONS[:, :, 0].T), axis=-1
    )
    return face


@np.errstate(under="ignore")
def face_coordinates(direction: Floats, face: npt.NDArray[np.intp]) -> Floats:
    """Coordinates (s, t) of directions in the planes of the given faces.

    Args:
        direction: (..., 3) in the mirror frame, in front of the face: the forward component is
            positive and no less than 1e-150 of the largest other component.
        face: (...) indices into `Face`.

    Returns:
        (..., 2); within [-1, 1] where the direction belongs to the face.

    Raises:
        DomainError: a direction lies behind or beside the plane of the face.
    """
    local = matmul(direction[..., None, :], MIRROR_FROM_FACE_ROTATIONS[face])[..., 0, :]
    forward, lateral = local[..., 0], np.abs(local[..., 1:]).max(axis=-1)
    inside = (forward > 0.0) & (forward >= _MIN_FORWARD_RATIO * lateral) & (forward < math.inf)
    require_domain(inside, direction, "coordinates belong to directions in front of the face")
    coordinates: Floats = local[..., 1:] / local[..., :1]
    return coordinates


def visible_faces(rim_rad: float) -> tuple[Face, ...]:
    """Faces that a mirror with this rim reflects: five, or six beyond `MAX_FIVE_FACE_RIM_RAD`."""
    five = (Face.N, Face.E, Face.S, Face.W, Face.C)
    return five if rim_rad <= MAX_FIVE_FACE_RIM_RAD else (*five, Face.U)
