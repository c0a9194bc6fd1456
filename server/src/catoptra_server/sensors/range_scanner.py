"""A laser range scanner, such as the SICK LMS200: 181 beams from the right to the left."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.wire.reports import RangeScan, RangeScannerConfiguration
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import DriveBase, RangeScannerDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.ranging import beams, fan, limited
from catoptra_server.sensors.sensor import Moment, Move, Part


class RangeScannerSensor:
    """Cast a fan of rays from where the scanner sits."""

    type = "RangeScanner"

    def __init__(
        self, description: RangeScannerDescription, base: DriveBase, stream: RandomStream
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._is = description
        self._stream = stream
        self._robot_from_scanner = description.mount.parent_from_item()
        self._fan_in_robot = self._robot_from_scanner.directions(_fan(description))

    @property
    def parts(self) -> Sequence[Part]:
        """Return the scanner."""
        told = RangeScannerConfiguration(
            name=self.name,
            max_range_m=self._is.max_range_m,
            min_range_m=self._is.min_range_m,
            resolution_rad=self._is.resolution_rad,
            fov_rad=self._is.fov_rad,
            panning=self._is.turns_in_yaw,
            tilting=self._is.turns_in_pitch,
        )
        return (MountedPart(self.type, self.name, self._is.mount, told),)

    def follow(self, move: Move) -> None:
        """Ignore the way: a scan is of one moment."""

    def reading(self, moment: Moment) -> RangeScan:
        """Return the ranges of all beams, with noise, within the scanner's limits."""
        pose = moment.world_from_robot
        origin = pose.points(self._robot_from_scanner.translation)
        ranges = moment.around.distances(origin, pose.directions(self._fan_in_robot))
        if self._is.noise_m:
            noise = self._stream.at(moment.tick).standard_normal(len(ranges))
            ranges = ranges + self._is.noise_m * noise
        told = limited(ranges, min_m=self._is.min_range_m, max_m=self._is.max_range_m)
        return RangeScan(
            time_s=moment.time_s,
            name=self.name,
            resolution_rad=self._is.resolution_rad,
            fov_rad=self._is.fov_rad,
            ranges_m=tuple(told.tolist()),
        )


def _fan(scanner: RangeScannerDescription) -> Floats:
    """Return (n, 3) beams; turned in both angles at once they lie on a slant. Source: UDK's."""
    angles = fan(scanner.fov_rad, scanner.resolution_rad)
    still = 0.0 * angles
    return beams(
        yaw_rad=angles if scanner.turns_in_yaw else still,
        pitch_rad=angles if scanner.turns_in_pitch else still,
    )
