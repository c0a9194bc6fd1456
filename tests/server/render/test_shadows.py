"""Shadows in both renderers: equal to the float64 reference, and to each other.

The cameras look straight down or ahead with square pixels, so every pixel's centre is a known
position on a known facet. Trace is compared ray by ray. Raster is not compared within two texels of
a shadow's silhouette: half a texel's diagonal of the map, and the slope bias of casters (see
shadow_maps.SLOPE_BIAS_TEXELS).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_caster import commit_to_reference
from catoptra_server.world import shapes as primitives
from catoptra_server.world.objects import CameraState, DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    Light,
    PointLight,
    World,
    srgb_from_linear,
)
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.image_comparison import level_differences, mask_away_from_edges
from helpers.renderers import RendererFactory
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    GREY,
    POINT_LIGHT,
    box_item,
    floor_item,
    make_inward_facing_room,
    make_world,
    reference_radiance,
)
from helpers.worlds import (
    CAMERA_STATE,
    HEMISPHERE_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
)
from helpers.worlds import DIRECTIONAL_LIGHT as ROOM_SUN
from helpers.worlds import POINT_LIGHT as ROOM_LAMP

CAMERA = PerspectiveCamera(160, 160, math.radians(80.0))
# 1.5 m above the floor, x ahead turned down; a little off so that no edge lines up by accident.
ABOVE = Pose.from_rpy((0.05, 0.03, -1.5), (0.0, -0.5 * math.pi, 0.0))
BOXES = make_world(
    floor_item(),
    box_item(0.3, 0.1, -0.15, (0.3, 0.2, 0.3)),
    box_item(-0.5, -0.4, -0.4, (0.1, 0.4, 0.02)),
)


def render(make_renderer: RendererFactory, world: World, camera_state: CameraState) -> Image:
    view = make_renderer(world).prepare_perspective(CAMERA, 1)
    image = view.render(camera_state).rgb
    view.close()
    return image


def camera_ray_hits(at: Pose, *objects: DynamicObject) -> CameraState:
    return CameraState(at, objects, has_shadows=True)


def reference_image(world: World, at: Pose) -> tuple[Image, np.ndarray]:
    """Image of a camera by the float64 model, and (h, w) mask of certain pixels."""
    scene = build_scene(world)
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px] + 0.5
    rays, _ = CAMERA.direction_from_pixel(np.stack((u, v), axis=-1))
    rays = at.rotate_directions(rays.reshape(-1, 3))
    distance, normals = commit_to_reference(scene).closest_hits(
        np.tile(at.translation, (len(rays), 1)), rays
    )
    hits = np.flatnonzero(np.isfinite(distance))
    points = at.translation + distance[hits, None] * rays[hits]
    # Which triangle: that of the same normal whose plane is nearest.
    height = np.einsum("mi,nmi->nm", scene.normals, points[:, None] - scene.corners[:, 0])
    other = scene.normals @ normals[hits].T < 1.0 - 1e-9
    triangle = np.argmin(np.abs(height) + 10.0 * other.T, axis=1)
    radiance = np.tile(np.asarray(world.background), (len(rays), 1))
    radiance[hits], is_certain = reference_radiance(scene, world, triangle, points)
    certain = np.ones(len(rays), dtype=bool)
    certain[hits] = is_certain
    greys = np.rint(255.0 * srgb_from_linear(radiance)).astype(np.uint8)
    shape = (CAMERA.height_px, CAMERA.width_px)
    return greys.reshape(*shape, 3), certain.reshape(shape)


LIGHTS: dict[str, tuple[Light, ...]] = {
    "directional": (DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
    "point": (DIM_HEMISPHERE_LIGHT, POINT_LIGHT),
    "two directional and two point": (
        DIM_HEMISPHERE_LIGHT,
        DIRECTIONAL_LIGHT,
        POINT_LIGHT,
        DirectionalLight((0.0, -0.6, 0.8), (0.1, 0.2, 0.3)),
        PointLight((0.9, -0.5, -0.8), (0.1, 0.3, 0.1)),
    ),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_shadows_when_boxes_stand_on_a_floor_are_those_of_the_reference(
    make_renderer: RendererFactory, name: str
) -> None:
    world = dataclasses.replace(BOXES, lights=LIGHTS[name])
    image = render(make_renderer, world, camera_ray_hits(ABOVE))
    expected, certain = reference_image(world, ABOVE)
    without = render(
        make_renderer, world, dataclasses.replace(camera_ray_hits(ABOVE), has_shadows=False)
    )
    changed = level_differences(expected, without) > 5
    assert 300 < changed.sum() < 0.5 * changed.size
    # A pixel is 16 mm of the floor, texels are 3 mm: smooth pixels are two texels from an edge.
    smooth = mask_away_from_edges(expected, contrast=4) & certain
    assert smooth.mean() > 0.7
    assert level_differences(image, expected)[smooth].max() <= 1


@pytest.mark.parametrize("elevation_deg", [0.5, 3.0, 20.0, 90.0])
@pytest.mark.parametrize("bearing_deg", [0.0, 31.0])
def test_floor_when_the_directional_light_is_low_has_no_wrong_pixel(
    make_renderer: RendererFactory, elevation_deg: float, bearing_deg: float
) -> None:
    e, b = math.radians(elevation_deg), math.radians(bearing_deg)
    low = (math.cos(e) * math.cos(b), math.cos(e) * math.sin(b), math.sin(e))
    world = make_world(
        floor_item(6.0), lights=(DIM_HEMISPHERE_LIGHT, DirectionalLight(low, (1.0 / low[2],) * 3))
    )
    camera_state = camera_ray_hits(ABOVE)
    without = render(make_renderer, world, dataclasses.replace(camera_state, has_shadows=False))
    assert level_differences(render(make_renderer, world, camera_state), without).max() <= 1


@pytest.mark.parametrize("height_m", [0.01, 0.3, 2.0])
def test_walls_when_a_point_light_is_near_the_floor_have_no_wrong_pixel(
    make_renderer: RendererFactory, height_m: float
) -> None:
    world = make_inward_facing_room(PointLight((0.2, 0.3, -height_m), (0.5, 0.5, 0.5)))
    for turn in ((0.0, -0.5 * math.pi, 0.0), (0.0, 0.2, 0.4), (0.0, 0.2, 2.5)):
        camera_state = camera_ray_hits(Pose.from_rpy((0.05, 0.03, -1.5), turn))
        without = render(make_renderer, world, dataclasses.replace(camera_state, has_shadows=False))
        wrong = level_differences(render(make_renderer, world, camera_state), without) > 1
        # Raster: a texel at the line where two walls meet may show the other wall.
        assert wrong.mean() < 1e-3


def test_shadow_when_a_box_stands_on_the_floor_begins_at_the_box(
    make_renderer: RendererFactory,
) -> None:
    world = make_world(floor_item(), box_item(0.0, 0.0, -0.2, (0.4, 0.4, 0.4)))
    image = render(make_renderer, world, camera_ray_hits(ABOVE))
    expected, certain = reference_image(world, ABOVE)
    wrong = (level_differences(image, expected) > 5) & certain
    # An outline is one pixel wide at most: a leak beside the box would be a line of its own.
    assert wrong.sum() < 40


def test_object_in_the_light_casts_the_shadow_of_the_same_mesh_in_the_scene(
    make_renderer: RendererFactory,
) -> None:
    box, place = Box((0.3, 0.2, 0.3)), Pose.from_rpy((0.3, 0.1, -0.15), (0.0, 0.0, 0.4))
    for lights in LIGHTS.values():
        fixed = make_world(floor_item(), box_item(0.3, 0.1, -0.15, (0.3, 0.2, 0.3)), lights=lights)
        dynamic_object = DynamicObject(build_object_mesh([(primitives.box(box), GREY)]), place)
        moving = render(
            make_renderer,
            make_world(floor_item(), lights=lights),
            camera_ray_hits(ABOVE, dynamic_object),
        )
        difference = level_differences(moving, render(make_renderer, fixed, camera_ray_hits(ABOVE)))
        assert (difference > 1).mean() < 0.006
        assert (difference[mask_away_from_edges(moving)] > 1).mean() < 1e-3


def test_object_in_the_shadow_of_the_scene_is_dark(make_renderer: RendererFactory) -> None:
    roof = box_item(0.0, 0.0, -0.9, (1.2, 1.2, 0.02))
    world = make_world(
        floor_item(),
        roof,
        lights=(DIM_HEMISPHERE_LIGHT, DirectionalLight((0.0, 0.0, 1.0), (0.5,) * 3)),
    )
    dynamic_object = DynamicObject(
        build_object_mesh([(primitives.box(Box((0.2, 0.2, 0.2))), GREY)]), Pose.from_rpy((0, 0, 0))
    )
    at = Pose.from_rpy((0.0, 0.0, -0.6), (0.0, -0.5 * math.pi, 0.0))
    dark, bright = (
        render(make_renderer, world, e)
        for e in (camera_ray_hits(at, dynamic_object), CameraState(at, (dynamic_object,)))
    )
    centre = (CAMERA.height_px // 2, CAMERA.width_px // 2)
    assert dark[centre].tolist() == [108] * 3, "0.5 * 0.3 of the sky, encoded"
    assert bright[centre].tolist() == [170] * 3


def test_item_when_it_lets_light_through_casts_no_shadow(make_renderer: RendererFactory) -> None:
    glass = dataclasses.replace(box_item(0.3, 0.1, -0.4, (0.3, 0.2, 0.1)), casts_shadows=False)
    world = make_world(floor_item(), glass)
    without = render(make_renderer, world, CameraState(ABOVE))
    assert (
        level_differences(render(make_renderer, world, camera_ray_hits(ABOVE)), without).max() <= 1
    )


@pytest.mark.parametrize("has_bodies", [False, True])
@pytest.mark.parametrize(
    "lights", [(HEMISPHERE_LIGHT, ROOM_SUN), (HEMISPHERE_LIGHT, ROOM_SUN, ROOM_LAMP)]
)
def test_raster_of_shadows_in_a_mirror_equals_trace(
    device: GlDevice, lights: tuple[Light, ...], has_bodies: bool
) -> None:
    world, camera = make_test_world(lights=lights), make_omni_camera(width_px=300)
    scene = build_scene(world)
    objects = TWO_ROBOTS if has_bodies else ()
    camera_state = dataclasses.replace(CAMERA_STATE, has_shadows=True, objects=objects)
    plan = make_plan(camera, face_size_px=640)
    trace = TraceRenderer(scene, world, threads=2)
    views = [r.prepare(camera, plan) for r in (RasterRenderer(scene, world, device=device), trace)]
    raster_image, trace_image = (view.render(camera_state).rgb for view in views)
    without = views[1].render(dataclasses.replace(camera_state, has_shadows=False)).rgb
    views[0].close()
    trace.close()
    assert (level_differences(trace_image, without) > 5).mean() > 0.01
    difference, smooth = (
        level_differences(raster_image, trace_image),
        mask_away_from_edges(trace_image),
    )
    levels = 3 if ROOM_LAMP in lights else 2
    assert (difference[smooth] > levels).mean() < 1e-3
    assert (difference > levels).mean() < 0.05


def test_frames_when_shadows_come_and_go_are_the_same_bytes_as_ever(
    make_renderer: RendererFactory,
) -> None:
    view = make_renderer(BOXES).prepare(make_omni_camera(), make_plan(make_omni_camera()))
    plain = CameraState(Pose.from_rpy((0.05, 0.03, -1.0)))
    before = view.render(plain).rgb
    shadowed = view.render(dataclasses.replace(plain, has_shadows=True)).rgb
    assert level_differences(before, shadowed).max() > 5
    np.testing.assert_array_equal(view.render(plain).rgb, before)
    view.close()
