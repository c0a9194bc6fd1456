"""Interfaces of cameras and projections that are symmetric about an optical axis, and their hand.

The image radius r of a direction depends on its angle theta from the axis alone, but for the slight
stretch of a calibrated image plane: 0 on the axis, 90 degrees at a mirror's horizon. Projections
are functions of t = tan(theta / 2), in which nothing cancels from the axis to the antipode; t = 1
is 90 degrees exactly. Image radii are in units of the projection: of the 90-degree circle h for
mirrors, of the focal length for lenses; `OmniCamera.scale_px` is that unit in pixels. The axis is
+z of an omnidirectional camera's mirror frame, +x of an ordinary camera's frame.

Two hands: seen along the optical axis, from the camera towards the scene, a lens's picture is
right-handed, image right x image down = the axis. A mirror turns one of them round: its capture
camera looks the other way. Calibration files of all formats describe the right-handed picture,
which is `flipped` for a mirror.

The hand is part of the camera model and of every frame's header. A client may request the other
hand, which is the same picture turned round.

To add a camera model, implement `RadialCamera`: effects and their bounds need nothing else.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Protocol

import numpy as np

from catoptra_protocol.optics.elementary import arctan
from catoptra_protocol.optics.numerics import Bools, Floats


class Picture(str, Enum):
    """Which hand a picture has; the value is the word in files and on the wire."""

    MIRRORED = "mirrored"
    """As a mirror's capture camera sees it: image right x image down = -axis."""
    FLIPPED = "flipped"
    """Right-handed, as a lens's picture and as calibration files have it."""

    __str__ = str.__str__


class RadialProjection(Protocol):
    """Image radius of an angle from the axis, and its inverse."""

    def __hash__(self) -> int:
        """Hash of the parameters: maps of an image are cached by camera."""

    @property
    def t_min(self) -> float:
        """Half-angle tangent in the image's centre: 0 but for a cone, which does not show its
        axis."""

    @property
    def t_limit(self) -> float:
        """Value of t that the image ends before: the formula's limit or its first fold; inf if the
        image contains the antipode."""

    @property
    def fold_rad(self) -> float:
        """Angle at which the image radius first turns back, radians; inf if it never does."""

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Image radius in the projection's unit. Domain: t_min <= t < t_limit."""

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of an image radius, inf beyond the last. Domain: ratio >= 0."""

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(radius ratio) / d(theta), per radian."""


NO_FOLD = math.inf
"""`fold_rad` of a projection that never turns back."""

WITHIN_LIMIT = 1.0 - 1e-9
"""Of an angle at a fold or a formula's limit, where the image radius stops growing: a rim there."""


def describe_limit(projection: RadialProjection) -> str:
    """Where the image of a projection ends, in words: for errors."""
    limit = math.degrees(2.0 * arctan(projection.t_limit))
    if math.isinf(projection.fold_rad):
        return f"{limit:.3f} deg"
    text = f"{limit:.3f} deg, where its image radius turns back (its first fold)"
    formula_t = getattr(projection, "formula_t_limit", projection.t_limit)
    if formula_t <= projection.t_limit:
        return text
    return f"{text}, although its formula reaches {math.degrees(2.0 * arctan(formula_t)):.1f}"


def largest_angle_rad(projection: RadialProjection, ratio: float) -> float:
    """Angle of an image radius, or the limit of the projection where that is smaller."""
    t = float(projection.t_from_radius_ratio(np.array(ratio)))
    corner_rad = 2.0 * arctan(t)
    if math.isinf(projection.t_limit):
        return min(corner_rad, math.pi)
    return min(corner_rad, 2.0 * arctan(projection.t_limit) * WITHIN_LIMIT)


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

    def pixel_from_direction(self, direction: Floats) -> tuple[Floats, Bools]:
        """Pixels (..., 2) of unit directions (..., 3), and a mask of those that are shown."""

    def direction_from_pixel(self, pixel: Floats) -> tuple[Floats, Bools]:
        """Unit directions (..., 3) of (..., 2) pixels, and a mask of the pixels that show any."""
