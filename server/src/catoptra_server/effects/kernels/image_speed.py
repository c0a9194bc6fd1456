"""Largest speed in an image, ring by ring, before anything is rendered.

A speed v past the nearest distance D turns directions by |v| / D, times px per radian; dynamic
objects pass at the rates of the summary; a turn about the optical axis moves a pixel by the angle
times the image radius, a turn about another axis by px per radian. All are added as if they agreed
in one pixel, so the sum is a bound.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np

from catoptra_protocol.optics.image_scale import compute_image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.effect import EffectBound
from catoptra_server.effects.kernels.grey_levels import max_change_by_shift
from catoptra_server.effects.scene_summary import NUM_RINGS, SceneSummary

# Scales are known at sampled radii and smooth between them; a pixel centre exceeds them by less.
_INTERPOLATION_MARGIN = 1.001

# Fields of a summary that all functions of this module read.
MOTION_FIELDS = frozenset(
    {"scene_twist", "min_distances_m", "max_object_rates_rad_s", "max_radiance"}
)


def bound_motion(
    summary: SceneSummary, camera: RadialCamera, durations_s: Floats | float
) -> EffectBound:
    """Bound the change of an image in which everything moves, with its cause.

    The change is that of the continuous image, which has no samples that pass an edge all at once.

    Args:
        summary: Distances and motions.
        camera: Camera of the image.
        durations_s: Duration of the motion, one or (NUM_RINGS,).
    """
    durations_s = np.broadcast_to(durations_s, NUM_RINGS)
    displacements_px = durations_s * max_speeds_px_s(summary, camera)
    ring = int(displacements_px.argmax())
    displacement_px = float(displacements_px[ring])
    return EffectBound(
        max_change_by_shift(displacement_px, summary.max_radiance),
        describe_motion(summary, ring, float(durations_s[ring])),
        displacement_px,
    )


def max_speeds_px_s(summary: SceneSummary, camera: RadialCamera) -> Floats:
    """Largest speed in each ring of the image, (NUM_RINGS,), px/s."""
    scale, radius_px = ring_scales_and_radii(camera)
    x, y, z = summary.scene_twist.angular_rad_s
    # An infinite distance gives a rate of 0: a world without anything near needs no special case.
    rates = summary.scene_twist.speed_m_s / np.asarray(summary.min_distances_m)
    rates = rates + np.asarray(summary.max_object_rates_rad_s) + math.hypot(x, y)
    # The turn about the axis acts by the radius itself: near the image centre that is far less
    # than px per radian.
    speeds: Floats = rates * scale + abs(z) * radius_px
    return speeds


@lru_cache(maxsize=16)
def ring_scales_and_radii(camera: RadialCamera) -> tuple[Floats, Floats]:
    """Largest px per radian of each ring, and the ring's outer radius in px, (NUM_RINGS,) each."""
    scale = compute_image_scale(camera)
    largest = np.maximum(scale.radial, scale.tangential)
    radius_px = scale.radius_px
    edges_px = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1)
    # The maximum of a ring may lie on its edge, between two sampled radii: both edges belong to
    # each ring.
    radii = np.concatenate((radius_px, edges_px))
    at_edges = np.interp(edges_px, radius_px, largest)
    values = np.concatenate((largest, at_edges))
    rings = [
        values[(inner <= radii) & (radii <= outer)].max() for inner, outer in pairwise(edges_px)
    ]
    return _INTERPOLATION_MARGIN * np.array(rings), edges_px[1:]


def describe_motion(summary: SceneSummary, ring: int, duration_s: float) -> str:
    """Describe the motion in a ring and its duration, for the reason of a bound."""
    min_distance_m = summary.min_distances_m[ring]
    parts = []
    if summary.scene_twist.speed_m_s > 0.0 and math.isfinite(min_distance_m):
        parts.append(f"up to {summary.scene_twist.speed_m_s:.2g} m/s at {min_distance_m:.2g} m")
    turn = math.degrees(math.hypot(*summary.scene_twist.angular_rad_s))
    if turn > 0.0:
        parts.append(f"turns by up to {turn:.3g} degrees/s")
    object_rate_rad_s = summary.max_object_rates_rad_s[ring]
    if object_rate_rad_s > 0.0:
        parts.append(f"objects pass by at {math.degrees(object_rate_rad_s):.2g} degrees/s")
    return ", ".join((*parts, f"{1e3 * duration_s:.3g} ms")) if parts else "nothing moves"
