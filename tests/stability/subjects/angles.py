"""Hard cases of angles: ends of the interval, the seam, many turns, full precision near zero."""

from __future__ import annotations

from catoptra_protocol.optics import numerics
from stability.catalogue import Subject

SUBJECTS: dict[str, Subject] = {
    "wrap": lambda angle: numerics.wrap_angle(angle),
    "difference": lambda angle, start: numerics.angle_difference(angle, start),
    "between": lambda start, end, fraction: numerics.interpolate_angle(
        start, end, fraction=fraction
    ),
}
