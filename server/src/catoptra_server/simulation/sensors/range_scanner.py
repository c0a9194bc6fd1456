"""A laser range scanner, such as the SICK LMS200: 181 beams from right to left."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import RangeScanReading
from catoptra_protocol.usarsim.reports import RangeScannerConfiguration
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    ReadDescription,
    SensorContext,
    SensorKind,
)

# Files round angles to few digits: 3.14159 / 0.01745 is 180.03 steps, 3.14 / 0.157 exactly 20.
_STEP_COUNT_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class RangeScannerDescription:
    """A laser scanner with a fan of beams."""

    name: str
    interval_s: float
    mount: Mount
    fov_rad: float
    resolution_rad: float
    """Angle between two beams."""
    min_range_m: float
    max_range_m: float
    noise_m: float = 0.0
    """Standard deviation of each range."""
    is_panning: bool = True
    """Whether beams spread in yaw, in the mount's x-y plane."""
    is_tilting: bool = False
    """Whether beams spread in pitch, in the mount's x-z plane; with both, on a slant."""


class RangeScannerSensor:
    """Ranges of a fan of beams."""

    def __init__(
        self, description: RangeScannerDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description
        self._random_source = random_source
        self._robot_from_scanner = description.mount.parent_from_item()
        # Into the robot frame once; a scan only turns the beams with the robot.
        self._beams_in_robot = self._robot_from_scanner.rotate_directions(
            _scan_directions(description)
        )

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: a scan has one time."""

    def read(self, context: SensorContext) -> RangeScanReading:
        """Ranges of all beams, with noise, clamped to the scanner's limits."""
        # One origin, broadcast to all beams: a scan has one time and one position.
        pose, scanner = context.world_from_robot, self._description
        origin = pose.transform_points(self._robot_from_scanner.translation)
        ranges = context.environment.distances(origin, pose.rotate_directions(self._beams_in_robot))
        if scanner.noise_m:
            # By the tick, not by the scan: SCAN between two reports changes no other noise.
            noise = np.array(self._random_source.normal_variates(context.tick, len(ranges)))
            ranges = ranges + scanner.noise_m * noise
        # Limits last: noise never moves a range beyond MaxRange, which clients use for no echo.
        measured = np.clip(ranges, scanner.min_range_m, scanner.max_range_m)
        return RangeScanReading(
            time_s=context.time_s,
            name=scanner.name,
            resolution_rad=scanner.resolution_rad,
            fov_rad=scanner.fov_rad,
            ranges_m=tuple(measured.tolist()),
        )


def _configure(scanner: RangeScannerDescription) -> RangeScannerConfiguration:
    return RangeScannerConfiguration(
        name=scanner.name,
        max_range_m=scanner.max_range_m,
        min_range_m=scanner.min_range_m,
        resolution_rad=scanner.resolution_rad,
        fov_rad=scanner.fov_rad,
        panning=scanner.is_panning,
        tilting=scanner.is_tilting,
    )


def _scan_directions(scanner: RangeScannerDescription) -> Floats:
    """Unit beams (n, 3) in the frame of the mount, from +fov / 2, right or up, to -fov / 2.

    Both ends are included: 180 degrees in steps of one are 181 beams. On a slant if panning and
    tilting. Source: UDK.
    """
    count = math.floor(scanner.fov_rad / scanner.resolution_rad + _STEP_COUNT_TOLERANCE) + 1
    # A product for each angle: repeated differences would accumulate rounding.
    angles = 0.5 * scanner.fov_rad - scanner.resolution_rad * np.arange(count, dtype=np.float64)
    yaw_rad, pitch_rad = angles * scanner.is_panning, angles * scanner.is_tilting
    level = cos(pitch_rad)
    return np.stack((level * cos(yaw_rad), level * sin(yaw_rad), -sin(pitch_rad)), axis=-1)


def _reader_with_defaults(
    fov_rad: float, resolution_rad: float, max_range_m: float
) -> ReadDescription:
    """Reader for a scanner's class, with the defaults of UDK's DefaultUSAR.ini."""

    def read(item: ConfiguredSensor) -> RangeScannerDescription:
        section = item.section
        fov = section.get_float("ScanFov", fov_rad, min_value=0.0, max_value=6.2832)
        # A line has 4095 bytes, the buffer of old clients: 500 beams of 8 characters.
        min_resolution_rad = max(fov / 500.0, 1e-4)
        return RangeScannerDescription(
            name=item.name,
            interval_s=item.interval_s,
            mount=item.mount,
            fov_rad=fov,
            resolution_rad=section.get_float(
                "Resolution", resolution_rad, min_value=min_resolution_rad, max_value=6.3
            ),
            min_range_m=item.get_float("MinRange", 0.1),
            max_range_m=item.get_float("MaxRange", max_range_m),
            noise_m=item.get_float("Noise", 0.0, 10.0),
            is_panning=section.get_bool("bYaw", True),
            is_tilting=section.get_bool("bPitch", False),
        )

    return read


# Field of view, resolution and range of the models in DefaultUSAR.ini; 4.189 rad are 240 degrees.
_read_lms200 = _reader_with_defaults(3.14159, 0.01745, 20.0)
RANGE_SCANNER = SensorKind(
    "RangeScanner",
    RangeScannerDescription,
    RangeScannerSensor,
    {
        "rangescanner": _read_lms200,
        "sicklms": _read_lms200,
        "sicklms200": _read_lms200,
        "sick": _read_lms200,
        "hokuyourg04lx": _reader_with_defaults(4.189, 0.0184, 4.0),
    },
    _configure,
    casts_rays=True,
)
