from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects import (
    EffectMode,
    EffectSetting,
    EffectSettings,
    SceneSummary,
    ShadowLoss,
)
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import plan_effects
from catoptra_server.effects.scene.shadows import Shadows
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState, DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    PointLight,
    World,
    srgb_from_linear,
)
from helpers.configs import REPOSITORY
from helpers.effect_measurement import CAMERA
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    GREY,
    box_item,
    floor_item,
    make_inward_facing_room,
    make_world,
)
from helpers.worlds import make_plan

AUTO = EffectSettings((EffectSetting(Shadows(), EffectMode.AUTO),))
VIEW = Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3))
# Shadows fall towards the camera.
BOX_ON_FLOOR = box_item(-0.7, 0.2, -0.3, (0.3, 0.2, 0.6))
MOVING_BOX = DynamicObject(
    build_object_mesh([(box(Box((0.3, 0.3, 0.5))), GREY)]),
    Pose.from_rpy((-0.8, 0.3, -0.25), (0, 0, 0.2)),
)


def world_with_lights(*lights: DirectionalLight | PointLight | HemisphereLight) -> World:
    return make_world(floor_item(), BOX_ON_FLOOR, lights=lights)


def dim_directional_world(irradiance: float) -> World:
    return world_with_lights(
        DIM_HEMISPHERE_LIGHT, DirectionalLight((0.6, 0.0, 0.8), (irradiance,) * 3)
    )


def point_light_world(intensity: float) -> World:
    return world_with_lights(PointLight((-1.4, 0.3, -1.3), (intensity,) * 3))


def bound_and_measured_change(world: World, *objects: DynamicObject) -> tuple[float, float]:
    """Bound of a world, and the largest change of a pixel by shadows, grey levels."""
    scene = build_scene(world)
    renderer = TraceRenderer(scene, world, threads=2)
    view = renderer.prepare(CAMERA, make_plan(CAMERA, samples=2))
    exposure = CameraState(VIEW, objects)
    bound = Shadows().bound(SceneSummarizer(scene, world).summarize(exposure, CAMERA), CAMERA)
    shadowed = dataclasses.replace(exposure, has_shadows=True)
    without, with_them = (view.render_linear(e) for e in (exposure, shadowed))
    renderer.close()
    change = 255.0 * np.abs(srgb_from_linear(with_them) - srgb_from_linear(without)).max()
    return bound.value, float(change)


WORLDS_WITHOUT_SHADOWS = {
    "a floor alone": make_world(floor_item()),
    "an empty room with a point light": make_inward_facing_room(
        PointLight((0.3, 0.2, -1.1), (0.9, 0.9, 0.9))
    ),
    "a box alone": make_world(BOX_ON_FLOOR),
    "a sky": world_with_lights(DIM_HEMISPHERE_LIGHT),
    "a night": world_with_lights(),
    "a dim directional light": dim_directional_world(0.003),
    "a dim point light": point_light_world(1e-4),
    "glass": make_world(floor_item(), dataclasses.replace(BOX_ON_FLOOR, casts_shadows=False)),
    "nothing": World("empty", (), lights=(DIRECTIONAL_LIGHT,)),
}


@pytest.mark.parametrize("name", WORLDS_WITHOUT_SHADOWS)
def test_shadows_when_disabled_would_have_changed_no_pixel_by_more_than_the_threshold(
    name: str,
) -> None:
    bound, change = bound_and_measured_change(WORLDS_WITHOUT_SHADOWS[name])
    assert bound <= 0.5
    # Trace stores radiance in 21 bits.
    assert change <= max(bound, 0.01)


def bundled_world(name: str) -> World:
    return read_world(REPOSITORY / "configs" / "worlds" / f"{name}.ini")[0]


WORLDS_WITH_SHADOWS = {
    "a box on a floor": make_world(floor_item(), BOX_ON_FLOOR),
    "a box in a room with a point light": dataclasses.replace(
        make_inward_facing_room(PointLight((-1.3, 0.2, -1.5), (0.9, 0.9, 0.9))),
        items=(*make_inward_facing_room(DIRECTIONAL_LIGHT).items, BOX_ON_FLOOR),
    ),
    "a directional light just bright enough": dim_directional_world(0.012),
    "a point light just bright enough": point_light_world(1e-3),
    "the field": bundled_world("four_legged_2006"),
    "the corridor": bundled_world("corridor"),
}


@pytest.mark.parametrize("name", WORLDS_WITH_SHADOWS)
def test_shadows_when_enabled_change_a_pixel_by_more_than_half_the_threshold(name: str) -> None:
    bound, change = bound_and_measured_change(WORLDS_WITH_SHADOWS[name])
    assert bound > 0.5
    assert 0.25 < change <= bound + 0.01


def test_object_when_arriving_enables_shadows() -> None:
    bound, change = bound_and_measured_change(make_world(floor_item()), MOVING_BOX)
    assert bound > 0.5
    assert 0.25 < change <= bound


def test_plan_with_a_loss_has_shadows() -> None:
    plan = plan_effects(AUTO, SceneSummary(1.0, max_shadow_loss=ShadowLoss(0.1, 0.2)), CAMERA)
    assert plan.scene_effects == (Shadows(),)


def test_reason_states_how_much_light_can_be_occluded_or_why_none() -> None:
    reason = (
        Shadows().bound(SceneSummary(1.0, max_shadow_loss=ShadowLoss(0.25, 0.5)), CAMERA).reason
    )
    assert "0.25" in reason
    assert "0.5" in reason
    assert "no object is in front" in Shadows().bound(SceneSummary(1.0), CAMERA).reason
