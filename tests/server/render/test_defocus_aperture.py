"""Defocus against a lens whose aperture is traced ray by ray, in the bundled worlds.

256 rays a pixel, through as many points of the aperture and of the pixel; compared in encoded grey
levels, as images of 640 px whose discs are up to 4 px wide: F/2 at a pitch of 4.2 um. Pixels that
the rim's edge crosses are left out: the lens blurs the rim too, by a disc of its own, the effect
does not. Where discs are narrower than two pixels, images of whole pixels cannot locate an edge
within a pixel as well: at F/4 the field's lines bring 1.3 grey levels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.world_file import read_world
from catoptra_server.effects import ImageEffect
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World
from helpers.blur_measurement import inner_pixels
from helpers.image_comparison import grey_levels
from helpers.lens_ray_tracer import focus_lens, render_through_lens, telecentric_lens
from helpers.long_cases import quick_cases
from helpers.worlds import make_omni_camera, make_plan

WIDTH_PX = 640
PITCH_M = 7.4e-6 * 360.0 / WIDTH_PX
CAMERA = make_omni_camera(width_px=WIDTH_PX)
LENS = Aperture(2.0, PITCH_M, 0.0)
# Every eighth pixel both ways: 5000 on the mirror.
EVERY_PX = 8
POSES = {
    "four_legged_2006": Pose.from_rpy((0.5, 0.3, -0.6), (0.0, 0.0, 0.3)),
    "corridor": Pose.from_rpy((0.5, 0.1, -0.6), (0.0, 0.0, 0.3)),
}
# Distance from the viewpoint, azimuth and height of boxes beside the mirror.
BOXES = ((0.12, 0.3, 0.02), (0.16, 1.7, -0.05), (0.22, 3.1, 0.08), (0.3, 4.6, -0.02))


@dataclass(frozen=True)
class CameraSite:
    """A world with a camera in it."""

    world: World
    camera_state: CameraState


@cache
def make_site(name: str, *, objects_near: bool) -> CameraSite:
    world, _ = read_world(find_configuration("worlds", name))
    near = tuple(_box(POSES[name], number) for number in range(len(BOXES)))
    items = world.items + near if objects_near else world.items
    return CameraSite(replace(world, items=items), CameraState(POSES[name]))


def _box(pose: Pose, number: int) -> Item:
    distance, azimuth, height = BOXES[number]
    aside = (distance * math.cos(azimuth), distance * math.sin(azimuth), height)
    colour = (0.9 - 0.2 * number, 0.2 + 0.2 * number, 0.1)
    at = pose @ Pose.from_rpy(aside, (0.2, 0.3, azimuth))
    return Item(f"near{number}", Box((0.03, 0.08, 0.06)), at, Material(colour))


@cache
def render_reference(name: str, *, objects_near: bool) -> Floats:
    site = make_site(name, objects_near=objects_near)
    lens = focus_lens(CAMERA, LENS)
    pose = site.camera_state.world_from_mirror
    return render_through_lens(lens, CAMERA, site.world, pose, stride_px=EVERY_PX)


def rmse_levels(
    light: Floats, expected: Floats, camera: OmniCamera = CAMERA, every_px: int = EVERY_PX
) -> float:
    """RMS error of an image, in encoded grey levels, within the mirror's rim."""
    inner = inner_pixels(camera, 4.0)[::every_px, ::every_px]
    one, other = grey_levels(light), grey_levels(expected)
    return float(np.sqrt(np.square(one - other)[inner].mean()))


def render_traced(site: CameraSite, *effects: ImageEffect) -> Floats:
    renderer = TraceRenderer(build_scene(site.world), site.world, threads=2)
    view = renderer.prepare(CAMERA, make_plan(CAMERA, samples=5))
    light = view.render_linear(site.camera_state, effects)[::EVERY_PX, ::EVERY_PX]
    renderer.close()
    return light.astype(np.float64)


@pytest.mark.parametrize("name", quick_cases(POSES, 0))
def test_image_when_blurred_equals_that_of_a_traced_aperture(name: str) -> None:
    expected = render_reference(name, objects_near=False)
    sharp, blurred = (
        render_traced(make_site(name, objects_near=False), *e) for e in ((), (Defocus(LENS),))
    )
    assert rmse_levels(blurred, expected) < 1.0
    assert rmse_levels(sharp, expected) > 2.0


@pytest.mark.parametrize("name", quick_cases(POSES, 1))
def test_image_of_near_objects_needs_their_depths(name: str) -> None:
    expected = render_reference(name, objects_near=True)
    site = make_site(name, objects_near=True)
    by_depth, fixed = (render_traced(site, effect(LENS)) for effect in (DefocusByDepth, Defocus))
    assert rmse_levels(by_depth, expected) < 1.0
    assert rmse_levels(by_depth, expected) < 0.95 * rmse_levels(fixed, expected)


@pytest.mark.parametrize("name", quick_cases(POSES, 1))
def test_raster_image_when_blurred_equals_that_of_a_traced_aperture(
    device: GlDevice, name: str
) -> None:
    site = make_site(name, objects_near=True)
    renderer = RasterRenderer(build_scene(site.world), site.world, device=device)
    plan = make_plan(CAMERA, samples=4, face_size_px=2 * WIDTH_PX, face_samples=2)
    view = renderer.prepare(CAMERA, plan)
    blurred = view.render_linear(site.camera_state, (DefocusByDepth(LENS),))[::EVERY_PX, ::EVERY_PX]
    view.close()
    expected = render_reference(name, objects_near=True)
    assert rmse_levels(blurred.astype(np.float64), expected) < 1.0


def test_telecentric_image_when_blurred_equals_that_of_traced_cones() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), width_px=WIDTH_PX, rim_deg=110.0)
    rim_m = float(camera.mirror.surface_point(np.array(camera.rim_t))[0])
    px_per_m = camera.rim_radius_px / rim_m
    lens = Aperture(1.0, 3e-6, 0.0)
    rays = telecentric_lens(
        px_per_m,
        slope=0.5 * px_per_m * lens.pixel_pitch_m / lens.f_number,
        focus_height_m=lens.focus_coordinate(camera),
    )
    site = make_site("corridor", objects_near=False)
    pose = site.camera_state.world_from_mirror
    expected = render_through_lens(rays, camera, site.world, pose, stride_px=EVERY_PX)
    renderer = TraceRenderer(build_scene(site.world), site.world, threads=2)
    view = renderer.prepare(camera, make_plan(camera, samples=4))
    sharp, blurred = (
        view.render_linear(site.camera_state, effects)[::EVERY_PX, ::EVERY_PX].astype(np.float64)
        for effects in ((), (Defocus(lens),))
    )
    renderer.close()
    assert rmse_levels(blurred, expected, camera) < 1.0
    assert rmse_levels(sharp, expected, camera) > 1.5
