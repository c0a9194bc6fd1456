"""Baked light against furnaces, rays of its own and itself on other processors."""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import EffectSettings, Threshold, name_effect
from catoptra_server.effects.bounds.light_loss import ObjectRadiances
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision, plan_effects
from catoptra_server.effects.kernels.grey_levels import measure_change
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel.library import available_instruction_sets
from catoptra_server.render.trace.occlusion import light_bake
from catoptra_server.render.trace.occlusion.light_bake import (
    MAX_PASSES,
    RAYS_PER_PASS,
    LightBake,
    bake_light,
)
from catoptra_server.render.trace.occlusion.occlusion_cache import (
    NodeLight,
    add_lights,
    light_scene,
)
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import TraceRequest
from catoptra_server.world.objects import CameraState, Shutter
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shading import box_form_factors, facet_irradiance
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    RectangleLight,
    SphereBand,
    SurfaceGloss,
    World,
    srgb_from_linear,
)
from helpers.dynamic_objects import SMOOTH_ROBOTS, TWO_ROBOTS
from helpers.image_comparison import level_differences
from helpers.motion_reference import average_frames, driving_camera_state
from helpers.opengl import device_or_skip
from helpers.trace_engines import ENGINES, open_engine
from helpers.trace_kernels import make_omni_table, open_kernel, render_filled_and_traced
from helpers.worlds import (
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    make_omni_camera,
    make_plan,
    make_smooth_sky,
    make_test_world,
    under_sky,
)

GREY = Material((0.5, 0.5, 0.5))
CAMERA = make_omni_camera(width_px=96)


def make_items(*placed: tuple[object, tuple[float, float, float]]) -> tuple[Item, ...]:
    return tuple(
        Item(f"item {number}", shape, Pose.from_rpy(place), GREY)  # type: ignore[arg-type]
        for number, (shape, place) in enumerate(placed)
    )


SIX_WALLS = make_items(
    *((Box((4.4, 4.4, 0.2)), (0.0, 0.0, z)) for z in (-3.1, 0.1)),
    *((Box((0.2, 4.4, 3.0)), (x, 0.0, -1.5)) for x in (-2.1, 2.1)),
    *((Box((4.0, 0.2, 3.0)), (0.0, y, -1.5)) for y in (-2.1, 2.1)),
)
ROOMS = {
    "walls": SIX_WALLS,
    "furnished": SIX_WALLS
    + make_items(
        (Box((0.6, 0.4, 0.5)), (0.8, 0.3, -0.25)),
        (Cylinder(0.3, 1.0, sectors=16), (-1.0, -0.8, -0.6)),
    ),
    "sphere": make_items((SphereBand(2.0, 0.0, np.pi, sectors=24, rings=12), (0.0, 0.0, -1.5))),
}


@pytest.mark.parametrize("room", ROOMS)
def test_furnace_has_one_light_everywhere(room: str) -> None:
    # Of every wall 0.25 of its own, and half of what reaches it: 0.25 / (1 - 0.5).
    world = World(room, ROOMS[room])
    scene = build_scene(world)
    scene = replace(scene, emission=np.full((len(scene), 3), 0.25))
    light = bake_light(scene, world, 2, threads=1)
    rays = np.random.default_rng(1).normal(size=(2000, 3))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    origins = np.tile([0.1, -0.2, -1.6], (len(rays), 1))
    distances, triangles = commit_ray_caster(scene).closest_triangles(origins, rays)
    factors = light.occlusion.factors(triangles, origins + distances[:, None] * rays)
    np.testing.assert_allclose(light.brightest * factors, 0.5, rtol=1e-5)
    places = np.random.default_rng(2).uniform((-1.0, -1.0, -2.5), (1.0, 1.0, -0.6), (200, 3))
    faces = np.array([light.probes.find_light(place).faces for place in places])
    np.testing.assert_allclose(faces, 0.5, rtol=1e-5)


def make_lamp_world() -> World:
    lamp = RectangleLight((0.5, 0.0, -2.9), (0.0, 0.0, 1.0), (0.6, 0.4), (3.0, 2.0, 1.0))
    sky = HemisphereLight((0.4, 0.5, 0.6), (0.1, 0.1, 0.1))
    return World("lamp", ROOMS["furnished"][1:], lights=(sky,), area_lights=(lamp,))


def test_bytes_depend_on_neither_threads_nor_processor() -> None:
    world = make_lamp_world()
    scene = build_scene(world)
    digests = set()
    for threads in (1, 2, 3, 4):
        for name in available_instruction_sets():
            light = bake_light(scene, world, 2, threads=threads, instruction_set=name)
            arrays = (light.occlusion.texels, light.brightest, light.error, light.probes.faces)
            digests.add(hashlib.sha256(b"".join(one.tobytes() for one in arrays)).hexdigest())
    assert len(digests) == 1


def test_probes_have_the_light_of_own_rays_and_no_solid_darkens_them() -> None:
    world = make_lamp_world()
    scene = build_scene(world)
    light = bake_light(scene, world, MAX_PASSES, threads=2)
    # The nodes in a floor of 0.2 m have the light of those above.
    walls = replace(world, items=SIX_WALLS[1:2], area_lights=())
    open_sky = bake_light(build_scene(walls), walls, MAX_PASSES, threads=2)
    exact = bake_light(scene, world, 4096 // RAYS_PER_PASS, threads=2)
    faces, truth = light.probes.faces, exact.probes.faces
    # Rays of 256 differ by up to a twentieth of the brightest.
    assert np.percentile(np.abs(faces - truth), 99.0) < 0.04
    assert faces.min() > 0.0
    sky = open_sky.probes.find_light(np.zeros(3))
    np.testing.assert_allclose(sky.up_irradiance, (0.4, 0.5, 0.6), atol=0.02)


def test_surface_whose_nodes_are_all_inside_posts_has_the_light_about_it() -> None:
    # A board between posts that hold its edges, in a room lit from all sides.
    posts = ((Box((0.2, 0.2, 1.4)), (x, 0.0, -1.0)) for x in (-0.5, 0.5))
    world = World("board", make_items((Box((1.0, 0.1, 1.2)), (0.0, 0.0, -1.0)), *posts))
    sky = HemisphereLight((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
    scene = build_scene(replace(world, lights=(sky,)))
    light = bake_light(scene, replace(world, lights=(sky,)), 2, threads=2, detail=0.0015)
    board = np.flatnonzero(np.abs(scene.corners[:, :, 0]).max(axis=1) <= 0.5)
    sides = board[np.abs(scene.normals[board, 1]) > 0.9]
    left, top, right, bottom = light.occlusion.bounds[light.occlusion.patch_of[sides]].T
    assert (right - left).max() == (bottom - top).max() == 1
    seen = [light.light[y : y + 2, x : x + 2] for x, y in zip(left, top, strict=True)]
    assert 0.2 < np.min(seen) < np.max(seen) < 0.6


def test_light_between_six_directions_is_exact_for_hemisphere_lights() -> None:
    sky = HemisphereLight((0.4, 0.5, 0.6), (0.1, 0.2, 0.3))
    normals = np.random.default_rng(3).normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    faces = tuple(map(tuple, sky.faces.tolist()))
    cube = replace(sky, sides=faces[:4])
    expected = facet_irradiance((sky,), normals)
    np.testing.assert_allclose(facet_irradiance((cube,), normals), expected, rtol=1e-12)


def test_robots_have_the_light_of_their_places_in_all_renderers() -> None:
    lamp = RectangleLight((-1.5, 0.0, -2.9), (0.0, 0.0, 1.0), (0.6, 0.4), (9.0, 6.0, 3.0))
    sky = HemisphereLight((0.04, 0.05, 0.06), (0.01, 0.01, 0.01))
    world = World("lamp", SIX_WALLS[1:], lights=(sky,), area_lights=(lamp,))
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 4, threads=2).apply(scene, world)
    for robots in (TWO_ROBOTS, SMOOTH_ROBOTS):
        state = CameraState(Pose.from_rpy((0.1, -0.3, -0.7), (0.02, -0.03, 0.3)), robots)
        bare = replace(world, probes=None)
        pictures = {}
        for name in ENGINES:
            with open_engine(name, world, scene=scene) as engine:
                pictures[name] = engine.prepare(make_omni_table(width_px=96)).render_srgb(state)
        with open_kernel(bare, scene=scene) as engine:
            other = engine.prepare(make_omni_table(width_px=96)).render_srgb(state)
        one, two = pictures.values()
        assert np.percentile(level_differences(one, two), 99.5) <= 1
        assert level_differences(other, one).max() > 20
        radiances = ObjectRadiances(world)
        assert 0.1 < radiances.max_radiance(robots) < ObjectRadiances(bare).max_radiance(robots)


def test_box_hides_what_rays_of_the_cosine_meet() -> None:
    half = np.array([0.3, 0.25, 0.15])
    generator = np.random.default_rng(4)
    tilt, turn = generator.uniform(size=(2, 20000))
    tilt, turn = np.sqrt(tilt), 2.0 * np.pi * turn
    rays = np.stack((tilt * np.cos(turn), tilt * np.sin(turn), np.sqrt(1.0 - tilt**2)), axis=-1)
    points = generator.uniform(-0.9, 0.9, (40, 3))
    normals = generator.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    factors = box_form_factors(points, normals, half)
    for point, normal, factor in zip(points, normals, factors, strict=True):
        side = np.cross(normal, np.roll(normal, 1) + 0.1)
        side /= np.linalg.norm(side)
        along = rays @ np.stack((side, np.cross(normal, side), normal))
        ends = np.sort((np.stack((-half, half))[:, None] - point) / along, axis=0)
        is_met = (ends[0].max(axis=-1) < ends[1].min(axis=-1)) & (ends[1].min(axis=-1) > 0.0)
        expected = 0.0 if (np.abs(point) < half).all() else is_met.mean()
        assert factor == pytest.approx(expected, abs=0.015)


def test_robots_shade_the_floor_in_both_engines_and_filled_tiles() -> None:
    world = World("open", SIX_WALLS[1:2], lights=(HEMISPHERE_LIGHT,))
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 2, threads=2).apply(scene, world)
    state = CameraState(Pose.from_rpy((0.1, -0.3, -1.3), (0.02, -0.03, 0.3)), TWO_ROBOTS)
    alone = replace(state, objects=())
    pictures = {}
    for name in ENGINES:
        with open_engine(name, world, scene=scene) as engine:
            rays = engine.prepare(make_omni_table(width_px=96))
            pictures[name] = rays.render_linear(state), rays.render_linear(alone)
    (one, bare), (other, _) = pictures.values()
    assert np.percentile(level_differences(*map(encode_linear, (one, other))), 99.5) <= 1
    is_floor = np.abs(one - bare).max(axis=-1) > 0.0
    ratio = (one / np.where(bare > 0.0, bare, 1.0))[..., 1]
    # The nearest floor lacks a third, and nothing is lit brighter.
    assert ((ratio > 0.5) & (ratio < 0.85) & is_floor).sum() > 20
    with open_kernel(world, scene=scene) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=2))
        filled, traced, share = render_filled_and_traced(engine, rays, state)
        threshold = {"BakedLight": Threshold(1.0)}
        frame = rays.render(state, TraceRequest(is_linear=True, thresholds=threshold))
        plain = rays.render_linear(replace(state, has_baked_light=False))
    digests = set()
    for threads, name in itertools.product((1, 3), available_instruction_sets()):
        with open_kernel(world, scene=scene, threads=threads, instruction_set=name) as engine:
            digests.add(engine.prepare(make_omni_table(width_px=96)).render_linear(state).tobytes())
    assert len(digests) == 1
    assert share > 0.2
    assert level_differences(filled, traced).max() <= 2
    change = measure_change(frame.image, plain)
    stated = frame.changes["BakedLight"]
    assert change.largest <= stated.largest < 255.0
    (bound,) = (one.bound for one in decide(scene, world, state) if one.effect == "BakedLight")
    assert stated.largest <= bound


def test_robot_shades_a_floor_of_facets_at_every_instant() -> None:
    bright = Material((0.9, 0.9, 0.9))
    lines = tuple(
        Item(f"line {i}", Rectangle((4.0, 0.05)), Pose.from_rpy((0.0, 0.15 * i, -1e-3)), bright)
        for i in range(-8, 9)
    )
    world = World("lines", SIX_WALLS[1:2] + lines, lights=(HEMISPHERE_LIGHT,))
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 2, threads=2).apply(scene, world)
    start = Pose.from_rpy((0.1, 0.05, -0.1457))
    above = start @ Pose.from_rpy((0.0, 0.0, -0.6))
    state = driving_camera_state(above, 0.5, 30.0)
    robot = replace(TWO_ROBOTS[0], world_from_object=start, twist=state.twist)
    state = replace(state, objects=(robot,))
    exposed = replace(state, shutter=Shutter(1.0 / 30.0, 0.0, 64.0))
    request = TraceRequest(is_linear=True, thresholds={"MotionBlur": Threshold(0.5)})
    with open_kernel(world, scene=scene) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=2))
        blurred = rays.render(exposed, request).image
        mean = average_frames(rays, state, 1.0 / 30.0, 32)
    differences = level_differences(*map(encode_linear, (blurred, mean)))
    assert np.percentile(differences, 99.5) <= 2
    assert np.percentile(differences, 99.9) <= 4


def encode_linear(light: Floats) -> Floats:
    return np.round(255.0 * srgb_from_linear(np.clip(light, 0.0, 1.0)))


def find_nodes(light: NodeLight) -> Bools:
    is_node = np.zeros(light.error.shape[:2], dtype=bool)
    for left, top, right, bottom in light.occlusion.bounds.tolist():
        is_node[top : bottom + 1, left : right + 1] = True
    return is_node


def test_errors_that_are_stated_cover_those_against_4096_rays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(light_bake, "MAX_NODES", 8000)
    world = make_lamp_world()
    scene = build_scene(world)
    light = bake_light(scene, world, MAX_PASSES, threads=2)
    exact = bake_light(scene, world, 4096 // RAYS_PER_PASS, threads=2)
    is_node = find_nodes(light)
    values, truth = (
        (one.brightest * np.moveaxis(one.occlusion.texels, 0, -1) / 65535)[is_node]
        for one in (light, exact)
    )
    difference = np.abs(values - truth)
    assert (difference <= light.error[is_node] + exact.error[is_node]).mean() > 0.99
    levels = 255.0 * np.abs(srgb_from_linear(0.5 * values) - srgb_from_linear(0.5 * truth))
    assert np.median(levels) < 1.0
    assert np.percentile(levels, 99.0) < 6.0


def test_both_engines_draw_baked_light_on_surfaces_and_objects() -> None:
    lamp = RectangleLight((0.4, 0.3, -1.8), (0.0, 0.0, 1.0), (0.5, 0.3), (2.0, 1.0, 0.5))
    world = replace(
        make_test_world(lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)),
        area_lights=(lamp,),
    )
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 2, threads=1).apply(scene, world)
    exposure = CameraState(
        Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3)), TWO_ROBOTS, has_shadows=True
    )
    table = make_omni_table(width_px=96, samples=2)
    pictures = []
    for name in ENGINES:
        with open_engine(name, world, scene=scene) as engine:
            pictures.append(engine.prepare(table).render_srgb(exposure))
    differences = level_differences(*pictures)
    # Edges round to other surfaces; a pixel's centre in place of its samples' mean.
    assert np.percentile(differences, 99.5) <= 1
    with open_kernel(world, scene=scene) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=2))
        filled, traced, share = render_filled_and_traced(engine, rays, exposure)
    assert share > 0.2
    assert level_differences(filled, traced).max() <= 2


def test_labels_ranges_and_flow_are_the_same_to_the_bit_in_any_light() -> None:
    lamp = RectangleLight((0.4, 0.3, -1.8), (0.0, 0.0, 1.0), (0.5, 0.3), (2.0, 1.0, 0.5))
    plain = make_test_world(lights=())
    lit = replace(plain, lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT), area_lights=(lamp,))
    lit = under_sky(
        replace(
            lit,
            items=tuple(
                replace(one, material=replace(one.material, gloss=SurfaceGloss(0.1, 0.1)))
                for one in lit.items
            ),
        ),
        make_smooth_sky(),
    )
    baked = bake_light(build_scene(lit), lit, 2, threads=1).apply(build_scene(lit), lit)
    pose = Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3))
    state = CameraState(pose, TWO_ROBOTS)
    moved = replace(state, world_from_mirror=pose @ Pose.from_rpy((0.1, 0.0, 0.0)))
    image = LabelledImage(make_omni_camera(width_px=160), replace(state, has_shadows=True))
    found = []
    for scene, world in ((build_scene(plain), plain), baked):
        renderer = TraceRenderer(scene, world, threads=1)
        labels = LabelRenderer(renderer, scene)
        found.append(labels.render(image, ("range", "normal", "point", "ids", "flow"), moved))
        labels.close()
        renderer.close()
    for name, channel in found[0].channels.items():
        np.testing.assert_array_equal(channel, found[1].channels[name])


def test_filled_tiles_of_textures_have_the_light_of_their_own_pixels(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), "white").save(tmp_path / "white.png")
    world = make_test_world(lights=(HEMISPHERE_LIGHT,), texture=tmp_path / "white.png")
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 2, threads=1).apply(scene, world)
    assert scene.occlusion is not None
    # Light that is much steeper than that of lamps.
    shape = scene.occlusion.texels.shape
    texels = np.random.default_rng(5).integers(45000, 65536, shape, np.uint16)
    scene = replace(scene, occlusion=replace(scene.occlusion, texels=texels))
    with open_kernel(world, scene=scene) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=2))
        filled, traced, share = render_filled_and_traced(
            engine, rays, CameraState(Pose.from_rpy((0.31, 0.17, -0.6)))
        )
    assert share > 0.2
    assert np.percentile(level_differences(filled, traced), 99.9) <= 3


def bake_furnace(world: World) -> tuple[SceneMesh, World]:
    scene = build_scene(world)
    scene = replace(scene, emission=np.full((len(scene), 3), 0.25))
    return bake_light(scene, world, 2, threads=1).apply(scene, world)


def test_light_that_is_the_same_everywhere_is_looked_up_nowhere() -> None:
    lit, lit_world = bake_furnace(World("furnace", ROOMS["sphere"]))
    assert lit.occlusion is not None
    assert lit.occlusion.is_constant.all()
    with open_kernel(lit_world, scene=lit) as engine:
        rays = engine.prepare(make_omni_table(width_px=64))
        exposure = CameraState(Pose.from_rpy((0.1, 0.0, -1.5)))
        light = rays.render_linear(exposure)
        threshold = {"BakedLight": Threshold(1.0)}
        change = rays.render(exposure, TraceRequest(thresholds=threshold)).changes["BakedLight"]
    # Of its own 0.25, and half of 0.5.
    np.testing.assert_allclose(light[light > 0.0], 0.5, rtol=2e-5)
    assert change.largest == 0.0


def bake_lamp_world() -> tuple[SceneMesh, World]:
    world = make_lamp_world()
    return bake_light(build_scene(world), world, 2, threads=1).apply(build_scene(world), world)


def test_surfaces_have_their_mean_light_where_the_effect_is_left_out() -> None:
    scene, world = bake_lamp_world()
    exposure = CameraState(Pose.from_rpy((0.31, 0.17, -0.9), (0.02, -0.03, 0.3)), TWO_ROBOTS)
    plain = replace(exposure, has_baked_light=False)
    table = make_omni_table(width_px=96, samples=2)
    pictures, changes = [], []
    for name in ENGINES:
        with open_engine(name, world, scene=scene) as engine:
            rays = engine.prepare(table)
            pictures.append(rays.render_srgb(plain))
            request = TraceRequest(is_linear=True, thresholds={"BakedLight": Threshold(1.0)})
            frame = rays.render(exposure, request)
            change = measure_change(frame.image, rays.render_linear(plain)).largest
            changes.append((change, frame.changes["BakedLight"].largest))
    # Edges round to other surfaces; a pixel's centre in place of its samples' mean.
    assert np.percentile(level_differences(*pictures), 99.5) <= 1
    (in_pixels, of_grids), (in_own, stated) = sorted(changes, key=lambda one: one[0] == one[1])
    assert in_own == pytest.approx(stated)
    assert 10.0 < in_pixels <= of_grids
    (bound,) = (one.bound for one in decide(scene, world, exposure) if one.effect == "BakedLight")
    assert of_grids <= bound


def light_slabs(brightest: float) -> tuple[SceneMesh, World]:
    """Two white slabs, one above white, the other at half of it; boxes hide where they are dark."""
    placed = (
        (Box((8.0, 4.0, 0.2)), (0.0, -2.0, 0.1)),
        (Box((8.0, 4.0, 0.2)), (0.0, 2.0, 0.1)),
        (Box((3.0, 4.0, 0.5)), (2.5, -2.0, -0.25)),
        (Box((3.8, 4.0, 0.5)), (2.1, 2.0, -0.25)),
    )
    world = World(
        "slabs",
        tuple(replace(one, material=Material((1.0, 1.0, 1.0))) for one in make_items(*placed)),
        lights=(HemisphereLight((1.0,) * 3, (1.0,) * 3),),
    )
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 2, threads=1).apply(scene, world)
    occlusion = scene.occlusion
    assert occlusion is not None
    texels = np.zeros_like(occlusion.texels)
    from_world = np.stack((occlusion.columns_from_world, occlusion.rows_from_world), axis=1)
    for grid, (left, top, right, bottom) in enumerate(occlusion.bounds.tolist()):
        at = np.stack(np.meshgrid(np.arange(left, right + 1), np.arange(top, bottom + 1)), axis=-1)
        to_world = np.linalg.pinv(from_world[grid, :, :3])
        x, y, _ = np.moveaxis((at - from_world[grid, :, 3]) @ to_world.T, -1, 0)
        normal = scene.normals[occlusion.patch_of == grid][0]
        if normal[2] < -0.9 and np.ptp(x) > 5.0:
            dark_from, light = (1.5, 1.0) if y.mean() < 0.0 else (0.8, 0.5 / brightest)
            texels[:, top : bottom + 1, left : right + 1] = np.rint(65535 * light * (x < dark_from))
    lights = (HemisphereLight((brightest,) * 3, (brightest,) * 3),)
    scene = scene.repaint(occlusion=replace(occlusion, texels=texels))
    return scene, replace(world, lights=lights)


@pytest.mark.parametrize("brightest", [1.0, 4.0, 8.0])
@pytest.mark.parametrize("spill", [(0.0, 0.0), (1.0, 0.02)])
def test_no_mean_of_samples_beyond_white_changes_by_more_than_stated(
    brightest: float, spill: tuple[float, float]
) -> None:
    scene, world = light_slabs(brightest)
    state = CameraState(Pose.from_rpy((-1.2, 0.05, -1.1), (0.02, -0.03, 0.3)))
    threshold = Threshold(1.0, spill=spill)
    with open_kernel(world, scene=scene) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=4))
        request = TraceRequest(is_linear=True, thresholds={"BakedLight": threshold})
        frame = rays.render(state, request)
        plain = rays.render_linear(replace(state, has_baked_light=False))
    change = measure_change(frame.image, plain, threshold).largest
    assert 39.0 < change <= frame.changes["BakedLight"].largest


def decide(scene: SceneMesh, world: World, state: CameraState) -> tuple[EffectDecision, ...]:
    settings = name_effect(name_effect(EffectSettings(), "SkyRadiance"), "BakedLight")
    summary = SceneSummarizer(scene, world).summarize(state, CAMERA)
    return plan_effects(settings, summary, CAMERA).decisions


def test_light_is_baked_into_raster_as_into_trace() -> None:
    scene, world = bake_lamp_world()
    pose = Pose.from_rpy((0.31, 0.17, -0.9), (0.02, -0.03, 0.3))
    exposure = CameraState(pose, SMOOTH_ROBOTS)
    device = device_or_skip()
    renderer = RasterRenderer(scene, world, device=device)
    with open_kernel(world, scene=scene) as engine:
        plan = make_plan(CAMERA, samples=4, face_size_px=512, face_samples=4)
        view = renderer.prepare(CAMERA, plan)
        rays = engine.prepare(omni_ray_table(CAMERA, plan))
        for state in (exposure, replace(exposure, has_baked_light=False)):
            difference = level_differences(view.render(state).rgb, rays.render_srgb(state))
            assert np.percentile(difference, 95) <= 2


def test_light_of_nothing_is_replaced_by_surfaces_own_colours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    world = World("dark", SIX_WALLS, light_bake=True)
    lit = light_scene(build_scene(world), world)
    assert lit.scene.occlusion is None
    assert lit.world.lights == (HemisphereLight((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),)
    assert caplog.text.count("nothing shines") == 1


def test_no_rays_are_added_where_errors_are_small() -> None:
    world = World("furnace", ROOMS["walls"])
    scene = build_scene(world)
    for emission, expected in ((0.25, 2), (None, MAX_PASSES)):
        if emission:
            shining = replace(scene, emission=np.full((len(scene), 3), emission))
            bake = LightBake(shining, world, threads=2)
        else:
            bake = LightBake(build_scene(make_lamp_world()), make_lamp_world(), threads=2)
        bake.cast()
        bake.cast()
        light = add_lights(bake.finish(), {})
        assert light_bake.count_passes(light, bake.num_passes) == expected
        bake.close()


def test_picture_is_the_sum_of_groups_with_a_factor_each() -> None:
    lamps = (
        RectangleLight((0.5, 0.0, -2.9), (0.0, 0.0, 1.0), (0.6, 0.4), (3.0, 2.0, 1.0), "one"),
        RectangleLight((-1.0, 1.0, -2.5), (0.0, 0.0, 1.0), (0.3, 0.3), (1.0, 2.0, 3.0), "other"),
    )
    sky = HemisphereLight((0.4, 0.5, 0.6), (0.1, 0.1, 0.1))
    world = World("groups", ROOMS["furnished"][1:], lights=(sky,), area_lights=lamps)
    scene = build_scene(world)
    factors = {"one": 0.25, "other": 2.0}
    bright = [
        replace(lamp, intensity=tuple(factors[lamp.group] * one for one in lamp.intensity))
        for lamp in lamps
    ]
    ungrouped = tuple(replace(lamp, group="") for lamp in bright)
    lights = []
    for area_lights in (lamps, tuple(bright), ungrouped):
        bake = LightBake(scene, replace(world, area_lights=area_lights), threads=2)
        for _ in range(4):
            bake.cast()
        lights.append(add_lights(bake.finish(), factors if area_lights is lamps else {}))
        bake.close()
    mixed, summed, whole = (one.brightest * one.occlusion.planes.T / 65535.0 for one in lights)
    # Each map has its own steps.
    np.testing.assert_allclose(mixed, summed, atol=2e-4)
    # Filters decide by the noise of one group, or of all.
    errors = (lights[0].error + lights[2].error).swapaxes(0, 1)
    is_node = find_nodes(lights[0]).T
    assert (np.abs(mixed - whole) <= errors)[is_node].mean() > 0.999
