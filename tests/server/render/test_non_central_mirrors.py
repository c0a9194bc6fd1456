"""Mirrors without a viewpoint: exact in trace, refused by raster, approximated on demand."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import near_limit_m, pixel_from_point
from catoptra_protocol.optics.mirrors import (
    ConicalMirror,
    EquiangularMirror,
    ProfileMirror,
    RadialTableMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import generate_candidate_plans
from catoptra_server.frames.plan.plans import choose_by_settings
from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World
from helpers.long_cases import quick_cases
from helpers.mirror_checks import make_camera
from helpers.worlds import make_plan

BALL = SphericalMirror(0.03, 0.2)
SAG = tuple(8.0 * r * r for r in (0.0, 0.01, 0.02, 0.03, 0.05))
MIRRORS: dict[str, NonCentralMirror] = {
    "spherical": BALL,
    "equiangular": EquiangularMirror(11.0, 0.1),
    "conical": ConicalMirror(math.radians(60.0), 0.1, math.radians(88.0)),
    # 64 x - x^3 of 32 degrees.
    "radial_table": RadialTableMirror(
        (0.0, 32.0, 64.0, 96.0, 128.0),
        tuple((64.0 * x - x**3) / 1024.0 for x in (0.0, 1.0, 2.0, 3.0, 4.0)),
        0.15,
    ),
    "profile": ProfileMirror((0.0, 0.01, 0.02, 0.03, 0.05), SAG, 0.2, math.radians(70.0)),
}
STILL = CameraState(Pose.identity())
WHITE = Material((1.0, 1.0, 1.0), unlit=True)


def draw_marks(camera: OmniCamera, marks: list[tuple[Floats, tuple[float, float]]]) -> Floats:
    """(h, w) light of white plates, at 4 x 4 samples: (3,) centres, width and height, metres.

    Each faces the viewpoint: of a cube the nearer sides would displace the centroid.
    """
    items = []
    for index, (point, (width, height)) in enumerate(marks):
        azimuth, level = math.atan2(point[1], point[0]), math.hypot(point[0], point[1])
        towards = Pose.from_rpy(point, (0.0, -math.atan2(point[2], level), azimuth))
        items.append(Item(f"mark{index}", Box((1e-3 * height, width, height)), towards, WHITE))
    world = World("marks", tuple(items), background=(0.0, 0.0, 0.0))
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    view = renderer.prepare(camera, make_plan(camera, samples=4))
    light = view.render_linear(STILL)[..., 1].astype(np.float64)
    renderer.close()
    return light


def centroid_px(light: Floats, near: Floats, reach_px: float = 12.0) -> Floats:
    """Centroid of the light within some pixels of a pixel."""
    v, u = np.indices(light.shape) + 0.5
    part = np.where(np.hypot(u - near[0], v - near[1]) < reach_px, light, 0.0)
    assert part.sum() > 0.0, "the mark is in view"
    return np.array([(part * u).sum(), (part * v).sum()]) / part.sum()


@pytest.mark.parametrize(
    ("distance_m", "name"),
    # Each mirror near by, where it errs most without exact rays; one farther away.
    quick_cases(product((0.2, 1.0, 5.0), MIRRORS), *range(len(MIRRORS)), 2 * len(MIRRORS)),
)
def test_mark_is_drawn_at_its_own_pixel(name: str, distance_m: float) -> None:
    mirror = MIRRORS[name]
    camera = make_camera(mirror, 400)
    low, high = 2.0 * math.atan(mirror.t_min), mirror.rim_rad
    marks = []
    # Next to a cone's apex a mark is an arc, whose centroid lies inside of its middle.
    first = 0.1 if mirror.t_min == 0.0 else 0.4
    for fraction, azimuth in ((first, 0.4), (0.6, 2.0), (0.9, -1.1)):
        theta = low + fraction * (high - low)
        t = np.array(math.tan(0.5 * theta))
        r, z = mirror.surface_point(t)
        rho, height = r + distance_m * math.sin(theta), z + distance_m * math.cos(theta)
        point = np.array([rho * math.cos(azimuth), rho * math.sin(azimuth), height])
        # Four pixels along and across the image radius.
        across = float(camera.radius_px_from_t(t)) / math.sin(theta)
        along = float(camera.radius_slope_px(t))
        marks.append((point, (4.0 * distance_m / across, 4.0 * distance_m / along)))
    light = draw_marks(camera, marks)
    for point, _ in marks:
        expected, valid = pixel_from_point(camera, point)
        assert valid
        assert centroid_px(light, expected) == pytest.approx(expected, abs=0.1)


def test_exact_and_approximated_frames_differ_by_the_mirror_s_own_parallax() -> None:
    camera = make_camera(BALL, 360)
    approximated = replace(camera, is_approximated=True)
    # In the viewpoint's frame; off the mirror's ray by the miss.
    point = np.array([0.5 * math.sin(1.8), 0.0, 0.5 * math.cos(1.8)])
    near = pixel_from_point(camera, point)[0]
    size_m = 3.0 / float(camera.radius_slope_px(np.array(math.tan(0.9))))
    exact_px, approximated_px = (
        centroid_px(draw_marks(one, [(point, (size_m, size_m))]), near)
        for one in (camera, approximated)
    )
    shift_px = np.linalg.norm(exact_px - approximated_px)
    model_px = np.linalg.norm(
        pixel_from_point(camera, point)[0] - pixel_from_point(approximated, point)[0]
    )
    assert model_px > 0.3
    assert shift_px == pytest.approx(model_px, abs=0.05)


def spec(camera: OmniCamera, renderer: str = "") -> OmniCameraSpec:
    return OmniCameraSpec(camera, RenderSettings(renderer=renderer))


def test_raster_is_replaced_by_trace_and_says_from_which_distance() -> None:
    camera = make_camera(BALL, 360)
    central, choice = (
        choose_by_settings(
            spec(one), RendererKind.RASTER, "", usable=[RendererKind.TRACE, RendererKind.RASTER]
        )
        for one in (replace(camera, is_approximated=True), camera)
    )
    assert central.plan.renderer is RendererKind.RASTER
    assert choice.plan.renderer is RendererKind.TRACE
    assert f"nearer than {near_limit_m(camera):.3g} m" in choice.plan.reason


def test_limit_of_raster_is_that_of_the_configured_error() -> None:
    camera = make_camera(BALL, 360)
    strict = OmniCameraSpec(camera, RenderSettings(central_error_px=0.1))
    choice = choose_by_settings(
        strict, RendererKind.RASTER, "", usable=[RendererKind.TRACE, RendererKind.RASTER]
    )
    limit = f"nearer than {near_limit_m(camera, 0.1):.3g} m would be displaced by more than 0.1 px"
    assert limit in choice.plan.reason


def test_raster_alone_is_refused_with_the_remedies() -> None:
    with pytest.raises(DomainError, match=r"choose the renderer trace, or state Central=always"):
        choose_by_settings(
            spec(make_camera(BALL)), RendererKind.RASTER, "", usable=[RendererKind.RASTER]
        )


def test_candidates_of_an_accuracy_target_are_exact() -> None:
    plans = list(generate_candidate_plans(PerPixel(), make_camera(BALL), list(RendererKind)))
    assert {plan.renderer for plan in plans} == {RendererKind.TRACE}
