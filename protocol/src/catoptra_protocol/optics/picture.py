"""The two hands of an omnidirectional picture.

Seen along the optical axis, from the camera towards the scene, a lens's picture is right-handed:
image right x image down = the axis. A mirror turns one of them round: its capture camera looks the
other way. Calibration files of all formats describe the right-handed picture, which is `flipped`
for a mirror.
"""

from __future__ import annotations

from enum import StrEnum


class Picture(StrEnum):
    """Which hand a picture has; the value is the word in files and on the wire."""

    MIRRORED = "mirrored"
    """As a mirror's capture camera sees it: image right x image down = -axis."""
    FLIPPED = "flipped"
    """Right-handed, as a lens's picture and as calibration files have it."""
