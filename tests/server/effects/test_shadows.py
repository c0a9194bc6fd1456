from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.decide import decide
from catoptra_server.effects.effect import Effect, EffectWishes, Mode, Wish
from catoptra_server.effects.scene_summary import SceneSummary, Shade
from catoptra_server.effects.shadows import Shadows
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.scene.bodies import Body, body_mesh
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    PointLight,
    World,
)
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.primitives import box
from helpers.configs import REPOSITORY
from helpers.effects import CAMERA
from helpers.shadows import DUSK, GREY, SUN, box_at, floor, inward_room, world_of
from helpers.worlds import raster_plan

AUTO = EffectWishes((Wish(Shadows(), Mode.AUTO),))
VIEW = Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3))
# Its shadows fall towards the camera.
STANDING = box_at(-0.7, 0.2, -0.3, (0.3, 0.2, 0.6))
BODY = Body(
    body_mesh([(box(Box((0.3, 0.3, 0.5))), GREY)]), Pose.from_rpy((-0.8, 0.3, -0.25), (0, 0, 0.2))
)


def under(*lights: DirectionalLight | PointLight | HemisphereLight) -> World:
    return world_of(floor(), STANDING, lights=lights)


def dim(irradiance: float) -> World:
    return under(DUSK, DirectionalLight((0.6, 0.0, 0.8), (irradiance,) * 3))


def by_night(intensity: float) -> World:
    return under(PointLight((-1.4, 0.3, -1.3), (intensity,) * 3))


def changed_levels(world: World, *bodies: Body) -> tuple[float, float]:
    """Return the bound of a world, and by how much shadows change the pixel that changes most."""
    renderer = TraceRenderer(build_scene(world), world, threads=2)
    view = renderer.prepare(CAMERA, raster_plan(CAMERA, samples=2))
    exposure = Exposure(VIEW, bodies)
    bound = Shadows().bound(renderer.summary(exposure, CAMERA), CAMERA)
    forced = dataclasses.replace(exposure, has_shadows=True)
    without, with_them = (view.draw_linear(e) for e in (exposure, forced))
    renderer.close()
    change = 255.0 * np.abs(srgb_from_linear(with_them) - srgb_from_linear(without)).max()
    return bound.value, float(change)


QUIET = {
    "a floor alone": world_of(floor()),
    "an empty room with a lamp": inward_room(PointLight((0.3, 0.2, -1.1), (0.9, 0.9, 0.9))),
    "a box alone": world_of(STANDING),
    "a sky": under(DUSK),
    "a night": under(),
    "a dim sun": dim(0.003),
    "a dim lamp": by_night(1e-4),
    "glass": world_of(floor(), dataclasses.replace(STANDING, casts_shadows=False)),
    "nothing": World("empty", (), lights=(SUN,)),
}


@pytest.mark.parametrize("name", QUIET)
def test_shadows_when_left_out_would_have_changed_no_pixel_by_more_than_the_threshold(
    name: str,
) -> None:
    bound, change = changed_levels(QUIET[name])
    assert bound <= 0.5
    # Light is stored in 21 bits.
    assert change <= max(bound, 0.01)


def shipped(name: str) -> World:
    return read_world(REPOSITORY / "configs" / "worlds" / f"{name}.ini")[0]


CALLING = {
    "a box on a floor": world_of(floor(), STANDING),
    "a box in a room with a lamp": dataclasses.replace(
        inward_room(PointLight((-1.3, 0.2, -1.5), (0.9, 0.9, 0.9))),
        items=(*inward_room(SUN).items, STANDING),
    ),
    "a sun just bright enough": dim(0.012),
    "a lamp just bright enough": by_night(1e-3),
    "the field": shipped("four_legged_2006"),
    "the corridor": shipped("corridor"),
}


@pytest.mark.parametrize("name", CALLING)
def test_shadows_when_called_for_change_a_pixel_by_more_than_half_the_threshold(name: str) -> None:
    bound, change = changed_levels(CALLING[name])
    assert bound > 0.5
    assert 0.25 < change <= bound + 0.01


def test_body_when_it_comes_calls_for_shadows() -> None:
    bound, change = changed_levels(world_of(floor()), BODY)
    assert bound > 0.5
    assert 0.25 < change <= bound


def test_shadows_change_the_scene_not_the_picture() -> None:
    assert not isinstance(Shadows(), Effect)
    plan = decide(AUTO, SceneSummary(1.0, largest_shadow=Shade(0.1, 0.2)), CAMERA)
    assert plan.staged == (Shadows(),)


def test_reason_when_told_says_how_much_light_can_be_hidden_or_why_none() -> None:
    said = Shadows().bound(SceneSummary(1.0, largest_shadow=Shade(0.25, 0.5)), CAMERA).reason
    assert "0.25" in said
    assert "0.5" in said
    assert "nothing stands before" in Shadows().bound(SceneSummary(1.0), CAMERA).reason
