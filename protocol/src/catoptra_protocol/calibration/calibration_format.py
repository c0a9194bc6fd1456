"""What a module of a calibration format provides, and the conventions that formats differ in.

Domains differ by model and not by format: `exports.EXPORTS` has them.
"""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Conventions:
    """Conventions of a format; all describe the right-handed (flipped) picture."""

    frame: str
    """Axes of the camera frame."""
    first_pixel: float
    """Coordinate of the first pixel's centre."""
    fields: str
    """Order of the fields."""


class CalibrationFormat(Protocol):
    """A format of calibration files: a module of `formats/`."""

    NAME: str
    """Name of the format."""
    CONVENTIONS: Conventions

    def is_format(self, text: str) -> bool:
        """Whether a text looks like a file of this format."""

    def read(self, text: str, file: str, camera: str) -> OmniCamera:
        """Camera of a file, its picture flipped.

        Raises:
            ConfigError: A field is missing, wrong or contradicts another one.
        """

    def write(self, camera: OmniCamera, name: str) -> str:
        """Text of a file that describes a camera.

        Raises:
            DomainError: The format has no place for a property of the camera.
        """
