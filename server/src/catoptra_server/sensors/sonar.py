"""Sonars: each reports the nearest thing in its cone; all of a robot share one line."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.usarsim.reports import SonarConfiguration, SonarReadings
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, SonarDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.ray_patterns import clamp_ranges, cone_directions
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext


class SonarRing:
    """All sonars of a robot: their cones are cast together."""

    type = "Sonar"

    def __init__(
        self, descriptions: Sequence[SonarDescription], base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = self.type
        self.interval_s = min(description.interval_s for description in descriptions)
        self._descriptions = tuple(descriptions)
        self._stream = stream
        cones = [_cone_directions_in_robot(description) for description in descriptions]
        counts = [len(rays) for rays in cones]
        self._rays_in_robot = np.concatenate(cones)
        self._origins_in_robot = np.repeat(
            [description.mount.position_m for description in descriptions], counts, axis=0
        )
        self._first_ray = np.cumsum([0, *counts[:-1]])
        self._noise_m = np.array([description.noise_m for description in descriptions])
        limits = np.repeat([one.max_incidence_rad for one in descriptions], counts)
        limits[self._first_ray] = math.pi  # the axis always brings an echo. Source: SonarSensor.uc
        self._min_cosine = np.cos(np.minimum(limits, 0.5 * math.pi))
        self._min_cosine[limits >= 0.5 * math.pi] = -1.0

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sonars."""
        return tuple(_part(description) for description in self._descriptions)

    def update(self, motion: MotionStep) -> None:
        """Ignore the way: a range is of one moment."""

    def read(self, context: SensorContext) -> SonarReadings:
        """Return the shortest distance in each cone, with noise, within each sonar's limits."""
        ranges: Floats = np.minimum.reduceat(self._echo_distances(context), self._first_ray)
        if self._noise_m.any():
            noise = self._stream.generator(context.tick).standard_normal(len(ranges))
            ranges = ranges + self._noise_m * noise
        told = clamp_ranges(
            ranges,
            min_m=np.array([sonar.min_range_m for sonar in self._descriptions]),
            max_m=np.array([sonar.max_range_m for sonar in self._descriptions]),
        )
        names = (sonar.name for sonar in self._descriptions)
        return SonarReadings(context.time_s, tuple(zip(names, told.tolist(), strict=True)))

    def _echo_distances(self, context: SensorContext) -> Floats:
        """Return (n,) metres of each ray; inf where nothing is met, or at too flat an angle."""
        pose = context.world_from_robot
        starts = pose.transform_points(self._origins_in_robot)
        rays = pose.rotate_directions(self._rays_in_robot)
        if not np.any(self._min_cosine > 0.0):  # no limit: no normals
            return context.environment.distances(starts, rays)
        distances, normals = context.environment.closest_hits(starts, rays)
        cosines = np.abs(np.sum(normals * rays, axis=1))
        return np.where(cosines >= self._min_cosine, distances, np.inf)


def _cone_directions_in_robot(sonar: SonarDescription) -> Floats:
    rays = cone_directions(
        sonar.beam_rad, num_rings=sonar.num_cones, rays_per_ring=sonar.rays_per_cone
    )
    return sonar.mount.parent_from_item().rotate_directions(rays)


def _part(sonar: SonarDescription) -> MountedPart:
    told = SonarConfiguration(
        name=sonar.name,
        max_range_m=sonar.max_range_m,
        min_range_m=sonar.min_range_m,
        beam_angle_rad=sonar.beam_rad,
        scan_interval_s=sonar.interval_s,
        max_angle_of_incidence_rad=sonar.max_incidence_rad,
        traces_per_cone=sonar.rays_per_cone,
        num_cones=sonar.num_cones,
    )
    return MountedPart(SonarRing.type, sonar.name, sonar.mount, told)
