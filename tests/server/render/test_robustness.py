"""Hard scenes and hard cameras in all renderers: touching walls, no area, far worlds.

Trace renders by each of its engines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import Image, Renderer
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Box, Item, Material, MeshFile, World
from helpers.image_comparison import level_differences
from helpers.opengl import make_raster
from helpers.trace_engines import ENGINES, open_renderer
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
    translate_world,
)

Draw = Callable[..., Image]
GREEN, BLUE = Material((0.0, 1.0, 0.0), unlit=True), (0.0, 0.0, 1.0)
TEN_KM = (10_000.0, -7_000.0, 300.0)


@pytest.fixture(params=(*ENGINES, "raster"))
def render_world(request: pytest.FixtureRequest) -> Iterator[Draw]:
    """Function that renders a world with a camera, from a pose, by one of the renderers."""
    with ExitStack() as stack:

        def render_image(
            world: World,
            camera: OmniCamera,
            pose: Pose = CAMERA_STATE.world_from_mirror,
            tessellation: Tessellation | None = None,
        ) -> Image:
            plan = make_plan(camera, tessellation) if tessellation else make_plan(camera)
            if request.param == "raster":
                device = request.getfixturevalue("device")
                renderer: Renderer = make_raster(device, world)
            else:
                renderer = stack.enter_context(open_renderer(request.param, world, threads=2))
            view = renderer.prepare(camera, plan)
            image = view.render(CameraState(pose)).rgb
            view.close()
            return image

        yield render_image


def make_world(*items: Item) -> World:
    return World("hard", items, lights=(HEMISPHERE_LIGHT,), background=BLUE)


def make_mesh_item(folder: Path, text: str) -> Item:
    """A world's item of an OBJ file with this text."""
    path = folder / "hard.obj"
    path.write_text(text)
    return Item("hard", MeshFile(path), Pose.identity(), GREEN)


@pytest.mark.parametrize("gap_m", [0.002, 0.01, 0.05])
def test_wall_when_it_nearly_touches_the_viewpoint_is_not_cut_away(
    render_world: Draw, gap_m: float
) -> None:
    wall = Item("wall", Box((1.0, 4.0, 4.0)), Pose.from_rpy((0.5 + gap_m, 0.0, 0.0)), GREEN)
    camera = make_omni_camera(width_px=64, rim_deg=110.0)
    image = render_world(make_world(wall), camera, Pose.identity())
    # Forward is up: all directions with x > 0 within 89 degrees of the wall's centre hit it.
    ahead, behind = image[4:31, 32], image[33:60, 32]
    assert (ahead[:, 1] == 255).all()
    assert (behind[:, 2] == 255).all()


def test_viewpoint_within_a_box_sees_only_its_inside(render_world: Draw) -> None:
    box = Item("box", Box((0.004, 0.004, 0.004)), Pose.identity(), GREEN)
    camera = make_omni_camera(width_px=48)
    image = render_world(make_world(box), camera, Pose.from_rpy((0.0002, 0.0001, 0.0003)))
    disc = render_world(World("empty", (), background=BLUE), camera)[..., 2] == 255
    assert (image[disc][:, 1] == 255).mean() > 0.99


def test_triangles_when_without_area_change_nothing(render_world: Draw, tmp_path: Path) -> None:
    whole = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n"
    needles = "v 5 5 -1\nf 1 1 2\nf 5 5 5\nf 1 2 1\n"
    camera = make_omni_camera(width_px=64)
    pose = Pose.from_rpy((0.1, 0.2, -0.5))
    pure = render_world(make_world(make_mesh_item(tmp_path, whole)), camera, pose)
    assert np.array_equal(
        render_world(make_world(make_mesh_item(tmp_path, whole + needles)), camera, pose), pure
    )
    assert (pure[..., 1] == 255).mean() > 0.05


def test_triangles_when_thin_as_hairs_are_rendered_or_not_but_harm_nothing(
    render_world: Draw, tmp_path: Path
) -> None:
    points = np.random.default_rng(8).uniform(-1.0, 1.0, (60, 3))
    hairs = [f"v {x} {y} {z}\nv {x + 1e-9} {y} {z}\nv {x} {y} {z + 1}\n" for x, y, z in points]
    faces = [f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}\n" for i in range(len(points))]
    camera = make_omni_camera(width_px=64)
    with_hairs = render_world(
        make_world(make_mesh_item(tmp_path, "".join(hairs + faces))), camera, Pose.identity()
    )
    empty = render_world(World("empty", (), background=BLUE), camera)
    # A hair is a nanometre wide: at most a few samples meet one.
    assert (level_differences(with_hairs, empty) > 0).mean() < 0.02


# Poses themselves are rounded to 2e-10 m at 2000 km.
@pytest.mark.parametrize(
    ("away", "different"),
    [(TEN_KM, 1e-3), ((1e5, -1e5, 5e4), 2e-3), ((2e6, -1e6, 300.0), 2e-3)],
    ids=["10 km", "100 km", "2000 km"],
)
@pytest.mark.parametrize(
    "lights",
    [(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT), (HEMISPHERE_LIGHT, POINT_LIGHT)],
    ids=["directional light", "point light"],
)
def test_world_when_far_from_the_origin_has_the_same_image(
    render_world: Draw,
    lights: tuple[object, ...],
    away: tuple[float, float, float],
    different: float,
) -> None:
    camera = make_omni_camera(width_px=96)
    offset = Pose.from_rpy(away)
    near = make_test_world(lights=lights)  # type: ignore[arg-type]
    far = translate_world(near, away)
    shifted = tuple(
        replace(light, position_m=tuple(np.add(light.position_m, away)))
        if light is POINT_LIGHT
        else light
        for light in near.lights
    )
    here = render_world(near, camera)
    there = render_world(
        replace(far, lights=shifted), camera, offset @ CAMERA_STATE.world_from_mirror
    )
    # Float64 keeps positions to 2e-12 m at 10 km, all float32 is relative to the world's centre:
    # only samples whose ray passes an edge within 1e-6 m may show its other side.
    assert (level_differences(here, there) > 1).mean() < different


@pytest.mark.parametrize("c_m", [1e-3, 1e3])
@pytest.mark.parametrize(
    "tessellation", [None, Tessellation(24, 10)], ids=["camera model", "polygons"]
)
def test_mirror_of_a_millimetre_or_a_kilometre_equals_the_papers(
    render_world: Draw, c_m: float, tessellation: Tessellation | None
) -> None:
    usual, scaled = (
        make_omni_camera(width_px=96, mirror=HyperbolicMirror(11.546, c)) for c in (0.2321, c_m)
    )
    # A central mirror's image does not depend on its size; polygons are looked up in float32.
    here = render_world(make_test_world(), usual, CAMERA_STATE.world_from_mirror, tessellation)
    there = render_world(make_test_world(), scaled, CAMERA_STATE.world_from_mirror, tessellation)
    assert (level_differences(here, there) > 1).mean() < 2e-3


@pytest.mark.parametrize("size", [(1, 1), (3, 1), (1, 5), (7, 7), (9, 5), (101, 67)])
def test_image_when_tiny_or_odd_is_rendered_to_its_last_pixel(
    render_world: Draw, size: tuple[int, int]
) -> None:
    width, height = size
    radius = 0.5 * math.hypot(width, height)
    mirror = PAPER_MIRROR
    ratio = float(mirror.radius_ratio_from_t(np.array(math.tan(math.radians(60.0)))))
    # The rim circle goes around the image: every pixel sees the mirror.
    camera = OmniCamera(
        mirror, width, height, (0.5 * width, 0.5 * height), 1.01 * radius / ratio, 2.0 / 3 * math.pi
    )
    image = render_world(World("empty", (), background=BLUE), camera)
    assert image.shape == (height, width, 3)
    assert (image == (0, 0, 255)).all()


def test_image_of_one_pixel_shows_the_surface_under_the_viewpoint(render_world: Draw) -> None:
    floor = Item("floor", Box((4.0, 4.0, 0.1)), Pose.from_rpy((0.0, 0.0, 0.5)), GREEN)
    camera = make_omni_camera(width_px=1)
    assert render_world(make_world(floor), camera, Pose.identity()).tolist() == [[[0, 255, 0]]]


def test_robot_when_upside_down_sees_the_sky_where_the_floor_was(render_world: Draw) -> None:
    floor = Item("floor", Box((40.0, 40.0, 0.1)), Pose.from_rpy((0.0, 0.0, 0.6)), GREEN)
    camera = make_omni_camera(width_px=65)
    upright = render_world(make_world(floor), camera, Pose.identity())
    fallen = render_world(
        make_world(floor), camera, Pose.from_rpy((0.0, 0.0, 0.0), (math.pi, 0.0, 0.0))
    )
    assert upright[32, 32].tolist() == [0, 255, 0]
    assert fallen[32, 32].tolist() == [0, 0, 255]
    # The floor is now above the horizon: in the ring between the 90-degree circle and the rim.
    assert fallen[1, 32].tolist() == [0, 255, 0]
    assert upright[1, 32].tolist() == [0, 0, 255]


@pytest.mark.parametrize("rim_deg", [170.0, 178.0, 179.9])
def test_rim_when_next_to_the_antipode_is_rendered(render_world: Draw, rim_deg: float) -> None:
    camera = make_omni_camera(width_px=64, mirror=ParabolicMirror(0.03), rim_deg=rim_deg)
    image = render_world(make_test_world(), camera)
    assert (image[1:-1, 32] > 0).any(axis=-1).all()


def test_rim_when_next_to_the_asymptote_of_nearly_a_plane_is_rendered(render_world: Draw) -> None:
    camera = make_omni_camera(width_px=64, mirror=HyperbolicMirror(2.001, 0.2), rim_deg=91.28)
    image = render_world(make_test_world(), camera)
    assert (image[1:-1, 32] > 0).any(axis=-1).all()


def test_world_when_empty_is_its_background_on_the_mirror_and_black_beside_it(
    render_world: Draw,
) -> None:
    camera = make_omni_camera(width_px=33)
    image = render_world(World("empty", (), background=(1.0, 0.0, 0.2159)), camera)
    _, seen = direction_from_pixel(camera, pixel_sample_positions(camera)[:, :, 0])
    np.testing.assert_array_equal(image[~seen], 0)
    np.testing.assert_array_equal(image[seen], np.tile([255, 0, 128], (seen.sum(), 1)))
