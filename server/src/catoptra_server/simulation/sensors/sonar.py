"""Sonars: the nearest surface in each cone; all sonars of a robot report in one line."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import SonarReadings
from catoptra_protocol.usarsim.reports import SonarConfiguration
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)

# The cone of a level sonar meets the floor at 80 degrees or more from the normal. All captures of
# real servers have ranges beyond that point: a floor gives no echo, oblique walls do.
_MAX_ECHO_INCIDENCE_RAD = math.radians(75.0)


@dataclass(frozen=True, slots=True)
class SonarDescription:
    """One sonar, looking along the x axis of the mount."""

    name: str
    interval_s: float
    mount: Mount
    beam_rad: float
    """Full angle of the cone."""
    min_range_m: float
    max_range_m: float
    noise_m: float = 0.0
    """Standard deviation of each range."""
    num_cones: int = 3
    """Rings of rays around the axis that sample the cone."""
    rays_per_cone: int = 8
    max_incidence_rad: float = _MAX_ECHO_INCIDENCE_RAD
    """Largest angle between a ray off the axis and a surface normal that gives an echo."""


class _SonarRing:
    """All sonars of a robot, whose rays are cast together."""

    def __init__(
        self, descriptions: Sequence[SonarDescription], base: DriveBase, random_source: RandomSource
    ) -> None:
        self._descriptions = tuple(descriptions)
        self._random_source = random_source
        cones = [_cone_directions_in_robot(description) for description in descriptions]
        counts = [len(rays) for rays in cones]
        self._rays_in_robot = np.concatenate(cones)
        self._origins_in_robot = np.repeat(
            [description.mount.position_m for description in descriptions], counts, axis=0
        )
        self._first_ray = np.cumsum([0, *counts[:-1]])
        self._noise_m = np.array([description.noise_m for description in descriptions])
        limits = np.repeat([each.max_incidence_rad for each in descriptions], counts)
        limits[self._first_ray] = math.pi  # the axis always gives an echo. Source: SonarSensor.uc
        # A limit of 90 degrees or more accepts all surfaces; -1, since rounding makes cos(pi / 2)
        # positive.
        self._min_cosine = cos(np.minimum(limits, 0.5 * math.pi))
        self._min_cosine[limits >= 0.5 * math.pi] = -1.0

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: a range has one time."""

    def read(self, context: SensorContext) -> SonarReadings:
        """Shortest echo of each cone, with noise, clamped to the sonar's limits."""
        # The rays of a sonar are a slice of one array: one query of the ray caster for all.
        ranges: Floats = np.minimum.reduceat(self._echo_distances(context), self._first_ray)
        if self._noise_m.any():
            noise = np.array(self._random_source.normal_variates(context.tick, len(ranges)))
            ranges = ranges + self._noise_m * noise
        measured = np.clip(
            ranges,
            [sonar.min_range_m for sonar in self._descriptions],
            [sonar.max_range_m for sonar in self._descriptions],
        )
        names = (sonar.name for sonar in self._descriptions)
        return SonarReadings(context.time_s, tuple(zip(names, measured.tolist(), strict=True)))

    def _echo_distances(self, context: SensorContext) -> Floats:
        """Distance (n,) of each ray's echo; inf without a surface, or at too flat an angle."""
        pose = context.world_from_robot
        origins = pose.transform_points(self._origins_in_robot)
        rays = pose.rotate_directions(self._rays_in_robot)
        # Normals cost a second query of the ray caster: not computed where no limit needs them.
        if not np.any(self._min_cosine > 0.0):
            return context.environment.distances(origins, rays)
        distances, normals = context.environment.closest_hits(origins, rays)
        cosines = np.abs(np.sum(normals * rays, axis=1))
        return np.where(cosines >= self._min_cosine, distances, np.inf)


def _cone_directions_in_robot(sonar: SonarDescription) -> Floats:
    """Unit directions (1 + num_cones * rays_per_cone, 3) that sample a sonar's cone.

    The axis comes first, then the rings from the inside out to half the angle.
    """
    ring = np.repeat(np.arange(sonar.num_cones), sonar.rays_per_cone)
    off_axis = 0.5 * sonar.beam_rad * (ring + 1) / max(1, sonar.num_cones)
    # Every other ring is turned by half a step: rays fill the gaps of the ring inside.
    step = np.tile(np.arange(sonar.rays_per_cone), sonar.num_cones) + 0.5 * (ring % 2)
    around = 2.0 * math.pi * step / sonar.rays_per_cone
    sine = sin(off_axis)
    rays = np.stack((cos(off_axis), sine * cos(around), sine * sin(around)), axis=-1)
    return sonar.mount.parent_from_item().rotate_directions(
        np.concatenate((((1.0, 0.0, 0.0),), rays))
    )


def _configure(sonar: SonarDescription) -> SonarConfiguration:
    return SonarConfiguration(
        name=sonar.name,
        max_range_m=sonar.max_range_m,
        min_range_m=sonar.min_range_m,
        beam_angle_rad=sonar.beam_rad,
        scan_interval_s=sonar.interval_s,
        max_angle_of_incidence_rad=sonar.max_incidence_rad,
        traces_per_cone=sonar.rays_per_cone,
        num_cones=sonar.num_cones,
    )


def _read_description(item: ConfiguredSensor) -> SonarDescription:
    return SonarDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        beam_rad=item.get_float("BeamAngle", 0.3491, 3.1416),
        min_range_m=item.get_float("MinRange", 0.1),
        max_range_m=item.get_float("MaxRange", 5.0),
        noise_m=item.get_float("Noise", 0.0, 10.0),
        num_cones=item.section.get_int("NumberOfCones", 3, min_value=0, max_value=64),
        rays_per_cone=item.section.get_int("TracesPerCone", 8, min_value=1, max_value=256),
        max_incidence_rad=item.get_float("MaxAngleOfIncidence", _MAX_ECHO_INCIDENCE_RAD, 3.1416),
    )


SONAR = SensorKind(
    "Sonar",
    SonarDescription,
    _SonarRing,
    {"sonarsensor": _read_description, "sonar": _read_description},
    _configure,
    shared_stream="all sonars",
    casts_rays=True,
)
