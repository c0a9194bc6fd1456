"""Filled cells against an image of which every ray is traced: equal images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.silhouette_edges import SilhouetteEdges
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.robot_shapes import OmniCameraTower, build_ego_body_mesh
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import (
    Box,
    Item,
    Material,
    PointLight,
    Rectangle,
    SphereBand,
    World,
)
from helpers.dynamic_objects import P2AT, TWO_ROBOTS, build_cube_mesh
from helpers.image_comparison import level_differences
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
    write_smooth_texture,
)

CAMERA = make_omni_camera(width_px=240)


def make_clutter(seed: int) -> World:
    """A floor with thin bars, wires, confetti and boxes through each other, unlit."""
    rng = np.random.default_rng(seed)

    def random_item(name: str, shape: Box | Rectangle, reach: float, turns: float) -> Item:
        place = (*rng.uniform(-reach, reach, 2), -rng.uniform(0.0, 1.5))
        pose = Pose.from_rpy(place, tuple(rng.uniform(-turns, turns, 3)))
        red, green, blue = rng.uniform(0.2, 1.0, 3)
        return Item(name, shape, pose, Material((red, green, blue), unlit=True))

    items = [Item("floor", Rectangle((9, 9)), Pose.identity(), Material((0.1, 0.2, 0.1)))]
    items += [random_item(f"bar {i}", Box((0.004, 0.004, 1.5)), 3.0, 0.3) for i in range(40)]
    items += [random_item(f"confetto {i}", Rectangle((0.01, 0.01)), 2.0, 3.0) for i in range(60)]
    items += [random_item(f"box {i}", Box((0.6, 0.4, 0.02)), 3.0, 3.0) for i in range(20)]
    return World("clutter", tuple(items), background=(0.3, 0.3, 0.4))


def random_poses(count: int, seed: int = 3) -> list[Pose]:
    """Poses above the floor, slightly tilted."""
    rng = np.random.default_rng(seed)
    return [
        Pose.from_rpy(
            (*rng.uniform(-1.2, 1.2, 2), -rng.uniform(0.2, 0.9)),
            (*rng.uniform(-0.1, 0.1, 2), rng.uniform(-3.0, 3.0)),
        )
        for _ in range(count)
    ]


def render_images(
    world: World,
    camera_states: list[CameraState],
    *,
    stride_px: int,
    camera: OmniCamera = CAMERA,
    samples: int = 1,
    threads: int = 2,
) -> list[Image]:
    renderer = TraceRenderer(build_scene(world), world, threads=threads)
    plan = replace(make_plan(camera, samples=samples), stride_px=stride_px)
    view = renderer.prepare(camera, plan)
    rendered = [view.render(camera_state).rgb for camera_state in camera_states]
    renderer.close()
    return rendered


def max_difference(world: World, camera_states: list[CameraState], **how: object) -> int:
    """Greatest difference from tracing every ray, in grey levels."""
    stride_px = how.pop("stride_px", 4)
    filled = render_images(world, camera_states, stride_px=stride_px, **how)  # type: ignore[arg-type]
    trace_image = render_images(world, camera_states, stride_px=1, **how)  # type: ignore[arg-type]
    assert max(image.max() for image in trace_image) > 0
    return max(int(level_differences(a, b).max()) for a, b in zip(filled, trace_image, strict=True))


@pytest.mark.parametrize("stride_px", [2, 4, 7])
@pytest.mark.parametrize("seed", [1, 2])
def test_thin_objects_between_the_corners_of_cells_are_all_rendered(
    seed: int, stride_px: int
) -> None:
    camera_states = [CameraState(pose) for pose in random_poses(6)]
    assert max_difference(make_clutter(seed), camera_states, stride_px=stride_px) == 0


def test_thin_objects_when_edges_were_not_followed_would_be_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def find_nothing(*_: object) -> np.ndarray[tuple[int]]:
        return np.zeros(0, dtype=np.int32)

    monkeypatch.setattr(SilhouetteEdges, "find_cells", find_nothing)
    assert max_difference(make_clutter(1), [CameraState(pose) for pose in random_poses(2)]) > 50


@pytest.mark.parametrize("samples", [2, 3])
def test_image_when_of_several_samples_is_that_of_all_rays(samples: int) -> None:
    camera_states = [CameraState(pose) for pose in random_poses(3)]
    assert max_difference(make_clutter(1), camera_states, samples=samples) == 0


@pytest.mark.parametrize(
    "camera",
    [
        make_omni_camera(width_px=121, mirror=HyperbolicMirror(4.0, 0.1)),
        make_omni_camera(width_px=90, mirror=ParabolicMirror(0.05), rim_deg=150.0),
        make_omni_camera(width_px=90, rim_deg=60.0),
        replace(make_omni_camera(width_px=100), image_up_azimuth_rad=0.7),
        replace(make_omni_camera(width_px=100), width_px=131, height_px=83),
        make_omni_camera(width_px=3),
    ],
    ids=["uneven, curved", "parabolic, wide", "narrow", "turned", "cut off", "smaller than a cell"],
)
def test_image_when_of_another_camera_is_that_of_all_rays(camera: OmniCamera) -> None:
    assert (
        max_difference(
            make_clutter(2), [CameraState(pose) for pose in random_poses(3)], camera=camera
        )
        == 0
    )


def test_image_when_of_small_triangles_is_that_of_all_rays() -> None:
    ball = SphereBand(0.2, 0.0, 3.1, 60, 40)
    balls = tuple(
        Item(f"ball {i}", ball, Pose.from_rpy((1.0 + i, 0.3 * i, -0.3)), Material((0.2, 0.5, 0.9)))
        for i in range(2)
    )
    world = make_test_world()
    world = replace(world, items=(*world.items, *balls))
    assert len(build_scene(world)) > 4000  # so that there are clusters
    assert max_difference(world, [CAMERA_STATE, CameraState(Pose.from_rpy((1.0, 0.0, -0.3)))]) == 0


@pytest.mark.parametrize(
    "lights",
    [(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT), (HEMISPHERE_LIGHT, POINT_LIGHT)],
    ids=["texture", "point light"],
)
@pytest.mark.parametrize("samples", [1, 2])
def test_light_when_it_varies_over_a_filled_cell_is_that_of_rays_to_a_level(
    tmp_path: Path, lights: tuple[PointLight, ...], samples: int
) -> None:
    world = make_test_world(lights=lights, texture=write_smooth_texture(tmp_path / "waves.png"))
    camera_states = [CAMERA_STATE, *(CameraState(pose) for pose in random_poses(2))]
    # Where on a triangle a pixel looks is rounded in another place: it may tip a level.
    assert max_difference(world, camera_states, samples=samples) <= 1


@pytest.mark.parametrize("roll_rad", [0.0, 0.3])
def test_object_around_the_pole_is_rendered_as_by_all_rays(roll_rad: float) -> None:
    mirror = Pose.from_rpy((0.0, 0.0, -0.4543), (roll_rad, 0.0, 0.0))
    mesh = build_ego_body_mesh(P2AT, OmniCameraTower(CAMERA, mirror))
    base = Pose.from_rpy((0.4, -0.1, -0.1457), (0.0, 0.0, 0.7))
    own = CameraState(base @ mirror, (DynamicObject(mesh, base),))
    plain = CameraState(base @ mirror)
    shown, without = render_images(make_test_world(), [own, plain], stride_px=4)
    assert (level_differences(shown, without) > 0).mean() > 0.03
    assert max_difference(make_test_world(), [own]) == 0


def test_objects_when_they_move_are_rendered_as_by_all_rays() -> None:
    near = DynamicObject(build_cube_mesh(0.3), Pose.from_rpy((0.5, 0.4, -0.5)))
    speck = DynamicObject(build_cube_mesh(0.005), Pose.from_rpy((0.0, 0.6, -0.5)))
    camera_states = [
        replace(CAMERA_STATE, objects=TWO_ROBOTS),
        replace(CAMERA_STATE, objects=(near, speck)),
        replace(
            CAMERA_STATE,
            objects=(DynamicObject(build_cube_mesh(3.0), CAMERA_STATE.world_from_mirror),),
        ),  # the camera is inside
    ]
    assert max_difference(make_test_world(), camera_states) == 0


def test_image_of_an_empty_world_is_background() -> None:
    assert max_difference(World("w", (), background=(0.5, 0.5, 0.5)), [CAMERA_STATE]) == 0


def test_image_when_rendered_by_more_threads_has_the_same_bytes() -> None:
    one, three = (
        render_images(make_clutter(1), [CAMERA_STATE], stride_px=4, threads=n)[0] for n in (1, 3)
    )
    assert one.tobytes() == three.tobytes()


@pytest.mark.parametrize("samples", [1, 2])
def test_room_when_rendered_needs_less_than_half_of_its_rays(
    monkeypatch: pytest.MonkeyPatch, samples: int
) -> None:
    rays = 0
    run = EmbreeScene.intersect

    def counting_intersect(
        scene: EmbreeScene, origins: np.ndarray[tuple[int]], directions: np.ndarray[tuple[int]]
    ) -> object:
        nonlocal rays
        rays += len(directions)
        return run(scene, origins, directions)

    monkeypatch.setattr(EmbreeScene, "intersect", counting_intersect)
    render_images(make_test_world(), [CAMERA_STATE], stride_px=4, samples=samples)
    assert 0 < rays < 0.5 * np.pi * 120.0**2 * samples**2
