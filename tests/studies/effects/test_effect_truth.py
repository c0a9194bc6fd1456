"""The truth against cases whose change is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import Effect, EffectChange
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.effects.scene.shadows import Shadows
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.effects.sensor.white_balance import WhiteBalance
from catoptra_server.render.renderer import LinearImage
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Twist, srgb_from_linear
from catoptra_studies.effects.effect_truth import EffectTruth
from helpers.effect_measurement import DYNAMIC_OBJECT
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=32)
STATE = CameraState(Pose.identity())
DRIVING = replace(STATE, twist=Twist((1.0, 0.0, 0.0)))


def make_image(light: float) -> LinearImage:
    return np.full((CAMERA.height_px, CAMERA.width_px, 3), light, dtype=np.float32)


def make_truth(render_linear: Callable[[CameraState], LinearImage]) -> EffectTruth:
    ranges = np.full((CAMERA.height_px, CAMERA.width_px), np.inf, dtype=np.float32)
    return EffectTruth(CAMERA, render_linear, lambda _: ranges)


def measure_alone(
    render_linear: Callable[[CameraState], LinearImage], effect: Effect, state: CameraState
) -> float:
    """True change by one effect that is not drawn."""
    (truth,) = make_truth(render_linear).measure(state, (effect,), frozenset()).values()
    return truth.largest


def render_slope(state: CameraState) -> LinearImage:
    """Light that grows with the way."""
    return make_image(0.5 + float(state.world_from_mirror.translation[0]))


def grey(light: float) -> float:
    return 255.0 * float(srgb_from_linear(np.array(light)))


# On both sides of the curve's joint at 0.0031308, and of white.
@pytest.mark.parametrize("light", [0.002, 0.0062, 0.0064, 0.3, 0.999, 1.5])
def test_change_is_in_the_grey_levels_of_the_images(light: float) -> None:
    truth = measure_alone(lambda _: make_image(light), Exposure(0.01, 0.02), STATE)
    assert truth == pytest.approx(grey(light) - grey(0.5 * light), abs=1e-4)


def test_share_counts_the_pixels_that_change_visibly() -> None:
    image = make_image(0.0)
    image[:4, :8, 1] = 0.5
    image[4:, :, 2] = 1e-4  # a third of a level
    truth = make_truth(lambda _: image).measure(STATE, (Exposure(0.01, 0.02),), frozenset())
    assert truth["Exposure"].visible_share == 4 * 8 / (image.shape[0] * image.shape[1])


def test_change_is_of_the_picture_behind_all_drawn_effects() -> None:
    effects = (Exposure(0.01, 0.02), WhiteBalance(1.5, 1.0))
    truth = make_truth(lambda _: make_image(0.5))
    both = truth.measure(STATE, effects, frozenset({"Exposure", "WhiteBalance"}))
    # Red changes most; each behind or before the other one.
    assert both["Exposure"].largest == pytest.approx(grey(0.75) - grey(0.375))
    assert both["WhiteBalance"].largest == pytest.approx(grey(0.375) - grey(0.25))
    last = truth.measure(STATE, effects, frozenset({"WhiteBalance"}))
    assert last["Exposure"].largest == both["Exposure"].largest, "whether drawn or not"
    assert last["WhiteBalance"].largest == pytest.approx(grey(0.75) - grey(0.5))


def test_change_in_the_dark_is_of_the_bright_picture() -> None:
    def render(state: CameraState) -> LinearImage:
        return make_image(2e-4 - 1e-4 * state.has_shadows)

    effects = (Shadows(), Exposure(1.0, 1e-3))
    truth = make_truth(render).measure(STATE, effects, frozenset({"Exposure"}))
    assert truth["Shadows"].largest == pytest.approx(grey(0.2) - grey(0.1), rel=1e-6)


def test_shadows_and_own_body_are_differences_of_frames() -> None:
    def render(state: CameraState) -> LinearImage:
        return make_image(0.5 - 0.2 * state.has_shadows + 0.25 * len(state.objects))

    state = replace(STATE, ego_body=DYNAMIC_OBJECT)
    effects = (SelfView(), Shadows())
    truth = make_truth(render).measure(state, effects, frozenset({"SelfView"}))
    assert truth["SelfView"].largest == pytest.approx(grey(0.75) - grey(0.5))
    assert truth["Shadows"].largest == pytest.approx(grey(0.75) - grey(0.55), rel=1e-6)
    alone = make_truth(render).measure(STATE, effects, frozenset())
    assert alone["SelfView"] == EffectChange(0.0), "a camera that no robot carries"


def test_motion_is_the_mean_of_the_exposure() -> None:
    # Light grows with the way: from a quarter to three quarters the mean is the light at the pose.
    def render(state: CameraState) -> LinearImage:
        return make_image(0.5 + float(state.world_from_mirror.translation[0]) ** 2)

    blur = MotionBlur(0.6)
    truth = measure_alone(render, blur, DRIVING)
    assert truth == pytest.approx(grey(0.5 + 0.6**2 / 12.0) - grey(0.5), rel=1e-3)
    assert measure_alone(render, blur, STATE) == 0.0


def test_rolling_shutter_shows_each_row_at_its_time() -> None:
    readout_s = 0.4
    truth = measure_alone(render_slope, RollingShutter(readout_s), DRIVING)
    # The first row is exposed half the readout before the pose, but for half a row and a frame.
    rows = CAMERA.height_px
    first_s = 0.5 * readout_s * (1.0 - 1.0 / rows)
    slack = grey(0.5) - grey(0.5 - readout_s / 64)
    assert truth == pytest.approx(grey(0.5) - grey(0.5 - first_s), abs=2.0 * slack)
    assert measure_alone(render_slope, RollingShutter(0.0), DRIVING) == 0.0


def test_motion_blur_of_a_rolling_shutter_is_beside_its_sharp_rows() -> None:
    effects = (RollingShutter(0.2), MotionBlur(0.1))
    truth = make_truth(render_slope).measure(DRIVING, effects, frozenset({"RollingShutter"}))
    # Linear light of a linear motion: the blur changes nothing but by the steps of the frames.
    assert truth["RollingShutter"].largest > 15.0
    assert truth["MotionBlur"].largest < 1.0


def test_disc_by_depth_is_compared_with_the_disc_of_infinity() -> None:
    # Large enough for a disc of several pixels.
    camera = make_omni_camera(width_px=200)
    image = np.zeros((200, 200, 3), dtype=np.float32)
    image[100:102, 130:132] = 0.5
    aperture = Aperture(1.4, 7.4e-6, 0.0)
    effects = (DefocusByDepth(aperture), Defocus(aperture))

    def measure(range_m: float, drawn: str) -> dict[str, EffectChange]:
        ranges = np.full((200, 200), range_m, dtype=np.float32)
        truth = EffectTruth(camera, lambda _: image, lambda _: ranges)
        return truth.measure(STATE, effects, frozenset({drawn}))

    # Everything is far away: the same disc, and Defocus has nothing left to do.
    ((name, far),) = measure(np.inf, "DefocusByDepth").items()
    assert name == "DefocusByDepth"
    assert far.largest < 0.1
    assert measure(0.06, "DefocusByDepth")["DefocusByDepth"].largest > 1.0
    assert measure(np.inf, "Defocus")["Defocus"].largest > 10.0


def test_frames_of_a_pose_are_rendered_once() -> None:
    calls = []

    def render(state: CameraState) -> LinearImage:
        calls.append(state)
        return make_image(0.5)

    truth = make_truth(render)
    for _ in range(3):
        truth.measure(STATE, (Shadows(), WhiteBalance(2.0, 1.0)), frozenset({"Shadows"}))
    assert len(calls) == 2
    other = replace(STATE, world_from_mirror=Pose.from_rpy((1.0, 0.0, 0.0)))
    truth.measure(other, (Shadows(),), frozenset())
    assert len(calls) == 4
