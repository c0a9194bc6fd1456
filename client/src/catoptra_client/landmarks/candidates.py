"""Candidates: sets of blobs that may show a landmark, and the view in which blobs are measured."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from catoptra_client.landmarks.blobs import Blob
from catoptra_client.landmarks.detection import PolarMeasurement
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
