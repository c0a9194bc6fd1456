"""A camera with a lens as raster draws it: one viewport, straight to the picture. Knows no GL.

A flat picture is what OpenGL projects by itself. A lens with another law, such as a fish-eye, would
be looked up in the cube's faces per pixel, as the mirror is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.numerics import Floats


@dataclass(frozen=True, slots=True, eq=False)
class LensProjection:
    """A picture with samples^2 texels a pixel. mirror_from_camera: (3, 3), turns the camera."""

    camera: PerspectiveCamera
    samples: int
    mirror_from_camera: Floats

    @property
    def width(self) -> int:
        """Return the number of columns of texels."""
        return self.camera.width_px * self.samples

    @property
    def height(self) -> int:
        """Return the number of rows of texels."""
        return self.camera.height_px * self.samples

    @property
    def cells(self) -> tuple[LensProjection, ...]:
        """Return what is drawn: this alone."""
        return (self,)

    @property
    def viewport(self) -> tuple[int, int, int, int]:
        """Return the whole picture as OpenGL takes it."""
        return 0, 0, self.width, self.height

    @property
    def clip_from_mirror(self) -> Floats:
        """Return the (3, 3) map from directions in the mirror frame to clip x, y and w.

        y grows downwards in the picture: row 0 of the texture is the top.
        """
        forward, right, down = self.mirror_from_camera.T
        across, along = self._normalized_focal_lengths
        return np.stack((across * right, along * down, forward))

    @property
    def max_depth_ratio(self) -> float:
        """Return the largest distance from the viewpoint of what is one metre ahead, in metres."""
        across, along = self._normalized_focal_lengths
        return math.sqrt(1.0 + 1.0 / across**2 + 1.0 / along**2)

    @property
    def _normalized_focal_lengths(self) -> tuple[float, float]:
        """Return the focal length in units of half the picture's width and of half its height."""
        focal = 2.0 * self.camera.focal_length_px
        return focal / self.camera.width_px, focal / self.camera.height_px


def make_lens_projection(
    camera: PerspectiveCamera,
    samples: int,
    mirror_from_camera: Floats | None = None,
    *,
    max_texels: int,
) -> LensProjection:
    """Return the cell of a camera. Raises DomainError where no texture is that large."""
    turn = np.eye(3) if mirror_from_camera is None else mirror_from_camera
    cell = LensProjection(camera, samples, turn)
    if max(cell.width, cell.height) > max_texels:
        raise DomainError(
            f"{samples}^2 samples of {camera.width_px} x {camera.height_px} px are too many: this "
            f"OpenGL ends at {max_texels} px a side"
        )
    return cell
