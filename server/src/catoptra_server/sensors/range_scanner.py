"""A laser range scanner, such as the SICK LMS200: 181 beams from the right to the left."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.usarsim.reports import RangeScannerConfiguration, RangeScanReading
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, RangeScannerDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.ray_patterns import beam_directions, clamp_ranges, scan_angles
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext


class RangeScannerSensor:
    """Cast a fan of rays from where the scanner sits."""

    type = "RangeScanner"

    def __init__(
        self, description: RangeScannerDescription, base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description
        self._stream = stream
        self._robot_from_scanner = description.mount.parent_from_item()
        self._beams_in_robot = self._robot_from_scanner.rotate_directions(
            _scan_directions(description)
        )

    @property
    def parts(self) -> Sequence[Part]:
        """Return the scanner."""
        told = RangeScannerConfiguration(
            name=self.name,
            max_range_m=self._description.max_range_m,
            min_range_m=self._description.min_range_m,
            resolution_rad=self._description.resolution_rad,
            fov_rad=self._description.fov_rad,
            panning=self._description.is_panning,
            tilting=self._description.is_tilting,
        )
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def update(self, motion: MotionStep) -> None:
        """Ignore the way: a scan is of one moment."""

    def read(self, context: SensorContext) -> RangeScanReading:
        """Return the ranges of all beams, with noise, within the scanner's limits."""
        pose = context.world_from_robot
        origin = pose.transform_points(self._robot_from_scanner.translation)
        ranges = context.environment.distances(origin, pose.rotate_directions(self._beams_in_robot))
        if self._description.noise_m:
            noise = self._stream.generator(context.tick).standard_normal(len(ranges))
            ranges = ranges + self._description.noise_m * noise
        told = clamp_ranges(
            ranges, min_m=self._description.min_range_m, max_m=self._description.max_range_m
        )
        return RangeScanReading(
            time_s=context.time_s,
            name=self.name,
            resolution_rad=self._description.resolution_rad,
            fov_rad=self._description.fov_rad,
            ranges_m=tuple(told.tolist()),
        )


def _scan_directions(scanner: RangeScannerDescription) -> Floats:
    """Return (n, 3) beams; turned in both angles at once they lie on a slant. Source: UDK's."""
    angles = scan_angles(scanner.fov_rad, scanner.resolution_rad)
    still = 0.0 * angles
    return beam_directions(
        yaw_rad=angles if scanner.is_panning else still,
        pitch_rad=angles if scanner.is_tilting else still,
    )
