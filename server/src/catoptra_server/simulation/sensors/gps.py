"""A GPS receiver: geodetic coordinates, from satellites that no surface occludes.

World x points north and y points east of the world file's origin. Without an origin, or under a
roof, there is no fix.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import GpsReading
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)
from catoptra_server.world.world_description import GpsOrigin

# WGS 84: equatorial radius in metres, and the square of the first eccentricity.
_EQUATORIAL_RADIUS_M = 6378137.0
_ECCENTRICITY_SQUARED = 6.69437999014e-3
# Three coordinates and the receiver's clock are four unknowns.
_MIN_SATELLITES = 4


def _satellite_directions() -> Floats:
    """Unit directions (11, 3) of a fixed constellation: one at the zenith, 4 at 60, 6 at 30 deg."""
    rings = ((90.0, 1), (60.0, 4), (30.0, 6))
    angles = [
        (math.radians(elevation), 2.0 * math.pi * number / count)
        for elevation, count in rings
        for number in range(count)
    ]
    return np.array([(cos(h) * cos(a), cos(h) * sin(a), -sin(h))
                     for h, a in angles])  # fmt: skip


_SATELLITE_DIRECTIONS = _satellite_directions()


@dataclass(frozen=True, slots=True)
class GpsDescription:
    """A GPS receiver."""

    name: str
    interval_s: float
    mount: Mount
    noise_m: float = 0.0
    """Standard deviation of each reading, north and east."""
    has_timestamp: bool = False
    """Whether UDK's readings, unlike UT2004's, carry a time."""


class _GpsSensor:
    """Geodetic coordinates of the receiver."""

    def __init__(
        self, description: GpsDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description
        self._random_source = random_source
        self._robot_from_receiver = description.mount.parent_from_item()

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: a fix has one time."""

    def read(self, context: SensorContext) -> GpsReading:
        """Coordinates, where enough satellites are in view."""
        receiver = context.world_from_robot.transform_points(self._robot_from_receiver.translation)
        distances = context.environment.distances(receiver, _SATELLITE_DIRECTIONS)
        satellites = int(np.isinf(distances).sum())
        origin = context.environment.gps_origin
        name = self._description.name
        time_s = context.time_s if self._description.has_timestamp else None
        if origin is None or satellites < _MIN_SATELLITES:
            # Without an origin no satellite counts: the world is nowhere on Earth.
            return GpsReading(
                self._description.name, num_satellites=satellites if origin else 0, time_s=time_s
            )
        north_m, east_m = float(receiver[0]), float(receiver[1])
        # Noise in metres before the conversion: equal north and east at any latitude.
        if self._description.noise_m:
            north, east = self._random_source.normal_variates(context.tick, 2)
            north_m += self._description.noise_m * north
            east_m += self._description.noise_m * east
        latitude, longitude = _geodetic_from_local(origin, north_m, east_m)
        return GpsReading(name, latitude, longitude, True, satellites, time_s)


def _geodetic_from_local(origin: GpsOrigin, north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude in degrees of a point near the origin, on WGS 84.

    Linear in the radii of curvature at the origin, which suffices for worlds of kilometres.
    """
    latitude = math.radians(origin.latitude_deg)
    # Radii of curvature: M = a (1 - e^2) / f^(3/2) along the meridian, N = a / sqrt(f) across,
    # with f = 1 - e^2 sin^2(latitude); a parallel's radius is N cos(latitude).
    factor = 1.0 - _ECCENTRICITY_SQUARED * sin(latitude) * sin(latitude)
    meridian_m = _EQUATORIAL_RADIUS_M * (1.0 - _ECCENTRICITY_SQUARED) / (factor * math.sqrt(factor))
    parallel_m = _EQUATORIAL_RADIUS_M / math.sqrt(factor) * cos(latitude)
    return (
        origin.latitude_deg + math.degrees(north_m / meridian_m),
        origin.longitude_deg + math.degrees(east_m / parallel_m),
    )


def _read_description(item: ConfiguredSensor) -> GpsDescription:
    return GpsDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        noise_m=item.get_float("Noise", 0.0),
        has_timestamp=item.has_timestamp(False),
    )


GPS = SensorKind(
    "GPS",
    GpsDescription,
    _GpsSensor,
    {"gpssensor": _read_description, "gps": _read_description},
    casts_rays=True,
)
