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

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.image_scale import image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.effect import Bound
from catoptra_server.effects.scene_summary import RINGS, SceneSummary

# Between the radii at which scales are known they are smooth, and pixels' middles reach no farther.
_BETWEEN = 1.001


def largest_way(summary: SceneSummary, camera: OmniCamera, duration_s: float) -> Bound:
    """Return the px that anything is carried in a duration, and what carries it."""
    ways_px = duration_s * largest_speeds(summary, camera)
    ring = int(ways_px.argmax())
    return Bound(float(ways_px[ring]), told(summary, ring, duration_s))


def largest_speeds(summary: SceneSummary, camera: OmniCamera) -> Floats:
    """Return the (RINGS,) largest px/s in each ring."""
    scale, radius_px = ring_scales(camera)
    x, y, z = summary.motion.angular_rad_s
    passing = summary.motion.speed_m_s / np.asarray(summary.nearest_m)
    passing = passing + np.asarray(summary.passing_rad_s) + math.hypot(x, y)
    speeds: Floats = passing * scale + abs(z) * radius_px
    return speeds


@lru_cache(maxsize=16)
def ring_scales(camera: OmniCamera) -> tuple[Floats, Floats]:
    """Return the largest px a radian of each ring, and its outer radius in px, (RINGS,) each."""
    scale = image_scale(camera)
    largest = np.maximum(scale.along, scale.across)
    radius_px = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(scale.t)
    edges_px = np.linspace(0.0, camera.rim_radius_px, RINGS + 1)
    # Beyond both of its edges, up to the next known radius.
    at = np.concatenate((radius_px, edges_px))
    of_edges = np.interp(edges_px, radius_px, largest)
    values = np.concatenate((largest, of_edges))
    rings = [values[(inner <= at) & (at <= outer)].max() for inner, outer in pairwise(edges_px)]
    return _BETWEEN * np.array(rings), edges_px[1:]


def told(summary: SceneSummary, ring: int, duration_s: float) -> str:
    """Return in words what moves in a ring, and how long."""
    nearest_m = summary.nearest_m[ring]
    parts = []
    if summary.motion.speed_m_s > 0.0 and math.isfinite(nearest_m):
        parts.append(f"up to {summary.motion.speed_m_s:.2g} m/s at {nearest_m:.2g} m")
    turn = math.degrees(math.hypot(*summary.motion.angular_rad_s))
    if turn > 0.0:
        parts.append(f"turns by up to {turn:.3g} degrees/s")
    if summary.passing_rad_s[ring] > 0.0:
        parts.append(f"bodies pass by at {math.degrees(summary.passing_rad_s[ring]):.2g} degrees/s")
    return ", ".join((*parts, f"{1e3 * duration_s:.3g} ms")) if parts else "nothing moves"
