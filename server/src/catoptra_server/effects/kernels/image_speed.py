"""How far what a camera sees moves at most through its picture, before anything is drawn.

Ring by ring of the image: a speed past the nearest range turns directions by |v| / D, times px a
radian; bodies pass by as the summary says; a turn about the optical axis carries by its angle times
the radius, one about the other axes by px a radian. All are added, as if they agreed somewhere.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np

from catoptra_protocol.optics.image_scale import compute_image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import EffectBound
from catoptra_server.effects.scene_summary import NUM_RINGS, SceneSummary

# Between the radii at which scales are known they are smooth, and pixels' middles reach no farther.
_INTERPOLATION_MARGIN = 1.001


def max_displacement(summary: SceneSummary, camera: OmniCamera, duration_s: float) -> EffectBound:
    """Return the px that anything is carried in a duration, and what carries it."""
    ways_px = duration_s * max_speeds_px_s(summary, camera)
    ring = int(ways_px.argmax())
    return EffectBound(float(ways_px[ring]), describe_motion(summary, ring, duration_s))


def max_speeds_px_s(summary: SceneSummary, camera: OmniCamera) -> Floats:
    """Return the (RINGS,) largest px/s in each ring."""
    scale, radius_px = ring_scales_and_radii(camera)
    x, y, z = summary.scene_twist.angular_rad_s
    passing = summary.scene_twist.speed_m_s / np.asarray(summary.min_distances_m)
    passing = passing + np.asarray(summary.max_object_rates_rad_s) + math.hypot(x, y)
    speeds: Floats = passing * scale + abs(z) * radius_px
    return speeds


@lru_cache(maxsize=16)
def ring_scales_and_radii(camera: OmniCamera) -> tuple[Floats, Floats]:
    """Return the largest px a radian of each ring, and its outer radius in px, (RINGS,) each."""
    scale = compute_image_scale(camera)
    largest = np.maximum(scale.radial, scale.tangential)
    radius_px = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(scale.t)
    edges_px = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1)
    # Beyond both of its edges, up to the next known radius.
    at = np.concatenate((radius_px, edges_px))
    of_edges = np.interp(edges_px, radius_px, largest)
    values = np.concatenate((largest, of_edges))
    rings = [values[(inner <= at) & (at <= outer)].max() for inner, outer in pairwise(edges_px)]
    return _INTERPOLATION_MARGIN * np.array(rings), edges_px[1:]


def describe_motion(summary: SceneSummary, ring: int, duration_s: float) -> str:
    """Return in words what moves in a ring, and how long."""
    nearest_m = summary.min_distances_m[ring]
    parts = []
    if summary.scene_twist.speed_m_s > 0.0 and math.isfinite(nearest_m):
        parts.append(f"up to {summary.scene_twist.speed_m_s:.2g} m/s at {nearest_m:.2g} m")
    turn = math.degrees(math.hypot(*summary.scene_twist.angular_rad_s))
    if turn > 0.0:
        parts.append(f"turns by up to {turn:.3g} degrees/s")
    if summary.max_object_rates_rad_s[ring] > 0.0:
        parts.append(
            f"bodies pass by at {math.degrees(summary.max_object_rates_rad_s[ring]):.2g} degrees/s"
        )
    return ", ".join((*parts, f"{1e3 * duration_s:.3g} ms")) if parts else "nothing moves"
