"""Projection of a perspective camera, and the depth of every frame.

OpenGL projects a perspective image by itself. A lens with another model, such as a fish-eye, is
looked up in the cube's faces pixel by pixel, as the mirror is.

Depth is reversed: near / w at w metres ahead, 1 on the near plane and 0 at infinity, as float32
numbers (Reed 2015, "Depth precision visualized"). It resolves a 2^-24th of every depth, so the near
plane is a millimetre ahead in all frames, and there is no far plane. Depths of 24 bits from 0 to 1
resolve d^2 / (near 2^24) at d metres: with something two centimetres near, 5 m at a kilometre.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class LensProjection:
    """An image with samples x samples texels a pixel."""

    camera: PerspectiveCamera
    """Size and field of view of the image."""
    samples: int
    """Samples along a pixel's side."""
    mirror_from_camera: Floats
    """(3, 3) rotation of the camera's frame in the mirror frame."""

    @property
    def width(self) -> int:
        """Number of columns of texels."""
        return self.camera.width_px * self.samples

    @property
    def height(self) -> int:
        """Number of rows of texels."""
        return self.camera.height_px * self.samples

    @property
    def cells(self) -> tuple[LensProjection, ...]:
        """The only cell of this layout: the whole image."""
        return (self,)

    @property
    def viewport(self) -> tuple[int, int, int, int]:
        """Rectangle (x, y, width, height) of the whole image as OpenGL expects it."""
        return 0, 0, self.width, self.height

    @property
    def clip_from_mirror(self) -> Floats:
        """(3, 3) map from directions in the mirror frame to clip x, y and w.

        y grows downwards in the image: row 0 of the texture is the top.
        """
        forward, right, down = self.mirror_from_camera.T
        focal_x, focal_y = self._normalized_focal_lengths
        return np.stack((focal_x * right, focal_y * down, forward))

    @property
    def least_spacing_rad(self) -> float:
        """Smallest angle between neighbouring texels: the radial one in the corners."""
        focal_px = self.camera.focal_length_px
        squared_px = 0.25 * (self.camera.width_px**2 + self.camera.height_px**2)
        return focal_px / (focal_px**2 + squared_px) / self.samples

    @property
    def _normalized_focal_lengths(self) -> tuple[float, float]:
        """Focal length in units of half the image's width and of half the image's height."""
        focal = 2.0 * self.camera.focal_length_px
        return focal / self.camera.width_px, focal / self.camera.height_px


def make_lens_projection(
    camera: PerspectiveCamera,
    samples: int,
    mirror_from_camera: Floats | None = None,
    *,
    max_texels: int,
) -> LensProjection:
    """Projection of a perspective camera.

    Args:
        camera: Size and field of view of the image.
        samples: Samples along a pixel's side.
        mirror_from_camera: (3, 3) rotation of the camera; None for the mirror frame's own axes.
        max_texels: Largest side of a texture on this device.

    Raises:
        DomainError: The image with its samples exceeds `max_texels` a side.
    """
    rotation = np.eye(3) if mirror_from_camera is None else mirror_from_camera
    projection = LensProjection(camera, samples, rotation)
    if max(projection.width, projection.height) > max_texels:
        raise DomainError(
            f"{samples}^2 samples of {camera.width_px} x {camera.height_px} px are too many: this "
            f"OpenGL allows {max_texels} px a side"
        )
    return projection
