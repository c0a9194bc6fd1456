"""Faces, texels and draw calls of a frame, counted."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.projection.atlas import GUARD_TEXELS
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.raster.face_pass import DrawCounts
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Box, Item, Material, World, linear_from_srgb
from helpers.dynamic_objects import place_cube
from helpers.image_comparison import mask_away_from_edges
from helpers.opengl import make_raster
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_plan, regions_of_size


@pytest.fixture(scope="module")
def renderer(device: GlDevice) -> RasterRenderer:
    return make_raster(device)


def count_draws(
    renderer: RasterRenderer, rim_deg: float, camera_state: CameraState = CAMERA_STATE
) -> DrawCounts:
    camera = make_omni_camera(width_px=96, rim_deg=rim_deg)
    view = renderer.prepare(camera, make_plan(camera))
    view.render(camera_state)
    view.close()
    return view.face_counts


@pytest.mark.parametrize(
    ("rim_deg", "cells"),
    [
        (90.0, 5),
        (100.0, 5),
        (110.0, 5),
        (120.0, 5),
        (125.26, 5),
        (125.27, 6),
        (135.0, 6),
        (150.0, 6),
    ],
)
def test_sixth_face_is_rendered_only_beyond_its_limit(
    renderer: RasterRenderer, rim_deg: float, cells: int
) -> None:
    assert count_draws(renderer, rim_deg).num_cells == cells


@pytest.mark.parametrize("rim_deg", [60.0, 90.0, 100.0, 110.0, 120.0, 125.2, 135.0, 150.0])
def test_only_texels_of_the_plan_are_rendered(renderer: RasterRenderer, rim_deg: float) -> None:
    camera = make_omni_camera(width_px=96, rim_deg=rim_deg)
    parts = make_plan(camera).face_regions
    # Whole texels, and the guard on both sides.
    around = 2 * GUARD_TEXELS + 1
    most = sum((part.size_texels[0] + around) * (part.size_texels[1] + around) for part in parts)
    rendered = count_draws(renderer, rim_deg).num_texels
    assert sum(part.num_texels for part in parts) < rendered <= most


@pytest.mark.parametrize("rim_deg", [60.0, 90.0, 100.0, 110.0, 120.0, 125.2, 135.0, 150.0])
def test_density_saves_a_fifth_of_the_texels_of_one_size(rim_deg: float) -> None:
    camera = make_omni_camera(width_px=640, rim_deg=rim_deg)
    of_one_size = regions_of_size(camera.rim_rad, math.ceil(1.01 * camera.width_px))
    texels = sum(part.num_texels for part in make_plan(camera).face_regions)
    assert texels < 0.8 * sum(part.num_texels for part in of_one_size)


def test_side_faces_are_not_rendered_for_a_mirror_that_looks_down_only(
    renderer: RasterRenderer,
) -> None:
    assert count_draws(renderer, 40.0).num_cells == 1


def test_lower_rim_costs_fewer_texels(renderer: RasterRenderer) -> None:
    def texels(rim_deg: float) -> int:
        camera = make_omni_camera(width_px=96, rim_deg=rim_deg)
        view = renderer.prepare(camera, make_plan(camera, face_size_px=96))
        view.render(CAMERA_STATE)
        view.close()
        return view.face_counts.num_texels

    of_rims = [texels(rim_deg) for rim_deg in (30.0, 60.0, 90.0, 120.0, 130.0)]
    assert of_rims == sorted(set(of_rims))


def test_face_without_surfaces_sends_no_triangles(renderer: RasterRenderer) -> None:
    above = renderer.prepare_face(FaceCamera(Face.U, 32), 1)
    image = above.render(CameraState(Pose.from_rpy((0.0, 0.0, -5.0))))
    assert above.face_counts.num_draw_calls == 0
    assert (image.rgb == image.rgb[0, 0]).all()
    above.close()


@pytest.mark.parametrize(
    ("at", "faces"), [((3.0, 0.0, 0.0), 1), ((0.0, 0.0, 3.0), 1), ((3.0, 3.0, 0.0), 2)]
)
def test_cell_without_surfaces_has_no_draw_call(
    device: GlDevice, at: tuple[float, float, float], faces: int
) -> None:
    post = Item("post", Box((0.2, 0.2, 0.2)), Pose.from_rpy(at), Material((0.5, 0.5, 0.5)))
    small = World("post", (post,), background=(0.2, 0.2, 0.2))
    renderer = make_raster(device, small)
    rendered = count_draws(renderer, 120.0, CameraState(Pose.identity()))
    assert (rendered.num_cells, rendered.num_draw_calls, rendered.num_triangles) == (
        5,
        faces,
        12 * faces,
    )


@pytest.mark.parametrize(("at", "faces"), [((3.0, 0.0, 0.0), 1), ((0.0, 0.0, 3.0), 1)])
def test_cell_without_objects_has_no_draw_call(
    device: GlDevice, at: tuple[float, float, float], faces: int
) -> None:
    empty = World("empty", (), background=(0.2, 0.2, 0.2))
    renderer = make_raster(device, empty)
    here = CameraState(Pose.identity())
    assert count_draws(renderer, 120.0, here).num_draw_calls == 0
    rendered = count_draws(renderer, 120.0, replace(here, objects=(place_cube(*at),)))
    assert (rendered.num_draw_calls, rendered.num_triangles) == (faces, 12 * faces)


def test_more_samples_than_the_device_has_are_rejected(renderer: RasterRenderer) -> None:
    camera = make_omni_camera(width_px=32)
    with pytest.raises(DomainError, match="samples a texel"):
        renderer.prepare(camera, make_plan(camera, face_samples=1024))


def test_resolved_face_averages_in_linear_light(renderer: RasterRenderer) -> None:
    camera = make_omni_camera(width_px=96)
    plain, smooth = (
        renderer.prepare(camera, make_plan(camera, face_samples=samples)) for samples in (1, 4)
    )
    one, four = plain.render(CAMERA_STATE).rgb, smooth.render(CAMERA_STATE).rgb
    # Steps at edges become ramps; the light as a whole stays, to a thousandth of full scale.
    assert (
        mask_away_from_edges(four, contrast=64).sum() > mask_away_from_edges(one, contrast=64).sum()
    )
    light = [linear_from_srgb(image / 255.0).mean() for image in (one, four)]
    assert light[0] == pytest.approx(light[1], abs=1e-3)
    plain.close()
    smooth.close()
