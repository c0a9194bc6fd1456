"""Candidates: sets of blobs that may show a landmark, and the view in which blobs are measured."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.blobs import Blob
from catoptra_client.landmarks.detection import PolarMeasurement
from catoptra_client.landmarks.ranging import (
    azimuth_sigma,
    incidence_angle_sigma,
    turned_sigmas,
)
from catoptra_client.landmarks.viewpoint import Viewpoint
from catoptra_client.unwarp import CylinderGeometry
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera


@dataclass(frozen=True, slots=True)
class CylinderView:
    """Camera, cylinder and viewpoint, which give rows and columns their metric meaning."""

    camera: OmniCamera
    cylinder: CylinderGeometry
    viewpoint: Viewpoint

    def drop_m(self, landmark: Landmark, fraction: float) -> float:
        """Height of the viewpoint over a point of a landmark's band; negative if below.

        Args:
            landmark: the landmark.
            fraction: height in the band, from 0 (lower edge) to 1 (upper edge).
        """
        band_m = landmark.band_top_m - landmark.band_bottom_m
        return self.viewpoint.height_m - (landmark.band_bottom_m + fraction * band_m)

    def azimuth_from_column(self, column: float) -> float:
        """Wrapped azimuth of a column, which may lie beyond the image width."""
        return wrap_angle(self.cylinder.azimuth_from_column(column))

    def angle_sigmas(
        self, azimuth_rad: float, *, drop_m: float, range_m: float, sigma_px: float
    ) -> tuple[float, float, bool]:
        """Sigmas, in radians, of a point's angle from the vertical and of its azimuth.

        Args:
            azimuth_rad: Azimuth of the point.
            drop_m: Height of the viewpoint over the point.
            range_m: Level range of the point.
            sigma_px: Sigma of the point's pixel.

        Returns:
            Both sigmas, and whether the camera shows the point.
        """
        rotation = self.viewpoint.rotation
        if rotation is not None:
            point = (range_m * math.cos(azimuth_rad), range_m * math.sin(azimuth_rad), drop_m)
            direction = np.array(point) / math.hypot(*point)
            return turned_sigmas(
                self.camera, direction, robot_from_mirror=rotation, sigma_px=sigma_px
            )
        point_of = {"drop_m": drop_m, "range_m": range_m, "sigma_px": sigma_px}
        down_rad, is_visible = incidence_angle_sigma(self.camera, **point_of)
        across_rad, has_azimuth = azimuth_sigma(self.camera, **point_of)
        return down_rad, across_rad, is_visible and has_azimuth

    def touches_edge(self, blob: Blob) -> bool:
        """Whether a blob touches the upper or lower image edge and may be cut off there."""
        return blob.top <= 0.0 or blob.bottom >= self.cylinder.rows


@dataclass(frozen=True, slots=True)
class Candidate:
    """Landmark that a set of blobs may show."""

    landmark: Landmark
    blobs: tuple[Blob, ...]
    measurement: PolarMeasurement
    """Polar measurement of the landmark from the viewpoint."""
    has_range: bool
    """Whether the range of the measurement is usable."""

    @property
    def num_pixels(self) -> int:
        """Number of pixels of all blobs."""
        return sum(blob.num_pixels for blob in self.blobs)


def require_distinct_colours(landmarks: Iterable[Landmark]) -> None:
    """Check that colours identify each landmark.

    Raises:
        DomainError: two landmarks share kind and colours, or a beacon has one colour only.
    """
    seen: dict[tuple[str, str, str], str] = {}
    for landmark in landmarks:
        appearance = (landmark.kind, landmark.lower_colour, landmark.upper_colour)
        if appearance in seen:
            raise DomainError(
                f"{landmark.name} and {seen[appearance]} are both a {' '.join(appearance)}: "
                "colours do not distinguish them"
            )
        if landmark.kind == "beacon" and landmark.lower_colour == landmark.upper_colour:
            raise DomainError(
                f"{landmark.name}: a beacon of one colour cannot be distinguished from noise"
            )
        seen[appearance] = landmark.name
