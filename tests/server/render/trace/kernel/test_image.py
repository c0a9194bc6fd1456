"""Stages of the kernel against the formulas of their effects."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects import VISIBLE_LEVELS, CaptureContext, ImageEffect, Threshold
from catoptra_server.effects.kernels.grey_levels import find_changes, measure_change
from catoptra_server.render.image_changer import ExposedImage, NumpyImageChanger
from catoptra_server.render.renderer import LinearImage
from catoptra_server.render.trace.kernel.image import STAGE_MAKERS, KernelImageChanger
from catoptra_server.render.trace.kernel.library import (
    KernelDevice,
    KernelError,
    available_instruction_sets,
    choose_instruction_set,
)
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    IMAGE_EFFECTS,
    NOISE_SEED,
    make_effect,
)
from helpers.worlds import make_omni_camera


@pytest.mark.parametrize("name", STAGE_MAKERS)
def test_maps_of_a_camera_are_made_once(name: str) -> None:
    effect = make_effect(name)
    exposed = ExposedImage(np.zeros((96, 96, 3), dtype=np.float32), CAMERA, CAPTURE_CONTEXT)
    one, other = (STAGE_MAKERS[name](effect, exposed) for _ in range(2))
    assert list(one.struct.maps) == list(other.struct.maps)


NUMPY = NumpyImageChanger()
# Parameters with which each effect changes much.
STRONG = {
    "ChromaticAberration": {"red_magnification": 1.01, "blue_magnification": 0.99},
    "Misalignment": {"x_m": 1e-3, "y_m": -5e-4},
    "Exposure": {"exposure_s": 0.02},
    "WhiteBalance": {"red_gain": 1.4, "blue_gain": 0.7},
    "Response": {"knee": 0.3, "white": 2.0, "curve": ((0.0, 0.0), (0.4, 180.0), (2.0, 255.0))},
    "Blooming": {"overflow_fraction": 0.5, "length_px": 11.0},
    "Defocus": {"f_number": 1.4},
    "DefocusByDepth": {"f_number": 1.4},
    "Diffraction": {"f_number": 22.0},
    "Quantisation": {"adc_bits": 6.0},
}
# Sides that are no multiples of a cell's, and images smaller than a kernel.
SIZES = ((96, 96), (97, 71), (33, 130), (5, 3), (1, 1), (16, 8))
# The converter's codes: a value between two of them may fall to either side.
CODE = {"Quantisation": 1.01 / 63.0}


@pytest.fixture(params=[1, 2, 3], ids=lambda threads: f"{threads} threads", scope="module")
def changer(request: pytest.FixtureRequest) -> Iterator[KernelImageChanger]:
    device = KernelDevice(choose_instruction_set(), request.param)
    yield KernelImageChanger(device)
    device.close()


def camera_of_size(width: int, height: int) -> OmniCamera:
    camera = make_omni_camera(width_px=max(width, height))
    return replace(
        camera, width_px=width, height_px=height, centre_px=(0.5 * width + 0.3, 0.5 * height)
    )


def make_images(camera: OmniCamera) -> Iterator[LinearImage]:
    """Noise with flat parts, saturated columns, black and white."""
    rng = np.random.default_rng(3)
    height, width = camera.height_px, camera.width_px
    image = (rng.uniform(0.0, 1.2, (height, width, 3)) ** 3).astype(np.float32)
    image[: height // 2, : width // 2] = 0.25
    image[:, 3 * width // 4] = 9.0
    image[height // 3 :, width // 5 : width // 4] = 0.0
    yield image
    yield np.zeros_like(image)
    yield np.full_like(image, 1.0)


def make_context(camera: OmniCamera) -> CaptureContext:
    rng = np.random.default_rng(4)
    range_m = rng.uniform(0.15, 4.0, (camera.height_px, camera.width_px)).astype(np.float32)
    range_m[::7] = np.inf
    return CaptureContext(NOISE_SEED, range_m)


def make_strong(name: str) -> ImageEffect:
    return make_effect(name, STRONG.get(name))


def test_every_image_effect_has_native_code() -> None:
    assert set(STAGE_MAKERS) == set(IMAGE_EFFECTS)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("name", STAGE_MAKERS)
def test_stage_agrees_with_the_effects_formula(
    changer: KernelImageChanger, name: str, size: tuple[int, int]
) -> None:
    camera, effect = camera_of_size(*size), make_strong(name)
    context = make_context(camera)
    for image in make_images(camera):
        native = changer.change(ExposedImage(image, camera, context), (effect,), {})
        expected = effect.apply(image.astype(np.float64), camera, context)
        limit = CODE.get(name, 3e-6 * max(1.0, float(image.max())))
        np.testing.assert_allclose(native.image, expected, rtol=3e-6, atol=limit)
        assert native.changes == {}
        assert list(native.stage_ms) == [name]


@pytest.mark.parametrize("name", STAGE_MAKERS)
@pytest.mark.parametrize("threshold", [0.5, 20.0])
def test_threshold_leaves_cells_plain_by_no_more_than_itself(
    changer: KernelImageChanger, name: str, threshold: float
) -> None:
    camera, effect = camera_of_size(97, 71), make_effect(name, STRONG.get(name))
    context = make_context(camera)
    for image in make_images(camera):
        everywhere = changer.change(ExposedImage(image, camera, context), (effect,), {}).image
        native = changer.change(
            ExposedImage(image, camera, context), (effect,), {name: Threshold(threshold)}
        )
        assert measure_change(everywhere, native.image).largest <= threshold
        # That of what was drawn, or the bound of a cell that stayed plain.
        if name != "DefocusByDepth":
            measured, found = (
                measure_change(image, everywhere).largest,
                native.changes[name].largest,
            )
            assert measured - 0.02 <= found <= max(measured + 0.02, threshold)


@pytest.mark.parametrize("name", STAGE_MAKERS)
@pytest.mark.parametrize(
    "allowed", [Threshold(255.0, visible_share=0.999), Threshold(0.0), Threshold(8.0)]
)
def test_stage_counts_the_pixels_that_change_visibly(
    changer: KernelImageChanger, name: str, allowed: Threshold
) -> None:
    camera, effect = camera_of_size(97, 71), make_strong(name)
    context = make_context(camera)
    for image in make_images(camera):
        exposed = ExposedImage(image, camera, context)
        everywhere = changer.change(exposed, (effect,), {}).image
        found = changer.change(exposed, (effect,), {name: allowed}).changes
        expected = measure_change(image, everywhere)
        one = found["Defocus" if name == "DefocusByDepth" else name]
        # Once an effect is on, the rest is not counted. Changes are known to 0.01 of a level.
        share = expected.visible_share if allowed.covers(one) else 1.0
        # Cells that stay plain by a bound above half a level count as a whole.
        if expected.largest > 0.5 and allowed.max_change != 8.0:
            assert one.visible_share == pytest.approx(share, abs=6 / (97 * 71))
        assert one.visible_share >= expected.visible_share - 6 / (97 * 71)


@pytest.mark.parametrize("name", ["Vignetting", "Exposure", "ChromaticAberration", "Diffraction"])
def test_change_of_light_above_the_well_counts_what_spills_over_beside(
    changer: KernelImageChanger, name: str
) -> None:
    camera, effect = camera_of_size(97, 71), make_effect(name, STRONG.get(name))
    blooming = make_effect("Blooming", {"overflow_fraction": 0.5})
    context = make_context(camera)
    bright = np.zeros((71, 97, 3), dtype=np.float32)
    bright[20:50, 30:60] = np.linspace(3.0, 4.0, 30, dtype=np.float32)[:, None]
    exposed = ExposedImage(bright, camera, context)
    for levels in (0.0, 20.0):
        threshold = Threshold(levels, (1.0, 1.5), 1.0, (1.0, 0.5))
        native = changer.change(exposed, (effect,), {name: threshold})
        change = native.changes[name].largest
        with_it = changer.change(exposed, (effect, blooming), {}).image
        without = changer.change(exposed, (blooming,), {}).image
        plain = blooming.apply(native.image, camera, context)
        assert measure_change(without, plain).largest <= change + 0.02
        assert measure_change(with_it, plain).largest <= levels + 0.02


@pytest.mark.parametrize(
    ("names", "spared"),
    [
        (("Vignetting",), 3.0),
        (("MirrorReflectance", "Vignetting"), 3.0),
        (("Diffraction",), 1.3),
        (("Exposure",), 1.1),
    ],
)
def test_overflow_of_a_drawn_sensor_counts_where_it_falls_and_by_what_changes(
    changer: KernelImageChanger, names: tuple[str, ...], spared: float
) -> None:
    camera = camera_of_size(97, 71)
    blooming = make_effect("Blooming", {"overflow_fraction": 0.1})
    effects = tuple(make_effect(name, STRONG.get(name)) for name in names)
    context = make_context(camera)
    # A bright field above one in daylight, and black beside that nothing spills into.
    light = np.zeros((71, 97, 3), dtype=np.float32)
    light[:30, 20:80], light[30:, 20:80] = 1.6, 0.5
    exposed = ExposedImage(light, camera, context)
    threshold = Threshold(255.0, (1.0, 1.0), 0.999, (1.0, 0.1))
    thresholds = dict.fromkeys(names, threshold)
    alone = changer.change(exposed, effects, thresholds).changes
    found = changer.change(exposed, (*effects, blooming), thresholds).changes
    for index, effect in enumerate(effects):
        rest = (*effects[index + 1 :], blooming)
        before = changer.change(exposed, effects[:index], {}).image if index else light
        pair = (
            changer.change(ExposedImage(before, camera, context), chain, {}).image
            for chain in ((effect, *rest), rest)
        )
        true = measure_change(*pair)
        stated = found[effect.name]
        assert true.largest <= stated.largest + 0.02
        assert true.visible_share <= stated.visible_share + 6 / (97 * 71)
        assert spared * stated.largest < alone[effect.name].largest


@pytest.mark.parametrize("brightest", [0.8, 0.999, 1.2, 9.0])
def test_overflow_that_known_gains_rule_out_changes_no_bit(
    changer: KernelImageChanger, brightest: float
) -> None:
    camera = camera_of_size(97, 71)
    names = ("Diffraction", "MirrorDust", "Vignetting", "Blooming", "FixedPattern", "Bayer")
    effects = tuple(make_strong(name) for name in names)
    light = np.zeros((71, 97, 3), dtype=np.float32)
    light[20:50, 30:60] = np.linspace(0.1, 0.8, 30, dtype=np.float32)[:, None]
    light[40, 45] = brightest
    exposed = ExposedImage(light, camera, make_context(camera))
    known = Threshold(-1.0, (0.0, 1.0), 1.0, (1.0, 0.5))
    measured = Threshold(0.0, (0.0, 1.0))
    found = changer.change(exposed, effects, dict.fromkeys(names, known) | {"Blooming": measured})
    np.testing.assert_array_equal(found.image, changer.change(exposed, effects, {}).image)
    spread = changer.change(exposed, effects[:3], {}).image
    assert (found.changes["Blooming"].largest > 0.0) == bool((spread > 1.0).any())


def test_blur_by_range_is_measured_against_the_disc_of_infinity(
    changer: KernelImageChanger,
) -> None:
    camera = camera_of_size(160, 160)
    by_depth, fixed = make_strong("DefocusByDepth"), make_strong("Defocus")
    context = make_context(camera)
    image = next(make_images(camera))
    native = changer.change(
        ExposedImage(image, camera, context), (by_depth,), {"DefocusByDepth": Threshold(0.0)}
    )
    far = fixed.apply(image, camera, context)
    near = by_depth.apply(image, camera, context)
    assert native.changes["DefocusByDepth"].largest == pytest.approx(
        measure_change(far, near).largest, abs=0.05
    )
    assert native.changes["Defocus"].largest == pytest.approx(
        measure_change(image, near).largest, abs=0.05
    )


@pytest.mark.parametrize("limit", [0.5, 1.0])
def test_blur_by_range_counts_what_the_lens_leaves_of_its_change(
    changer: KernelImageChanger, limit: float
) -> None:
    camera = camera_of_size(160, 120)
    context = make_context(camera)
    context.range_m[:60] = context.range_m[:, :80] = np.inf  # type: ignore[index]
    names = ("Misalignment", "ChromaticAberration", "Diffraction", "MirrorDust", "Vignetting")
    lens = [make_strong(one) for one in (*names, "FixedPattern", "Bayer")]
    noise = [make_effect(one) for one in ("ShotNoise", "ReadNoise", "Quantisation")]
    by_depth, image = make_effect("DefocusByDepth"), next(make_images(camera))
    exposed = ExposedImage(image, camera, context)
    allowed = {"DefocusByDepth": Threshold(limit, has_mosaic=True)}
    alone = changer.change(exposed, (by_depth,), allowed).changes["DefocusByDepth"].largest
    effects = (by_depth, *lens[:-1], *noise, lens[-1])
    stated = changer.change(exposed, effects, allowed).changes["DefocusByDepth"].largest
    true = measure_change(
        *(
            NUMPY.change(exposed, (first, *lens), {}).image
            for first in (by_depth, make_effect("Defocus"))
        )
    ).largest
    # What counts as little where it acts counts there; anything else behind the lens.
    assert true <= stated <= max(limit, true + 0.3)
    assert limit < 1.5 * stated < alone
    # Beside the truth: behind the lens factors count by pixel, and the colours that are kept.
    unknown = {"Diffraction": Threshold(-1.0, (0.5, 1.2)), "FixedPattern": Threshold(-1.0)}
    for difference, is_off in ((0.01, True), (-0.01, False)):
        threshold = Threshold(true + difference, (0.5, 1.2), has_mosaic=True)
        known = {"DefocusByDepth": threshold, **unknown}
        found = changer.change(exposed, effects, known).changes["DefocusByDepth"].largest
        assert (found <= threshold.max_change) == is_off


@pytest.mark.parametrize(
    "names",
    [
        ("Diffraction", "Vignetting", "AutoExposure", "Bayer"),
        ("Diffraction", "Vignetting", "Exposure", "Blooming", "Bayer", "WhiteBalance", "Response"),
        ("Misalignment", "MirrorHolder", "VeilingGlare", "AutoExposure", "Bayer", "WhiteBalance"),
    ],
)
def test_blur_by_range_counts_what_sensor_and_response_leave_of_its_change(
    changer: KernelImageChanger, names: tuple[str, ...]
) -> None:
    camera = camera_of_size(160, 120)
    context = make_context(camera)
    context.range_m[:60] = context.range_m[:, :80] = np.inf  # type: ignore[index]
    effects = tuple(map(make_effect, ("DefocusByDepth", *names)))
    exposed = ExposedImage(next(make_images(camera)), camera, context)
    pair = (
        NUMPY.change(exposed, (first, *effects[1:]), {}).image
        for first in (effects[0], make_effect("Defocus"))
    )
    true = measure_change(*pair).largest
    for factor, is_off in ((1.25, True), (0.95, False)):
        # As of a control whose gain nobody knows.
        allowed = {"DefocusByDepth": Threshold(factor * true, (0.1, 10.0), has_mosaic=True)}
        found = changer.change(exposed, effects, allowed).changes["DefocusByDepth"].largest
        assert (found <= factor * true) == is_off


def test_all_effects_in_one_call_are_the_effects_one_by_one(changer: KernelImageChanger) -> None:
    camera = camera_of_size(97, 71)
    context, image = make_context(camera), next(make_images(camera))
    effects = tuple(make_effect(name) for name in STAGE_MAKERS if name != "Defocus")
    native = changer.encode(ExposedImage(image, camera, context), effects, {})
    expected = NUMPY.encode(ExposedImage(image, camera, context), effects, {})
    difference = np.abs(native.image.astype(np.int64) - expected.image.astype(np.int64))
    # A value beside a code of the converter, or beside half a grey, may fall to either side.
    assert difference.max() <= 3
    assert (difference > 0).mean() < 0.01
    assert list(native.stage_ms) == [*(effect.name for effect in effects), "encode"]
    assert not native.image.flags.writeable


class Darker:
    """An effect that the kernel does not know."""

    name = "Darker"

    def apply(self, image: LinearImage, camera: OmniCamera, context: CaptureContext) -> LinearImage:
        return image * image.dtype.type(0.5)


def test_effect_without_native_code_is_applied_in_its_place(changer: KernelImageChanger) -> None:
    camera = camera_of_size(33, 130)
    context, image = make_context(camera), next(make_images(camera))
    effects = (make_strong("Vignetting"), Darker(), make_strong("Blooming"))
    thresholds = dict.fromkeys(("Vignetting", "Darker", "Blooming"), Threshold(0.0))
    native = changer.change(ExposedImage(image, camera, context), effects, thresholds)  # type: ignore[arg-type]
    expected = NUMPY.change(ExposedImage(image, camera, context), effects, thresholds)  # type: ignore[arg-type]
    np.testing.assert_allclose(native.image, expected.image, rtol=1e-5, atol=1e-6)
    assert list(native.stage_ms) == ["Vignetting", "Darker", "Blooming"]
    for name, change in native.changes.items():
        assert change.largest == pytest.approx(expected.changes[name].largest, abs=0.02)


@pytest.mark.parametrize("has_mosaic", [True, False])
def test_changes_and_images_do_not_depend_on_threads_and_processor(has_mosaic: bool) -> None:
    camera = camera_of_size(97, 71)
    context, image = make_context(camera), next(make_images(camera))
    skipped = {"Defocus"} if has_mosaic else {"Defocus", "Bayer"}
    effects = tuple(make_effect(name) for name in STAGE_MAKERS if name not in skipped)
    # Counted to the end, up to a limit, and ended by the largest change.
    allowed = Threshold(255.0, visible_share=0.99), Threshold(255.0, visible_share=0.1)
    rules = (*allowed, Threshold(0.5))
    thresholds = {effect.name: rules[i % 3] for i, effect in enumerate(effects)}
    results = []
    for threads, instruction_set in product((1, 2, 3), available_instruction_sets()):
        device = KernelDevice(instruction_set, threads)
        changed = KernelImageChanger(device).change(
            ExposedImage(image, camera, context), effects, thresholds
        )
        results.append((changed.image.tobytes(), changed.changes))
        device.close()
    assert all(one == results[0] for one in results)


def keep_mosaic(image: LinearImage) -> LinearImage:
    """Light of the colour that each pixel measures, (h, w)."""
    raw = image[..., 1].copy()
    raw[::2, ::2], raw[1::2, 1::2] = image[::2, ::2, 0], image[1::2, 1::2, 2]
    return raw


def test_stages_before_a_mosaic_are_measured_in_the_colours_that_it_keeps(
    changer: KernelImageChanger,
) -> None:
    camera = camera_of_size(97, 71)
    context, light = make_context(camera), next(make_images(camera))
    effects = tuple(map(make_strong, ("Exposure", "FixedPattern", "ShotNoise", "Bayer")))
    threshold = Threshold(255.0, (0.5, 1.0))
    thresholds = {effect.name: threshold for effect in effects}
    native = changer.change(ExposedImage(light, camera, context), effects, thresholds)
    for effect in effects[:-1]:
        before, light = light, effect.apply(light, camera, context)
        raw = (keep_mosaic(one)[..., None] for one in (before, light))
        kept = measure_change(*raw, replace(threshold, has_mosaic=True))
        found = native.changes[effect.name]
        assert found.largest == pytest.approx(kept.largest, abs=0.02)
        assert found.visible_share == pytest.approx(kept.visible_share, abs=6 / (97 * 71))


# A lens's effect, of which the pass before knows three colours, and a sensor's.
@pytest.mark.parametrize("name", ["ChromaticAberration", "Exposure", "ReadNoise"])
@pytest.mark.parametrize("is_native", [True, False])
def test_share_of_pixels_before_a_mosaic_is_not_below_that_behind_it(
    changer: KernelImageChanger, name: str, is_native: bool
) -> None:
    camera, mosaic = camera_of_size(97, 71), make_effect("Bayer")
    effect = make_effect(name, STRONG.get(name))
    context, rng = make_context(camera), np.random.default_rng(8)
    for fraction, brightest in ((0.01, 1.0), (0.1, 0.02), (0.6, 0.02)):
        is_lit = rng.uniform(size=(71, 97, 1)) < fraction
        light = (is_lit * rng.uniform(0.0, brightest, (71, 97, 3))).astype(np.float32)
        exposed = ExposedImage(light, camera, context)
        threshold = Threshold(255.0, visible_share=0.9999, has_mosaic=True)
        applied = changer if is_native else NUMPY
        stated = applied.change(exposed, (effect, mosaic), {name: threshold}).changes[name]
        with_it = changer.change(exposed, (effect, mosaic), {}).image
        without = changer.change(exposed, (mosaic,), {}).image
        levels = find_changes(with_it, without, (1.0, 1.0)).max(axis=-1)
        true_share = (levels > VISIBLE_LEVELS).mean()
        assert true_share <= stated.visible_share <= 9.0 * true_share + 0.02


@pytest.mark.parametrize("threshold", [0.5, 255.0])
def test_mosaic_behind_other_stages_is_measured_up_to_its_threshold(
    changer: KernelImageChanger, threshold: float
) -> None:
    camera = camera_of_size(97, 71)
    exposed = ExposedImage(next(make_images(camera)), camera, make_context(camera))
    effects = tuple(map(make_strong, ("Vignetting", "ShotNoise", "Bayer")))
    native = changer.change(exposed, effects, {"Bayer": Threshold(threshold)})
    expected = NUMPY.change(exposed, effects, {"Bayer": Threshold(threshold)}).changes["Bayer"]
    exact = pytest.approx(expected.largest, abs=0.02)
    assert expected.largest > 0.5
    found = native.changes["Bayer"].largest
    assert found == (exact if expected.largest <= threshold else math.inf)


def test_stages_share_the_time_of_their_pass(changer: KernelImageChanger) -> None:
    camera = camera_of_size(97, 71)
    exposed = ExposedImage(next(make_images(camera)), camera, make_context(camera))
    effects = tuple(map(make_strong, ("MirrorReflectance", "Vignetting", "ReadNoise")))
    stage_ms = changer.encode(exposed, effects, {}).stage_ms
    assert stage_ms["Vignetting"] == stage_ms["MirrorReflectance"] > 0.0
    assert stage_ms["ReadNoise"] == pytest.approx(3.0 * stage_ms["Vignetting"])


def test_changer_with_a_device_of_its_own_changes_images_until_it_is_closed() -> None:
    camera = camera_of_size(33, 130)
    exposed = ExposedImage(next(iter(make_images(camera))), camera, CaptureContext(NOISE_SEED))
    effects = (make_effect("Vignetting"),)
    changer = KernelImageChanger.open(2)
    changed = changer.change(exposed, effects, {}).image
    changer.close()
    np.testing.assert_allclose(changed, NUMPY.change(exposed, effects, {}).image, atol=1e-5)
    with pytest.raises(KernelError, match="closed"):
        changer.change(exposed, effects, {})
