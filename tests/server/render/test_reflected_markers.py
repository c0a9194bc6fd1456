"""Drawn markers against an independent tracer of real mirror surfaces, in 50 digits.

A camera ray meets the surface, given by an implicit equation, is reflected by its gradient there,
and ends in a small luminous cube 0.2, 1 or 5 m behind. No formula of the camera model takes part
but the pinhole's place and the focal length. The cube's centroid in the traced picture lies at the
ray's pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mpmath import diff, mp, mpf, sqrt

from catoptra_protocol.optics.mirrors import ProfileMirror, SphericalMirror
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World
from helpers.long_cases import quick_cases
from helpers.markers import marker_centroid
from helpers.mirror_checks import make_camera

# f(r, depth) = 0 on the surface, < 0 before it as seen from the pinhole; depth from the pinhole.
Equation = Callable[[Any, Any], Any]

RIM = math.radians(115.0)
# A paraboloid z = r^2 / (2 p) of p = 40 mm, its vertex 0.15 m before the pinhole, as a table.
RADII = tuple(np.linspace(0.0, 0.1, 201).tolist())
PARABOLOID = ProfileMirror(RADII, tuple(r * r / 0.08 for r in RADII), 0.15, RIM)
MIRRORS: dict[str, tuple[NonCentralMirror, Equation]] = {
    "sphere": (
        SphericalMirror(0.03, 0.2, RIM),
        lambda r, depth: mpf("0.03") - sqrt(r**2 + (depth - mpf("0.2")) ** 2),
    ),
    "paraboloid": (PARABOLOID, lambda r, depth: depth - mpf("0.15") - r**2 / mpf("0.08")),
}
SIZE_PX = 640
# Image radii as fractions of the rim's.
RADII_PX = (0.35, 0.6, 0.8, 0.95)
DISTANCES_M = (0.2, 1.0, 5.0)
# Half the edge of a cube, as an angle: samples place the centroid of a smaller one less exactly,
# over a larger one the image bends.
HALF_EDGE_RAD = 0.007


def reflect_pixel(
    camera: Any, equation: Equation, radius_px: float, distance_m: float
) -> tuple[float, float]:
    """(rho, depth) of the point that a pixel of an image radius sees behind its mirror's point."""
    with mp.workdps(50):
        slope = mpf(radius_px) * mpf(camera.inverse_focal_length)
        depth = mp.findroot(lambda d: equation(slope * d, d), _bracket(equation, slope))
        r = slope * depth
        normal = (diff(lambda x: equation(x, depth), r), diff(lambda y: equation(r, y), depth))
        length = sqrt(normal[0] ** 2 + normal[1] ** 2)
        n_r, n_depth = normal[0] / length, normal[1] / length
        norm = sqrt(1 + slope**2)
        d_r, d_depth = slope / norm, 1 / norm
        along = 2 * (d_r * n_r + d_depth * n_depth)
        return (
            float(r + distance_m * (d_r - along * n_r)),
            float(depth + distance_m * (d_depth - along * n_depth)),
        )


def _bracket(equation: Equation, slope: Any) -> Any:
    """A depth near the first crossing of a camera ray."""
    depths = [mpf(step) / 2000 for step in range(20, 2000)]
    return next(d for d in depths if equation(slope * d, d) >= 0)


@pytest.mark.parametrize("name", quick_cases(MIRRORS, 0))
def test_markers_are_drawn_where_the_surface_reflects_them(name: str) -> None:
    mirror, equation = MIRRORS[name]
    camera = make_camera(mirror, SIZE_PX)
    assert not camera.is_central
    centre = np.array(camera.centre_px)
    expected, items = [], []
    for ring, fraction in enumerate(RADII_PX):
        radius_px = fraction * camera.rim_radius_px
        for number, distance_m in enumerate(DISTANCES_M):
            rho, depth = reflect_pixel(camera, equation, radius_px, distance_m)
            azimuth = 0.3 + 2.1 * number + 0.7 * ring
            height = mirror.pinhole_distance_m - depth
            position = (rho * math.cos(azimuth), rho * math.sin(azimuth), height)
            edge = 2.0 * HALF_EDGE_RAD * distance_m
            cube, white = Box((edge, edge, edge)), Material((1.0, 1.0, 1.0), unlit=True)
            items.append(Item(f"cube {len(items)}", cube, Pose.from_rpy(position), white))
            expected.append(centre + radius_px * image_direction(camera, azimuth))
    world = World("markers", tuple(items))
    settings = RenderSettings(samples=8)
    plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="test")
    renderer = TraceRenderer(build_scene(world), world, threads=2)
    try:
        view = renderer.prepare(camera, plan)
        image = view.render(CameraState(Pose.identity())).rgb
    finally:
        renderer.close()
    missed = [
        float(np.linalg.norm(marker_centroid(image, pixel, window_px=9.0) - pixel))
        for pixel in expected
    ]
    assert max(missed) < 0.05


def image_direction(camera: Any, azimuth_rad: float) -> Floats:
    """(2,) unit direction from the image's centre of an azimuth, by the picture's convention."""
    turn = azimuth_rad - camera.image_up_azimuth_rad
    # As the capture camera sees it: clockwise in the world is anticlockwise here.
    return np.array((-math.sin(turn), -math.cos(turn)))
