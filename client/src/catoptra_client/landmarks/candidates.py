"""What blobs are judged by: the eye that saw them, and the candidates they may make."""

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
    """What a row and a column mean: camera, cylinder, and the viewpoint's place on the robot."""

    camera: OmniCamera
    cylinder: CylinderGeometry
    viewpoint: Viewpoint

    def drop_m(self, landmark: Landmark, fraction: float) -> float:
        """Return how far below the viewpoint a height lies, given as a share of the band's."""
        band_m = landmark.band_top_m - landmark.band_bottom_m
        return self.viewpoint.height_m - (landmark.band_bottom_m + fraction * band_m)

    def azimuth_from_column(self, column: float) -> float:
        """Return the wrapped azimuth of a column, which may lie beyond the picture's width."""
        return wrap_angle(self.cylinder.azimuth_from_column(column))

    def touches_edge(self, blob: Blob) -> bool:
        """Return whether a blob touches the picture's upper or lower edge and may go on beyond."""
        return blob.top <= 0.0 or blob.bottom >= self.cylinder.rows


@dataclass(frozen=True, slots=True)
class Candidate:
    """A landmark that some blobs may show. has_range: whether the sighting's range is usable."""

    landmark: Landmark
    blobs: tuple[Blob, ...]
    measurement: PolarMeasurement
    has_range: bool

    @property
    def num_pixels(self) -> int:
        """Return the pixels of all its blobs."""
        return sum(blob.num_pixels for blob in self.blobs)


def require_distinct_colours(landmarks: Iterable[Landmark]) -> None:
    """Raise DomainError if two landmarks have the same kind and colours, or a beacon only one."""
    seen: dict[tuple[str, str, str], str] = {}
    for landmark in landmarks:
        looks = (landmark.kind, landmark.lower_colour, landmark.upper_colour)
        if looks in seen:
            raise DomainError(
                f"{landmark.name} and {seen[looks]} are both a {' '.join(looks)}: "
                "colours alone cannot tell them apart"
            )
        if landmark.kind == "beacon" and landmark.lower_colour == landmark.upper_colour:
            raise DomainError(f"{landmark.name}: a beacon of one colour cannot be told from noise")
        seen[looks] = landmark.name
