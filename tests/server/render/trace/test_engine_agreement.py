"""The kernel's images against the reference's: within one grey level away from edges.

Compared are the pixels whose samples all meet one object and planes within 5 degrees: at an edge a
ray in float32 may pass on either side, and a shadow's outline likewise. Elsewhere nothing but the
rounding of float32 may differ, and the kernel's proof that one surface fills a tile.
"""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.world_file import read_world
from catoptra_server.render.renderer import LinearImage
from catoptra_server.render.trace.ray_table import (
    BLOCK_RAYS,
    RayTable,
    lens_ray_table,
    omni_ray_table,
)
from catoptra_server.render.trace.trace_engine import (
    NOTHING,
    STATIC_SCENE,
    MovingExposure,
    RayHits,
    TracedExposure,
    TracedRays,
    assemble_grid,
    camera_states,
)
from catoptra_server.simulation.robot_bodies import OmniCameraTower, build_ego_body_mesh
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.world.objects import CameraState, DynamicObject, FogMedium
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World
from helpers.dynamic_objects import P2AT, SMOOTH_ROBOTS, TWO_ROBOTS
from helpers.long_cases import quick_cases
from helpers.standing_things import bake_scene, bend_scene, blend_scene, pierce_scene
from helpers.trace_engines import open_engine
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_fine_floor,
    make_omni_camera,
    make_plan,
    make_test_world,
    write_fine_texture,
    write_smooth_texture,
)

CAMERA = make_omni_camera(width_px=160)
MAX_ANGLE_RAD = math.radians(5.0)
# Float32 in the kernel: coordinates of the corridor's textures move the light by 2e-5 (measured).
MAX_LINEAR_DIFFERENCE = 1e-4
MAX_RANGE_RATIO = 1e-5
# A pixel or two of 15 000 on the outlines of shadows; none was measured, but float32 may turn one.
MAX_OUTLINES = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """The same rays in both engines, their scene and their exposure."""

    table: RayTable
    scene: SceneMesh
    exposure: TracedExposure
    kernel: TracedRays
    reference: TracedRays


def check_agreement(
    world: World,
    table: RayTable,
    exposure: TracedExposure = CAMERA_STATE,
    *,
    max_outlines: float = 0.0,
    min_certain: float = 0.5,
    scene: SceneMesh | None = None,
) -> None:
    """Compare ranges, sRGB and linear images of both engines.

    Args:
        world: World to trace.
        table: Rays to trace.
        exposure: Poses, objects and shadows.
        max_outlines: Fraction of the certain pixels that may differ, on the outlines of shadows.
        min_certain: Fraction of the mirror's pixels that must be certain.
        scene: Scene of the world; None: built of it.
    """
    scene = build_scene(world) if scene is None else scene
    with ExitStack() as stack:
        kernel, reference = (
            stack.enter_context(open_engine(name, world, scene=scene)).prepare(table)
            for name in ("kernel", "reference")
        )
        pair = Pair(table, scene, exposure, kernel, reference)
        hits = kernel.find_hits(exposure), reference.find_hits(exposure)
        check_ranges(*hits)
        on_mirror, certain = classify_pixels(pair, *hits)
        assert certain[on_mirror].mean() > min_certain
        greys = (each.render_srgb(exposure).astype(np.float32) for each in (kernel, reference))
        assert mean_over(1.0, *greys, certain) <= max_outlines
        light = (each.render_linear(exposure) for each in (kernel, reference))
        assert mean_over(MAX_LINEAR_DIFFERENCE, *light, certain) <= max_outlines


def mean_over(limit: float, one: LinearImage, other: LinearImage, certain: Bools) -> float:
    """Fraction of the certain pixels with a channel that differs by more than a limit."""
    return float((np.abs(one - other).max(axis=-1) > limit)[certain].mean())


def check_ranges(kernel: RayHits, reference: RayHits) -> None:
    """Compare the distances of rays that meet the same triangle of the same object."""
    same = (kernel.object == reference.object) & (kernel.triangle == reference.triangle)
    assert same.mean() > 0.98
    met = same & (reference.object != NOTHING)
    np.testing.assert_allclose(kernel.range_m[met], reference.range_m[met], rtol=MAX_RANGE_RATIO)
    assert np.isinf(kernel.range_m[same & (reference.object == NOTHING)]).all()


def classify_pixels(pair: Pair, kernel: RayHits, reference: RayHits) -> tuple[Bools, Bools]:
    """(h, w) pixels wholly on the mirror, and those of them that meet one object and plane."""
    bits = (pair.table.valid[..., None] >> np.arange(BLOCK_RAYS)) & 1
    numbers = np.stack((bits, reference.object, kernel.object), axis=-1)
    normals = (world_normals(pair, hits) for hits in (reference, kernel))
    values = np.concatenate((numbers, *normals), axis=-1)
    grid = assemble_grid(pair.table, values.astype(np.float32), fill=np.float32(0.0))
    height, width, samples = pair.table.height_px, pair.table.width_px, pair.table.samples
    split = grid.reshape(height, samples, width, samples, 9).swapaxes(1, 2)
    rays = split.reshape(height, width, samples**2, 9)
    first = rays[:, :, :1]
    on_mirror: Bools = (rays[..., 0] == 1.0).all(axis=-1)
    one_object = (rays[..., 1:3] == first[..., 1:2]).all(axis=(-2, -1))
    cosines = (rays[..., 3:].reshape(height, width, -1, 3) * first[..., 3:6]).sum(axis=-1)
    one_plane = (cosines.min(axis=-1) > math.cos(MAX_ANGLE_RAD)) | (first[..., 0, 1] == NOTHING)
    return on_mirror, on_mirror & one_object & one_plane


def world_normals(pair: Pair, hits: RayHits) -> Floats:
    """(t, samples^2, 16, 3) normals of the planes that rays meet, zero without a hit."""
    normals = np.zeros((*hits.object.shape, 3))
    on_scene = hits.object == STATIC_SCENE
    normals[on_scene] = pair.scene.normals[hits.triangle[on_scene]]
    for number, placed in enumerate(camera_states(pair.exposure)[0].objects, start=1):
        turned = placed.world_from_object.rotate_directions(placed.mesh.normals)
        normals[hits.object == number] = turned[hits.triangle[hits.object == number]]
    return normals


LIGHTS = {
    "hemisphere": (HEMISPHERE_LIGHT,),
    "directional": (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
    "point": (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
}
WITH_ROBOTS = replace(CAMERA_STATE, objects=TWO_ROBOTS)


@pytest.mark.parametrize("has_texture", [False, True], ids=["plain", "textured"])
@pytest.mark.parametrize("lights", LIGHTS)
@pytest.mark.parametrize("samples", [1, 2, 4])
def test_images_of_a_room_agree(
    tmp_path: Path, samples: int, lights: str, has_texture: bool
) -> None:
    texture = write_smooth_texture(tmp_path / "waves.png") if has_texture else None
    world = make_test_world(lights=LIGHTS[lights], texture=texture)
    check_agreement(world, omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples)))


@pytest.mark.parametrize("lights", LIGHTS)
@pytest.mark.parametrize("samples", [1, 2, 4])
def test_images_of_a_fine_texture_at_grazing_angles_agree(
    tmp_path: Path, samples: int, lights: str
) -> None:
    world = make_fine_floor(write_fine_texture(tmp_path / "checkers.png"))
    world = replace(world, lights=LIGHTS[lights])
    check_agreement(world, omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples)))


@pytest.mark.parametrize("samples", quick_cases([1, 2, 4], 0, 1))
@pytest.mark.parametrize("name", ["four_legged_2006", "corridor"])
def test_images_of_a_bundled_world_agree_on_nine_tenths_of_the_pixels(
    name: str, samples: int
) -> None:
    world, _ = read_world(find_configuration("worlds", name))
    camera = make_omni_camera(width_px=240)
    exposure = CameraState(Pose.from_rpy((0.5, 0.1, -0.6), (0.0, 0.0, 0.3)))
    table = omni_ray_table(camera, make_plan(camera, samples=samples))
    check_agreement(world, table, exposure, min_certain=0.9)


@pytest.mark.parametrize("lights", ["directional", "point"])
@pytest.mark.parametrize("samples", [1, 2])
def test_images_with_shadows_agree(samples: int, lights: str) -> None:
    world = make_test_world(lights=LIGHTS[lights])
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples))
    exposure = replace(WITH_ROBOTS, has_shadows=True)
    check_agreement(world, table, exposure, max_outlines=MAX_OUTLINES)


@pytest.mark.parametrize("lights", ["directional", "point"])
@pytest.mark.parametrize("samples", [1, 2, 4])
def test_images_of_robots_agree(samples: int, lights: str) -> None:
    world = make_test_world(lights=LIGHTS[lights])
    check_agreement(world, omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples)), WITH_ROBOTS)


def test_images_of_the_ego_body_agree() -> None:
    mirror = Pose.from_rpy((0.0, 0.0, -0.4543), (0.1, 0.0, 0.0))
    mesh = build_ego_body_mesh(P2AT, OmniCameraTower(CAMERA, mirror))
    base = Pose.from_rpy((0.4, -0.1, -0.1457), (0.0, 0.0, 0.7))
    exposure = CameraState(base @ mirror, (DynamicObject(mesh, base),))
    check_agreement(make_test_world(), omni_ray_table(CAMERA, make_plan(CAMERA)), exposure)


def test_images_by_a_mirror_mesh_agree() -> None:
    plan = make_plan(CAMERA, tessellation_from_polygon_count(32), samples=2)
    check_agreement(make_test_world(), omni_ray_table(CAMERA, plan), WITH_ROBOTS)


@pytest.mark.parametrize("samples", [1, 2])
def test_images_of_a_perspective_camera_agree(samples: int) -> None:
    table = lens_ray_table(PerspectiveCamera(161, 90, 1.2), samples)
    check_agreement(make_test_world(lights=LIGHTS["point"]), table, WITH_ROBOTS)


@pytest.mark.parametrize("has_shadows", [False, True], ids=["lit", "shadowed"])
@pytest.mark.parametrize("samples", [1, 2])
def test_images_of_rays_with_origins_and_times_agree(samples: int, has_shadows: bool) -> None:
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples))
    # Origins as of a mirror without a viewpoint, within 5 cm; times by rows, as of a shutter.
    origins = np.ascontiguousarray(0.05 * table.directions[:, :, ::-1])
    rows = np.linspace(0.0, 1.0, len(table.tiles), dtype=np.float32)
    times = np.tile(rows[:, None, None], (1, samples**2, BLOCK_RAYS))
    table = replace(table, origins=origins, times=times)
    step = Pose.from_rpy((0.1, 0.05, 0.0), (0.0, 0.0, 0.15))
    start = replace(WITH_ROBOTS, has_shadows=has_shadows)
    end = replace(
        start,
        world_from_mirror=start.world_from_mirror @ step,
        objects=tuple(
            replace(placed, world_from_object=placed.world_from_object @ step)
            for placed in TWO_ROBOTS
        ),
    )
    exposure = MovingExposure((start, end))
    check_agreement(
        make_test_world(lights=LIGHTS["point"]),
        table,
        exposure,
        max_outlines=MAX_OUTLINES if has_shadows else 0.0,
    )


@pytest.mark.parametrize("has_shadows", [False, True])
@pytest.mark.parametrize("is_baked", [False, True])
def test_bent_and_shining_surfaces_agree(tmp_path: Path, has_shadows: bool, is_baked: bool) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    scene = bend_scene(bake_scene(world) if is_baked else build_scene(world))
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=2))
    exposure = replace(CAMERA_STATE, has_shadows=has_shadows, objects=SMOOTH_ROBOTS)
    outlines = MAX_OUTLINES if has_shadows else 0.0
    check_agreement(world, table, exposure, scene=scene, max_outlines=outlines)


@pytest.mark.parametrize("has_shadows", [False, True])
@pytest.mark.parametrize("samples", [1, 2])
def test_holes_and_backs_that_are_none_agree(
    tmp_path: Path, has_shadows: bool, samples: int
) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    scene = pierce_scene(build_scene(world))
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples))
    exposure = replace(CAMERA_STATE, has_shadows=has_shadows)
    # The edges of holes are outlines, too.
    check_agreement(world, table, exposure, scene=scene, max_outlines=5e-3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("has_shadows", [False, True])
def test_blended_surfaces_agree(tmp_path: Path, has_shadows: bool, seed: int) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    scene = blend_scene(build_scene(world), seed=seed)
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=1 + seed % 2))
    fog = FogMedium(0.1, (0.3, 0.4, 0.5)) if seed > 1 else None
    exposure = replace(CAMERA_STATE, has_shadows=has_shadows, fog=fog, objects=TWO_ROBOTS)
    # The edges of what is seen through others are outlines, too.
    check_agreement(world, table, exposure, scene=scene, max_outlines=0.01)
