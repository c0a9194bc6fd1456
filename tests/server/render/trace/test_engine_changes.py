"""Changes by the scene's effects, as each engine measures them in a frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import COUNTED_LEVELS, UNCHANGED, Threshold
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import TraceRequest
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, FogMedium, Shutter
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    HemisphereLight,
    Light,
    Material,
    PointLight,
    Twist,
    srgb_from_linear,
)
from helpers.dynamic_objects import place_cube
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    box_item,
    floor_item,
    make_inward_facing_room,
    make_world,
)
from helpers.standing_things import blend_scene
from helpers.trace_engines import ENGINES, open_engine
from helpers.trace_kernels import make_omni_table

pytestmark = pytest.mark.parametrize("engine", ENGINES)

TABLES = {
    "1 sample": make_omni_table(width_px=72),
    "4 samples": make_omni_table(width_px=48, samples=2),
}
LAMP = PointLight((0.6, 0.4, -1.4), (0.8, 0.7, 0.6))
LIGHTS: dict[str, tuple[Light, ...]] = {
    "directional": (DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
    "point": (DIM_HEMISPHERE_LIGHT, LAMP),
    "both": (DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, LAMP),
    "brighter than white": (HemisphereLight((1.6,) * 3, (1.2,) * 3), DIRECTIONAL_LIGHT, LAMP),
}
BOXES = (box_item(0.5, 0.1, -0.15, (0.3, 0.2, 0.3)), box_item(-0.5, -0.4, -0.4, (0.1, 0.4, 0.02)))
STATE = CameraState(Pose.from_rpy((0.05, 0.03, -1.1), (0.02, 0.1, 0.3)), has_shadows=True)
REQUEST = TraceRequest(thresholds={"Shadows": Threshold(0.5), "SelfView": Threshold(0.5)})
LINEAR_REQUEST = replace(REQUEST, is_linear=True)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
@pytest.mark.parametrize("lights", LIGHTS.values(), ids=LIGHTS)
def test_change_by_shadows_is_that_between_frames_with_and_without(
    engine: EngineName, lights: tuple[Light, ...], table: RayTable
) -> None:
    world = make_world(floor_item(), *BOXES, lights=lights)
    state = replace(STATE, objects=(place_cube(-0.6, 0.5, -0.6),))
    with open_engine(engine, world) as opened:
        rays = opened.prepare(table)
        linear = [
            rays.render_linear(each).astype(np.float64)
            for each in (state, replace(state, has_shadows=False))
        ]
        measured = rays.render(state, LINEAR_REQUEST).changes["Shadows"].largest
        clipped = rays.render(state, REQUEST).changes["Shadows"].largest
        plain = rays.render(replace(state, has_shadows=False), REQUEST).changes
        unmeasured = rays.render(state, TraceRequest()).changes
    dark, light = (255.0 * srgb_from_linear(np.clip(each, 0.0, 1.0)) for each in linear)
    expected = np.abs(dark - light).max()
    assert measured == pytest.approx(expected, abs=0.01)
    # Samples are clipped one by one before their mean: at most as bright.
    assert clipped == pytest.approx(expected, abs=0.01) or table.samples > 1
    assert expected == 0.0 or clipped > 0.5 * expected
    assert (plain, unmeasured) == ({}, {})


def test_change_by_a_wide_shadow_on_a_texture_is_that_between_frames_with_and_without(
    engine: EngineName,
) -> None:
    # Rays enough for proofs that fill tiles.
    table = make_omni_table(width_px=160, samples=2)
    planks = Material((1.0, 1.0, 1.0), texture="planks", tile_m=0.5)
    roof = box_item(0.0, 0.0, -1.6, (12.0, 12.0, 0.02))
    world = make_world(floor_item(material=planks), roof, lights=LIGHTS["directional"])
    with open_engine(engine, world) as opened:
        rays = opened.prepare(table)
        dark, light = (
            255.0 * srgb_from_linear(np.clip(rays.render_linear(each).astype(np.float64), 0.0, 1.0))
            for each in (STATE, replace(STATE, has_shadows=False))
        )
        measured = rays.render(STATE, LINEAR_REQUEST).changes["Shadows"].largest
    assert measured == pytest.approx(np.abs(dark - light).max(), abs=0.05)


def test_change_by_shadows_of_a_convex_room_around_its_lamp_is_nothing(engine: EngineName) -> None:
    world = make_inward_facing_room(PointLight((0.2, 0.3, -1.7), (0.5, 0.5, 0.5)))
    with open_engine(engine, world) as opened:
        frame = opened.prepare(TABLES["4 samples"]).render(STATE, REQUEST)
    assert frame.changes["Shadows"].largest == 0.0


def test_change_by_shadows_when_threads_differ_is_the_same(engine: EngineName) -> None:
    world = make_world(floor_item(), *BOXES, lights=LIGHTS["both"])
    found = []
    for threads in (1, 2, 3):
        with open_engine(engine, world, threads=threads) as opened:
            rays = opened.prepare(TABLES["4 samples"])
            found += [rays.render(STATE, REQUEST).changes["Shadows"].largest for _ in range(3)]
    assert found[0] > 10.0
    assert len(set(found)) == 1


def test_change_by_shadows_that_only_other_instants_show_is_found(engine: EngineName) -> None:
    # From a lamp itself no shadow is seen; from beside it those beside a near pillar are.
    pillar = box_item(0.4, 0.0, -0.6, (0.06, 0.06, 1.2))
    lamp = PointLight((0.0, 0.0, -1.1), (0.8, 0.7, 0.6))
    world = make_world(floor_item(), pillar, lights=(DIM_HEMISPHERE_LIGHT, lamp))
    still = CameraState(Pose.from_rpy((0.0, 0.0, -1.1)), has_shadows=True)
    drives = replace(still, twist=Twist((0.0, 3.0, 0.0)), shutter=Shutter(1.0 / 30.0, 0.0, 64.0))
    thresholds = {"Shadows": Threshold(0.5), "MotionBlur": Threshold(0.5)}
    with open_engine(engine, world) as opened:
        rays = opened.prepare(TABLES["4 samples"])
        changes = [
            rays.render(state, TraceRequest(is_linear=True, thresholds=thresholds)).changes
            for state in (still, drives)
        ]
    assert changes[0]["Shadows"].largest <= 0.5
    assert changes[1]["Shadows"].largest > 5.0


def test_shadows_are_counted_in_every_pixel_that_they_change_visibly(engine: EngineName) -> None:
    world = make_world(floor_item(), *BOXES, lights=LIGHTS["both"])
    counted = {"Shadows": Threshold(255.0, visible_share=0.999)}
    ended = {"Shadows": Threshold(255.0, visible_share=0.001)}
    with open_engine(engine, world) as opened:
        rays = opened.prepare(TABLES["4 samples"])
        frame = rays.render(STATE, TraceRequest(is_linear=True, thresholds=counted))
        lit = rays.render_linear(replace(STATE, has_shadows=False))
        rest = rays.render(STATE, TraceRequest(is_linear=True, thresholds=ended))
    changes = find_changes(frame.image, lit, UNCHANGED).max(axis=-1)
    shares = [float((changes > level).mean()) for level in (0.5, 0.24)]
    # Lamps that cast no ray may add a quarter of a level to what is measured.
    assert shares[0] <= frame.changes["Shadows"].visible_share <= shares[1]
    assert shares[0] > 0.005
    share = 1.0 if engine == "kernel" else frame.changes["Shadows"].visible_share
    assert rest.changes["Shadows"].visible_share == share


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
@pytest.mark.parametrize("lights", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("height_m", [0.6, 0.8, -3.0])
def test_change_by_the_self_view_is_that_between_frames_with_and_without_the_body(
    engine: EngineName, lights: tuple[Light, ...], table: RayTable, height_m: float
) -> None:
    # Two of a kind: the body is the last. Above a camera whose mirror looks down it is not seen.
    other = place_cube(0.9, 0.0, -0.3)
    body = replace(place_cube(0.05, 0.03, -1.1 + height_m), mesh=other.mesh)
    world = make_world(floor_item(), *BOXES, lights=lights)
    with_it = replace(STATE, objects=(other, body), ego_body=body)
    counted = Threshold(255.0, visible_share=0.999)
    request = TraceRequest(thresholds={"Shadows": counted, "SelfView": counted})
    for has_shadows in (False, True):
        state = replace(with_it, has_shadows=has_shadows)
        with open_engine(engine, world) as opened:
            rays = opened.prepare(table)
            light = rays.render_linear(state)
            without = rays.render_linear(replace(state, objects=(other,)))
            found = rays.render(state, request).changes
            assert "SelfView" not in rays.render(replace(state, objects=()), request).changes
        levels = find_changes(light, without, UNCHANGED).max(axis=-1)
        stated, expected = found["SelfView"], levels.max()
        share = (levels > COUNTED_LEVELS).mean()
        assert expected - 0.02 <= stated.largest < np.inf
        assert share <= stated.visible_share + 2 / levels.size
        if not has_shadows:
            assert stated.largest == pytest.approx(expected, abs=0.02)
            assert stated.visible_share == pytest.approx(share, abs=2 / levels.size)
            assert (expected > 5.0) == (height_m > 0.0)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_changes_by_shadows_and_fog_of_what_blends_are_those_between_frames(
    engine: EngineName, table: RayTable
) -> None:
    world = make_world(floor_item(), *BOXES, lights=LIGHTS["both"])
    scene = blend_scene(build_scene(world), seed=1)
    counted = Threshold(255.0, visible_share=0.999)
    request = TraceRequest(is_linear=True, thresholds={"Shadows": counted, "Fog": counted})
    state = replace(STATE, fog=FogMedium(0.4, (0.3, 0.4, 0.5)))
    with open_engine(engine, world, scene=scene) as opened:
        rays = opened.prepare(table)
        frame = rays.render(state, request)
        others = {"Shadows": replace(state, has_shadows=False), "Fog": replace(state, fog=None)}
        for name, other in others.items():
            levels = find_changes(frame.image, rays.render_linear(other), UNCHANGED)
            assert levels.max() > 1.0
            # Lamps that cast no ray may add a quarter of a level to what is measured.
            assert frame.changes[name].largest == pytest.approx(levels.max(), abs=0.3)


def test_change_by_the_self_view_behind_a_surface_that_blends_is_counted(
    engine: EngineName,
) -> None:
    body = place_cube(0.05, 0.03, -0.5)
    world = make_world(floor_item(), *BOXES, lights=LIGHTS["both"])
    scene = build_scene(world)
    # The boxes stand above the floor: of what blends, all is before the body or beside it.
    pane = np.array([[-9.0, -9.0, -0.75], [9.0, -9.0, -0.75], [0.0, 9.0, -0.75]])
    corners = scene.corners.copy()
    corners[-1] = pane
    blended = np.arange(len(scene)) == len(scene) - 1
    scene = replace(
        scene,
        corners=corners,
        coverage=np.where(blended[:, None], [1.4] * 3, np.inf),
        blended=blended,
        two_sided=blended,
    )
    state = replace(STATE, objects=(body,), ego_body=body, has_shadows=False)
    request = TraceRequest(is_linear=True, thresholds={"SelfView": Threshold(255.0)})
    with open_engine(engine, world, scene=scene) as opened:
        rays = opened.prepare(TABLES["4 samples"])
        levels = find_changes(
            rays.render_linear(state), rays.render_linear(replace(state, objects=())), UNCHANGED
        )
        change = rays.render(state, request).changes["SelfView"]
        hits = rays.find_hits(state)
    assert not (hits.object > 0).any()
    assert levels.max() > 3.0
    assert change.largest == pytest.approx(levels.max(), abs=0.02)


def test_picture_is_the_same_where_measures_may_end(engine: EngineName) -> None:
    body = place_cube(0.05, 0.03, -0.5)
    world = make_world(floor_item(), *BOXES, lights=LIGHTS["both"])
    state = replace(STATE, objects=(body,), ego_body=body)
    may_end = {name: replace(one, may_end=True) for name, one in REQUEST.thresholds.items()}
    with open_engine(engine, world) as opened:
        rays = opened.prepare(TABLES["4 samples"])
        measured = rays.render(state, REQUEST)
        frame = rays.render(state, replace(REQUEST, thresholds=may_end))
    np.testing.assert_array_equal(frame.image, measured.image)
    assert set(frame.changes) == set(measured.changes)
    for name, change in frame.changes.items():
        threshold = REQUEST.thresholds[name]
        assert threshold.covers(change) == threshold.covers(measured.changes[name])
        assert not change.is_partial or change.largest <= measured.changes[name].largest
    ended = {name for name, one in frame.changes.items() if one.is_partial}
    assert ended == (set() if engine != "kernel" else {"Shadows", "SelfView"})


def test_change_by_the_self_view_beside_shadows_that_nobody_measures_has_no_number(
    engine: EngineName,
) -> None:
    body = place_cube(0.05, 0.03, -0.5)
    world = make_world(floor_item(), lights=LIGHTS["both"])
    state = replace(STATE, objects=(body,), ego_body=body)
    request = TraceRequest(thresholds={"Shadows": Threshold(-1.0), "SelfView": Threshold(0.5)})
    with open_engine(engine, world) as opened:
        change = opened.prepare(TABLES["1 sample"]).render(state, request).changes["SelfView"]
    assert change.largest == np.inf if engine == "kernel" else change.largest > 0.5


def test_change_by_the_self_view_under_a_rolling_shutter_is_that_of_the_rows(
    engine: EngineName,
) -> None:
    body = place_cube(0.05, 0.03, -0.5)
    world = make_world(floor_item(), lights=LIGHTS["both"])
    rolling = Shutter(0.0, 1.0 / 30.0, 8.0)
    state = replace(STATE, objects=(body,), ego_body=body, shutter=rolling, has_shadows=False)
    request = TraceRequest(is_linear=True, thresholds={"SelfView": Threshold(255.0)})
    moving = replace(state, twist=Twist((0.0, 0.6, 0.0)))
    with open_engine(engine, world) as opened:
        rays = opened.prepare(TABLES["4 samples"])
        with_it, without = (
            rays.render_linear(replace(moving, objects=objects)) for objects in ((body,), ())
        )
        stated = rays.render(moving, request).changes["SelfView"]
    expected = find_changes(with_it, without, UNCHANGED).max()
    # The reference measures the middle of the readout.
    assert stated.largest == pytest.approx(expected, abs=0.02 if engine == "kernel" else 9.0)
