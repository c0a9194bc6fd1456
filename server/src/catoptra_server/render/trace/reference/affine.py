"""Affine transforms of rays: one for all of them, or one for each ray's time in an exposure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """Transform parent_from_child of (n, 3) points: one, or n of them."""

    matrix: Floats
    """(3, 3) or (n, 3, 3)."""
    inverse: Floats
    """Inverse of the matrix."""
    offset: Floats
    """(3,) or (n, 3)."""

    def take(self, rays: npt.NDArray[np.intp]) -> Affine:
        """Transforms of some of the rays."""
        if self.matrix.ndim == 2:
            return self
        return Affine(self.matrix[rays], self.inverse[rays], self.offset[rays])

    def points(self, in_child: Floats) -> Floats:
        """(n, 3) points in the parent frame."""
        return self.vectors(in_child) + self.offset

    def vectors(self, in_child: Floats) -> Floats:
        """(n, 3) vectors in the parent frame."""
        return _apply(self.matrix, in_child)

    def inverse_points(self, in_parent: Floats) -> Floats:
        """(n, 3) points in the child frame."""
        return _apply(self.inverse, in_parent - self.offset)

    def inverse_vectors(self, in_parent: Floats) -> Floats:
        """(n, 3) vectors in the child frame."""
        return _apply(self.inverse, in_parent)

    def normals(self, in_child: Floats) -> Floats:
        """(n, 3) unit normals in the parent frame; zero where they are zero."""
        # A matrix between two rotations is none itself: normals take its inverse transposed.
        found = _apply(np.swapaxes(self.inverse, -1, -2), in_child)
        length = np.linalg.norm(found, axis=-1, keepdims=True)
        return np.asarray(found / np.where(length > 0.0, length, 1.0))


def interpolate_poses(poses: Sequence[Pose], times: Floats | None) -> Affine:
    """Transforms at (n,) times, linear between poses evenly spaced over [0, 1].

    One pose, or no times: the first pose for all rays.
    """
    if len(poses) == 1 or times is None:
        rotation = poses[0].rotation
        return Affine(rotation, rotation.T, poses[0].translation)
    position = np.clip(times, 0.0, 1.0) * (len(poses) - 1)
    before = np.minimum(position.astype(np.intp), len(poses) - 2)
    fraction = (position - before)[:, None]
    rotations = np.stack([pose.rotation for pose in poses])
    offsets = np.stack([pose.translation for pose in poses])
    matrix = _interpolate(rotations, before, fraction[..., None])
    # Inverted once for points, vectors and normals; between rotations it is well conditioned.
    inverse = np.linalg.inv(matrix).astype(np.float64)
    return Affine(matrix, inverse, _interpolate(offsets, before, fraction))


def _interpolate(values: Floats, before: npt.NDArray[np.intp], fraction: Floats) -> Floats:
    """Entries between two neighbours in a list of arrays."""
    return np.asarray((1.0 - fraction) * values[before] + fraction * values[before + 1])


def _apply(matrix: Floats, vectors: Floats) -> Floats:
    """(n, 3) products of one matrix, or of n, with (n, 3) vectors."""
    if matrix.ndim == 2:
        return np.asarray(vectors @ matrix.T)
    return np.asarray(np.einsum("nij,nj->ni", matrix, vectors))
