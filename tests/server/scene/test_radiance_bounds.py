"""The brightest light of a scene is bounded, and not by much more than it is."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.scene.radiance_bounds import max_radiance
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import (
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    World,
)
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
)


def largest_of(world: World) -> float:
    return max_radiance(build_scene(world), world)


@pytest.mark.parametrize(
    "lights",
    [
        (HEMISPHERE_LIGHT,),
        (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
        (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
    ],
)
def test_picture_when_drawn_is_never_brighter_than_the_summary_says(
    lights: tuple[Light, ...],
) -> None:
    world = make_test_world(lights=lights)
    scene, camera = build_scene(world), make_omni_camera()
    renderer = TraceRenderer(scene, world, threads=1)
    view = renderer.prepare(camera, make_plan(camera))
    assert view.render_linear(CAMERA_STATE).max() <= largest_of(world) * (1.0 + 1e-6)
    renderer.close()


def test_world_when_nothing_is_lit_is_as_bright_as_its_background() -> None:
    assert largest_of(World("night", (), background=(0.01, 0.03, 0.02))) == 0.03


def test_white_robot_when_it_comes_is_counted_under_sky_and_sun() -> None:
    lights = (
        HemisphereLight((0.2, 0.2, 0.2), (0.1, 0.1, 0.1)),
        DirectionalLight((0, 0, 1), (2, 1, 1)),
    )
    assert largest_of(World("dusk", (), lights=lights)) == pytest.approx(2.2)


def test_floor_when_under_a_lamp_is_as_bright_as_right_below_it() -> None:
    floor = Item("floor", Rectangle((2, 2)), Pose.identity(), Material((0.5, 0.5, 0.5)))
    lamp = PointLight((0.3, 0.2, -0.5), (1.0, 1.0, 1.0))
    assert largest_of(World("lamp", (floor,), lights=(lamp,))) == pytest.approx(0.5 / 0.25)


def test_unlit_facet_when_a_lamp_touches_it_stays_as_it_is() -> None:
    floor = Item("sign", Rectangle((2, 2)), Pose.identity(), Material((0.5, 0.5, 0.5), unlit=True))
    lamp = PointLight((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert largest_of(World("lamp", (floor,), lights=(lamp,))) == pytest.approx(0.5)
    assert np.isfinite(largest_of(World("lamp", (floor,), lights=(lamp,))))
