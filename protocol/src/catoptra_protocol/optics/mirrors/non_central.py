"""Mirrors without a single viewpoint, under a pinhole camera on the axis.

A camera ray at the angle psi from the axis meets the surface at (r, depth), depth counted from the
pinhole, and is reflected to the scene at theta = psi + 2 beta, beta the tilt of the surface's
normal. The image radius is f tan(psi), so its unit is the focal length; the projection, theta of an
image radius, is that of points at infinity.

The rays miss every point of the axis. The effective viewpoint is the one from which the image looks
most alike: it minimizes the largest product of miss and pixels per radian up to the rim, which is
the image error of a scene at one metre, in focal lengths. Source: Swaminathan, Grossberg & Nayar,
IJCV 66 (2006).

A class with `reflect` is enough: projection, inverse and best viewpoint follow, and plans and
effects need no line for it. Trace takes origins as well as directions (`optics/camera_rays.py`);
the kernel's proofs have a pyramid for each part of the image, its apex behind the origins of all
its rays. Frames take 1.07 to 1.23 times as long as from one viewpoint. Raster draws from one
viewpoint alone: with `Central=always`, the error bound counts the miss as an angle at the nearest
triangle, ring by ring.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.curves import solve_increasing, tabulate
from catoptra_protocol.optics.elementary import arctan, cos, sin, tan
from catoptra_protocol.optics.numerics import Floats, require_domain
from catoptra_protocol.optics.radial_camera import NO_FOLD
from catoptra_protocol.slotted_dataclass import dataclass

# Errors are smooth in psi: 513 rays find their largest to 1e-5.
_NUM_RAYS = 513
# Each step of the golden section keeps 0.618 of the interval: 1e-16 of it in 80.
_SECTION_STEPS = 80
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_SLACK = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Reflection:
    """Rays of a camera, reflected; arrays of one shape."""

    theta: Floats
    """Angle of the scene ray from the axis towards the pinhole, radians."""
    slope: Floats
    """d(theta) / d(psi)."""
    r: Floats
    """Distance of the mirror's point from the axis, metres."""
    depth: Floats
    """Distance of the mirror's point from the pinhole along the axis, metres."""


class NonCentralMirror(ABC):
    """Base of the mirrors: a subclass reflects, the rest follows."""

    __slots__ = ()

    @property
    @abstractmethod
    def rim_rad(self) -> float:
        """Angle theta of the scene ray at the mirror's edge."""

    @property
    @abstractmethod
    def psi_limit(self) -> float:
        """Camera angle that no ray to the surface exceeds, radians."""

    @abstractmethod
    def reflect(self, psi: Floats) -> Reflection:
        """Reflect camera rays. Domain: 0 <= psi < psi_limit."""

    @property
    def is_central(self) -> bool:
        """False: rays miss the effective viewpoint."""
        return False

    @property
    def t_min(self) -> float:
        """Half-angle tangent in the image's centre, 0."""
        return 0.0

    @property
    def t_limit(self) -> float:
        """Half-angle tangent just behind the rim."""
        return tan(0.5 * self.rim_rad) * (1.0 + _SLACK)

    @property
    def fold_rad(self) -> float:
        """Infinity: a convex surface without inflection does not fold."""
        return NO_FOLD

    @property
    def pinhole_distance_m(self) -> float:
        """Distance from the effective viewpoint to the pinhole."""
        return _viewpoint_depth_m(self)

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Image radius over the focal length, tan(psi). Domain: t_min <= t <= t_limit."""
        return tan(self._psi_from_t(t))

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of an image radius; inf beyond the rim. Domain: ratio >= 0."""
        return self.ray_from_radius_ratio(ratio)[0]

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(tan(psi)) / d(theta). Domain: t_min <= t <= t_limit."""
        psi = self._psi_from_t(t)
        slope: Floats = (1.0 + np.square(tan(psi))) / self.reflect(psi).slope
        return slope

    def surface_point(self, t: Floats) -> tuple[Floats, Floats]:
        """Mirror point (r, z) in metres that reflects a ray. Domain: t_min <= t <= t_limit."""
        reflection = self.reflect(self._psi_from_t(t))
        return reflection.r, self.pinhole_distance_m - reflection.depth

    def ray_from_radius_ratio(self, ratio: Floats) -> tuple[Floats, Floats, Floats]:
        """Half-angle tangent and mirror point (t, r, z) of an image radius; t inf beyond the rim.

        Domain: ratio >= 0.
        """
        require_domain(ratio >= 0.0, ratio, "an image radius is 0 or more")
        last = _rim_psi(self)
        psi = arctan(ratio)
        inside = psi <= last * (1.0 + _SLACK)
        reflection = self.reflect(np.minimum(psi, last))
        t = np.where(inside, tan(0.5 * reflection.theta), math.inf)
        return t, reflection.r, self.pinhole_distance_m - reflection.depth

    def largest_miss_m(self, t: Floats) -> Floats:
        """Distances at which rays of t pass the effective viewpoint, metres."""
        psi = self._psi_from_t(t)
        return np.abs(_miss(self.reflect(psi), self.pinhole_distance_m))

    def _psi_from_t(self, t: Floats) -> Floats:
        low, high = self.t_min * (1.0 - _SLACK), self.t_limit * (1.0 + _SLACK)
        expected = f"a mirror's ray needs {low:g} <= t = tan(theta / 2) <= {high!r}, its rim"
        require_domain((t >= low) & (t <= high), t, expected)
        theta = 2.0 * arctan(t)
        return solve_increasing(
            lambda psi: self.reflect(psi).theta,
            lambda psi: self.reflect(psi).slope,
            theta,
            _angle_table(self),
        )


def check_vertex_distance(distance_m: float) -> None:
    """Raise DomainError unless the pinhole lies before a mirror's vertex."""
    if not (math.isfinite(distance_m) and distance_m > 0.0):
        raise DomainError(f"the pinhole must lie before the vertex: {distance_m!r} m")


def check_rim(mirror: NonCentralMirror) -> None:
    """Raise DomainError for a rim that no ray of the mirror reaches."""
    if not math.isfinite(mirror.rim_rad):
        raise DomainError(f"a mirror needs a finite rim, not {mirror.rim_rad!r}")
    within = mirror.psi_limit * (1.0 - 1e-12)
    ends = mirror.reflect(np.array((0.0, within))).theta
    if not float(ends[0]) < mirror.rim_rad <= float(ends[1]):
        low, high = (math.degrees(float(end)) for end in ends)
        raise DomainError(
            f"a rim at {math.degrees(mirror.rim_rad):g} deg lies beyond the reach of this mirror: "
            f"it must be above {low:g} and at most {high:.3f} deg"
        )


def _miss(reflection: Reflection, viewpoint_depth_m: float) -> Floats:
    """Signed distance of the viewpoint from each ray."""
    offset = viewpoint_depth_m - reflection.depth
    return reflection.r * cos(reflection.theta) - offset * sin(reflection.theta)


@lru_cache(maxsize=64)
def _angle_table(mirror: NonCentralMirror) -> tuple[Floats, Floats]:
    return tabulate(lambda psi: mirror.reflect(psi).theta, 0.0, mirror.psi_limit * (1.0 - 1e-12))


@lru_cache(maxsize=64)
def _rim_psi(mirror: NonCentralMirror) -> float:
    return float(mirror._psi_from_t(np.array(tan(0.5 * mirror.rim_rad))))


@lru_cache(maxsize=64)
def _viewpoint_depth_m(mirror: NonCentralMirror) -> float:
    """Depth of the effective viewpoint from the pinhole: a convex minimum, by golden section."""
    psi = np.linspace(0.0, _rim_psi(mirror), _NUM_RAYS)
    reflection = mirror.reflect(psi)
    weight = (1.0 + np.square(tan(psi))) / reflection.slope

    def largest(depth_m: float) -> float:
        return float((weight * np.abs(_miss(reflection, depth_m))).max())

    # Rays meet the axis between these depths; those of the centre run along it.
    sine = sin(reflection.theta[1:])
    crossing = reflection.depth[1:] + reflection.r[1:] * cos(reflection.theta[1:]) / sine
    low, high = float(crossing.min()), float(crossing.max())
    for _ in range(_SECTION_STEPS):
        inner, outer = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if largest(inner) <= largest(outer):
            high = outer
        else:
            low = inner
    return 0.5 * (low + high)
