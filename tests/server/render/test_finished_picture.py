"""What an effect changes counts in the picture that the user gets, in whatever light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import EFFECT_TYPES, ImageEffect
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import PointLight
from helpers.effect_measurement import make_effect
from helpers.finished_pictures import draw_pair, draw_path, find_differences
from helpers.lit_worlds import make_hall
from helpers.worlds import make_omni_camera, make_plan


@pytest.mark.parametrize("factor", [1e-4, 1e-3, 0.1, 8.0])
@pytest.mark.parametrize("world", ["corridor", "incidence_rings", "warehouse"])
def test_picture_in_other_light_has_all_effects_that_show(world: str, factor: float) -> None:
    assert find_differences(draw_pair(world, factor)).max() <= 2.0


@pytest.mark.parametrize(
    ("world", "factor", "max_gain"),
    [("rescue", 0.01, 10.0), ("rescue", 0.01, 1000.0), ("four_legged_2006", 1.0, 1000.0)],
)
def test_picture_that_exposes_itself_has_all_effects_that_show(
    world: str, factor: float, max_gain: float
) -> None:
    assert find_differences(draw_pair(world, factor, max_gain=max_gain)).max() <= 2.0


@pytest.mark.parametrize("width_px", [240, 360])
def test_lines_between_the_samples_of_the_sharp_frame_are_blurred(width_px: int) -> None:
    # Lines of the penalty areas: pixels in a row whose samples all pass them.
    pair = draw_pair("four_legged_2006", 1.0, width_px=width_px)
    assert find_differences(pair).max() <= 2.0


def test_picture_of_what_glows_without_any_light_has_all_effects_that_show() -> None:
    pair = draw_pair("corridor", 0.0, max_gain=1000.0)
    assert find_differences(pair).max() <= 2.0
    numbers = [one.change for one in pair[0].effect_decisions if one.change is not None]
    assert numbers
    assert np.isfinite(numbers).all()


# Dark light that the exposure makes daylight, daylight in its neighbour, and four times too long an
# exposure, behind which light above the well spills over. Sky, gloss, baked light; in the last two
# worlds also holder, glare, response and automatic exposure.
@pytest.mark.parametrize(
    ("world", "factor", "exposure", "has_all"),
    [
        ("four_legged_2006", 1.0, 1.0, False),
        ("corridor", 0.01, 1.0, False),
        ("incidence_rings", 1.0, 4.0, False),
        ("meadow", 1.0, 1.0, True),
        ("warehouse", 1.0, 1.0, True),
    ],
)
def test_every_number_about_a_frame_holds_in_its_picture(
    world: str, factor: float, exposure: float, has_all: bool
) -> None:
    first = draw_pair(world, factor, exposure=exposure, has_all=has_all)[0]
    by_criteria = {one.effect: one for one in first.effect_decisions}
    assert set(by_criteria) == set(EFFECT_TYPES)
    on = {name for name, one in by_criteria.items() if one.enabled}
    assert on.issuperset(UNCOMMON.get(world, ()))
    for name in by_criteria:
        # What is off is forced on, what is on is forced off.
        pair = draw_pair(world, factor, exposure=exposure, toggled=name, has_all=has_all)
        decision = next(one for one in pair[0].effect_decisions if one.effect == name)
        stated = decision.bound if decision.change is None else decision.change
        # Both pictures are rounded to whole levels.
        differences = find_differences(pair)
        assert differences.max() <= stated + 1.0, (name, decision)
        assert (differences > 1.5).mean() <= decision.visible_share, (name, decision)
        assert name != "SelfView" or decision.change is not None


UNCOMMON = {
    "meadow": {"SkyRadiance", "Gloss", "MirrorHolder", "VeilingGlare", "Response"},
    "warehouse": {"BakedLight", "MirrorHolder", "VeilingGlare", "AutoExposure"},
}


def test_decisions_along_a_path_of_2_mm_steps_do_not_flicker() -> None:
    frames = draw_path("rescue", [0.002 * step for step in range(60)])
    decided = np.array([[one.enabled for one in frame] for frame in frames])
    # Once a threshold is passed, and not back and forth.
    assert (decided[1:] != decided[:-1]).sum(axis=0).max() <= 1


def test_raster_decides_on_image_effects_as_trace_and_draws_all_scene_effects_that_it_does(
    device: GlDevice,
) -> None:
    drawn = (draw_pair("corridor", 1.0, renderer=name)[0] for name in ("trace", "raster"))
    decisions = [one.effect_decisions for one in drawn]
    by_trace, by_raster = ({one.effect: one.enabled for one in named} for named in decisions)
    image_effects = by_trace.keys() - set(SCENE_EFFECTS)
    assert all(by_raster[name] == by_trace[name] for name in image_effects)
    # Raster measures no scene effect: what no bound proves off it draws.
    assert all(by_raster[name] >= by_trace[name] for name in SCENE_EFFECTS)
    unmeasured = [
        {one.effect for one in named if one.reason.startswith("this renderer cannot measure it")}
        for named in decisions
    ]
    on_in_raster = {name for name in SCENE_EFFECTS if by_raster[name]}
    assert unmeasured == [set(), on_in_raster]
    assert {"SelfView", "MotionBlur"} <= on_in_raster


SCENE_EFFECTS = ("SelfView", "Shadows", "Fog", "RollingShutter", "MotionBlur")
# Telecentric: cos^4 is 1 everywhere.
HALL_CAMERA = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0, width_px=96)
STRENGTHLESS: tuple[ImageEffect, ...] = (
    make_effect("Vignetting"),
    make_effect("Exposure", {"exposure_s": 0.02, "white_exposure_s": 0.02}),
    make_effect("WhiteBalance", {"red_gain": 1.0, "blue_gain": 1.0}),
    make_effect("MirrorDust", {"coverage": 0.0, "num_scratches": 0.0}),
    make_effect("Blooming", {"overflow_fraction": 0.0}),
    make_effect("ChromaticAberration", {"red_magnification": 1.0, "blue_magnification": 1.0}),
    make_effect("Misalignment"),
)


@pytest.mark.parametrize("effect", STRENGTHLESS, ids=lambda one: one.name)
def test_effect_without_strength_changes_no_byte_of_a_hall_brighter_than_white(
    effect: ImageEffect,
) -> None:
    plain, changed = draw_hall(), draw_hall((effect,))
    assert (plain == 255).any()
    np.testing.assert_array_equal(changed, plain)


def test_lamp_at_the_viewpoint_leaves_a_defined_picture() -> None:
    lamp = PointLight(tuple(IN_HALL.translation.tolist()), (2.0, 2.0, 2.0))
    effects = (make_effect("VeilingGlare"), make_effect("AutoExposure"), make_effect("Blooming"))
    first, again = (draw_hall(effects, lamp) for _ in range(2))
    assert 0 < first.mean() < 255
    np.testing.assert_array_equal(first, again)


IN_HALL = Pose.from_rpy((0.5, 0.2, -1.0))


def draw_hall(effects: tuple[ImageEffect, ...] = (), *lamps: PointLight) -> Image:
    """Picture of a hall with surfaces brighter than white."""
    hall = make_hall()
    world = replace(hall, lights=(*hall.lights, *lamps))
    renderer = TraceRenderer(build_scene(world), world, threads=2)
    view = renderer.prepare(HALL_CAMERA, make_plan(HALL_CAMERA, samples=2))
    state = CameraState(IN_HALL, has_shadows=True)
    picture = view.render(state, effects).rgb
    renderer.close()
    return picture
