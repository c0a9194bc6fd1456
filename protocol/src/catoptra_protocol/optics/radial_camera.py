"""Interface of the cameras whose image is symmetric about an optical axis, with or without mirror.

The image radius r of a direction depends on its angle theta from the axis alone, but for the slight
stretch of a calibrated image plane. So a function of r or of theta = 2 atan(t) describes scale,
rings and the lens's shading. The axis is +z of an omnidirectional camera's mirror frame, +x of an
ordinary camera's frame. To add a camera model, implement this protocol: effects and their bounds
need nothing else.
"""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.numerics import Bools, Floats


class RadialCamera(Protocol):
    """Camera whose image is symmetric about an optical axis."""

    def __hash__(self) -> int:
        """Hash of the parameters: maps of an image are cached by camera."""

    @property
    def width_px(self) -> int:
        """Number of columns."""

    @property
    def height_px(self) -> int:
        """Number of rows."""

    @property
    def centre_px(self) -> tuple[float, float]:
        """Pixel (u, v) of the optical axis; pixel centres are at +0.5."""

    @property
    def optical_axis(self) -> tuple[float, float, float]:
        """Direction of the optical axis in the frame of `direction_from_pixel`, a unit vector."""

    @property
    def rim_radius_px(self) -> float:
        """Image radius beyond which nothing is shown: of a mirror's rim or of the corners."""

    @property
    def horizon_radius_px(self) -> float:
        """Image radius of 90 degrees from the axis; inf where no image radius has this angle."""

    @property
    def max_stretch(self) -> float:
        """Bound of the factor by which the image differs from a radial one: 1 if it is radial."""

    @property
    def inverse_focal_length(self) -> float:
        """Tangent of the chief ray's angle at the lens per image radius, 1/px; 0: telecentric."""

    def relative_illumination(self, radius_px: Floats) -> Floats:
        """Irradiance at image radii over that on the axis, of a scene of one radiance."""

    def t_from_radius_px(self, radius_px: Floats) -> Floats:
        """tan(theta / 2) of image radii up to the rim."""

    def radius_slope_px(self, t: Floats) -> Floats:
        """Pixels per radian along the image radius, dr/dtheta, at t = tan(theta / 2)."""

    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Unit directions (..., 3) of (..., 2) pixels, and a mask of the pixels that show any."""
