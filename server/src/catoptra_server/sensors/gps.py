"""A GPS receiver: a place on the ellipsoid, from satellites that no roof hides.

World x points north and y east of the world file's origin. Without an origin, or under a roof,
there is no fix.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.usarsim.reports import GpsReading, ScanIntervalConfiguration
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, GpsDescription
from catoptra_server.scene.world_description import GpsOrigin
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext

# WGS 84: equatorial radius in metres, and the square of the first eccentricity.
_EQUATORIAL_RADIUS_M = 6378137.0
_ECCENTRICITY_SQUARED = 6.69437999014e-3
# A fix in three dimensions and time needs four satellites.
_MIN_SATELLITES = 4


def _satellite_directions() -> Floats:
    """Return (11, 3) directions of the satellites, up being -z: one above, 4 at 60, 6 at 30 deg."""
    rows = ((90.0, 1), (60.0, 4), (30.0, 6))
    angles = [
        (math.radians(height), 2.0 * math.pi * number / count)
        for height, count in rows
        for number in range(count)
    ]
    return np.array([(math.cos(h) * math.cos(a), math.cos(h) * math.sin(a), -math.sin(h))
                     for h, a in angles])  # fmt: skip


_SATELLITE_DIRECTIONS = _satellite_directions()


class GpsSensor:
    """Turn metres from the origin into degrees."""

    type = "GPS"

    def __init__(self, description: GpsDescription, base: DriveBase, stream: RandomSource) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description
        self._stream = stream
        self._robot_from_receiver = description.mount.parent_from_item()

    @property
    def parts(self) -> Sequence[Part]:
        """Return the receiver."""
        told = ScanIntervalConfiguration(self.type, self.name, self.interval_s)
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def update(self, motion: MotionStep) -> None:
        """Ignore the way."""

    def read(self, context: SensorContext) -> GpsReading:
        """Return the place, if enough satellites are in sight."""
        place = context.world_from_robot.transform_points(self._robot_from_receiver.translation)
        satellites = int(
            np.isinf(context.environment.distances(place, _SATELLITE_DIRECTIONS)).sum()
        )
        origin = context.environment.gps_origin
        time_s = context.time_s if self._description.has_timestamp else None
        if origin is None or satellites < _MIN_SATELLITES:
            return GpsReading(self.name, num_satellites=satellites if origin else 0, time_s=time_s)
        north_m, east_m = float(place[0]), float(place[1])
        if self._description.noise_m:
            noise = self._description.noise_m * self._stream.generator(
                context.tick
            ).standard_normal(2)
            north_m, east_m = north_m + float(noise[0]), east_m + float(noise[1])
        latitude, longitude = geodetic_from_local(origin, north_m, east_m)
        return GpsReading(self.name, latitude, longitude, True, satellites, time_s)


def geodetic_from_local(origin: GpsOrigin, north_m: float, east_m: float) -> tuple[float, float]:
    """Return latitude and longitude in degrees of a place near the origin, on WGS 84.

    By the radii of curvature at the origin: good for worlds of kilometres.
    """
    latitude = math.radians(origin.latitude_deg)
    factor = 1.0 - _ECCENTRICITY_SQUARED * math.sin(latitude) ** 2
    meridian_m = _EQUATORIAL_RADIUS_M * (1.0 - _ECCENTRICITY_SQUARED) / factor**1.5
    parallel_m = _EQUATORIAL_RADIUS_M / math.sqrt(factor) * math.cos(latitude)
    return (
        origin.latitude_deg + math.degrees(north_m / meridian_m),
        origin.longitude_deg + math.degrees(east_m / parallel_m),
    )
