"""Mirrored light on glossy surfaces: native against float64, and against a room built twice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import Threshold
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import TracedFrame, TraceRequest
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, FogMedium, Shutter
from catoptra_server.world.world_description import (
    Box,
    HemisphereLight,
    Item,
    Material,
    PointLight,
    SurfaceGloss,
    Twist,
    World,
)
from helpers.dynamic_objects import place_cube
from helpers.image_comparison import grey_levels
from helpers.trace_engines import ENGINES, open_engine
from helpers.worlds import (
    CAMERA_STATE,
    make_omni_camera,
    make_plan,
    make_smooth_sky,
    make_test_world,
    under_sky,
)

CAMERA = make_omni_camera(width_px=120)
LAMP = PointLight((0.5, 0.4, -1.5), (0.8, 0.8, 0.7))
GLOSSY = replace(CAMERA_STATE, has_gloss=True)


def make_glossy_world(gloss: SurfaceGloss | None, texture: Path | str | None = None) -> World:
    """The test world with a glossy floor, and a glossy crate that is not level."""
    world = make_test_world(texture=None)
    items = tuple(
        replace(item, material=replace(item.material, gloss=gloss, texture=texture, tile_m=0.5))
        if item.name in ("floor", "crate") and item.material is not None
        else item
        for item in world.items
    )
    return replace(world, items=items, lights=(*world.lights, LAMP))


def trace(
    engine: EngineName, world: World, state: CameraState, threshold: Threshold | None = None
) -> TracedFrame:
    thresholds = {} if threshold is None else {"Gloss": threshold}
    with open_engine(engine, world) as opened:
        rays = opened.prepare(omni_ray_table(CAMERA, make_plan(CAMERA, samples=2)))
        frame = rays.render(state, TraceRequest(is_linear=True, thresholds=thresholds))
        rays.close()
    return frame


STATES = {
    "plain": GLOSSY,
    "shadows": replace(GLOSSY, has_shadows=True),
    "fog": replace(GLOSSY, fog=FogMedium(0.3, (0.5, 0.55, 0.6))),
    "object": replace(GLOSSY, objects=(place_cube(0.9, 0.3, -0.3),)),
}


@pytest.mark.parametrize("texture", [None, "planks"])
@pytest.mark.parametrize("roughness", [0.0, 0.3])
@pytest.mark.parametrize("name", STATES)
def test_gloss_when_native_is_that_of_the_reference(
    name: str, roughness: float, texture: str | None
) -> None:
    world = make_glossy_world(SurfaceGloss(0.3, roughness), texture)
    native, reference = (grey_levels(trace(e, world, STATES[name]).image) for e in ENGINES)
    difference = np.abs(native - reference).max(axis=-1)
    # An edge may meet another sample in float32.
    assert (difference > 0.1).mean() < 0.004
    matt = grey_levels(trace("reference", world, replace(STATES[name], has_gloss=False)).image)
    assert np.abs(reference - matt).max() > 20.0


@pytest.mark.parametrize("engine", ENGINES)
def test_rough_gloss_mirrors_the_light_of_objects_and_not_of_baked_surfaces(
    engine: EngineName,
) -> None:
    # Surfaces have the light of their brightest node, times a map.
    world = make_glossy_world(SurfaceGloss(1.0, 1.0))
    dark = replace(world, object_sky=HemisphereLight((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    light, none = ((trace(engine, one, GLOSSY).image == 0.0).all(axis=-1) for one in (world, dark))
    assert (none & ~light).mean() > 0.1


def test_gloss_mirrors_the_sky_of_each_direction() -> None:
    world = under_sky(make_glossy_world(SurfaceGloss(0.3, 0.0)), make_smooth_sky())
    native, reference = (grey_levels(trace(e, world, GLOSSY).image) for e in ENGINES)
    difference = np.abs(native - reference).max(axis=-1)
    # An edge may meet another sample in float32.
    assert (difference > 0.1).mean() < 0.004


def test_mirror_shows_the_room_below_its_floor() -> None:
    """A floor of reflectance 1 shows what a hole with the mirrored room would."""
    light = HemisphereLight((0.8, 0.8, 0.8), (0.8, 0.8, 0.8))
    red = Material((0.7, 0.1, 0.1))
    floor = Item("floor", Box((6.0, 6.0, 0.2)), Pose.from_rpy((0, 0, 0.1)), Material((0.0,) * 3))
    posts = [
        Item(f"post{z}", Box((0.3, 0.4, 0.6)), Pose.from_rpy((1.2, 0.2, z)), red)
        for z in (-0.5, 0.5)
    ]
    assert floor.material is not None
    mirror = replace(floor, material=replace(floor.material, gloss=SurfaceGloss(1.0, 0.0)))
    glossy = World("mirror", (mirror, posts[0]), lights=(light,), background=(0.2, 0.3, 0.4))
    twice = replace(glossy, items=tuple(posts))
    one, other = (grey_levels(trace("kernel", world, GLOSSY).image) for world in (glossy, twice))
    # Edges of the mirrored post may fall into other samples.
    assert (np.abs(one - other).max(axis=-1) > 0.1).mean() < 0.01


@pytest.mark.parametrize("engine", ENGINES)
def test_gloss_is_measured_and_left_out_where_nobody_misses_it(engine: EngineName) -> None:
    world = make_glossy_world(SurfaceGloss(0.04, 0.1))
    change = trace(engine, world, GLOSSY, Threshold(0.5)).changes["Gloss"]
    glossy, matt = (
        grey_levels(trace(engine, world, replace(GLOSSY, has_gloss=on)).image)
        for on in (True, False)
    )
    truth = float(np.abs(glossy - matt).max())
    assert truth - 0.5 <= change.largest <= 2.0 * truth + 0.5
    skipped = grey_levels(trace(engine, world, GLOSSY, Threshold(8.0, visible_share=1.0)).image)
    assert np.abs(skipped - glossy).max() <= 8.0


def test_gloss_when_moving_is_the_mean_of_sharp_frames() -> None:
    world = make_glossy_world(SurfaceGloss(0.3, 0.1))
    moving = replace(place_cube(0.9, 0.3, -0.3), twist=Twist((0.5, 0.0, 0.0)))
    state = replace(GLOSSY, objects=(moving,), shutter=Shutter(0.02, 0.0, 4.0))
    native, reference = (grey_levels(trace(engine, world, state).image) for engine in ENGINES)
    assert (np.abs(native - reference).max(axis=-1) > 0.5).mean() < 0.004
