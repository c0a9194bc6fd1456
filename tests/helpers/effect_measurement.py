"""Test pattern in linear radiance, and the change that an effect makes in the encoded pattern."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import (
    EFFECT_TYPES,
    CaptureContext,
    Effect,
    ImageEffect,
    SceneSummary,
    is_image_effect,
)
from catoptra_server.world.objects import CameraState, DynamicObject, NoiseSeed, build_object_mesh
from catoptra_server.world.shading import OcclusionMap
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import Box, Material, Twist, srgb_from_linear
from helpers.worlds import CAMERA_STATE, make_omni_camera

CAMERA = make_omni_camera(width_px=96)
NOISE_SEED = NoiseSeed((7, 11), 3)
THRESHOLD = 0.5

# A camera that drives ahead and turns while another object crosses its path: every scene effect
# has work to do.
DYNAMIC_OBJECT = DynamicObject(
    build_object_mesh([(box(Box((0.4, 0.4, 0.4))), Material((0.5, 0.5, 0.5)))]),
    Pose.from_rpy((1.0, 0.5, -0.3)),
    Twist((0.0, -0.6, 0.0), (0.0, 0.0, 1.0)),
)
DRIVING_STATE = CameraState(
    CAMERA_STATE.world_from_mirror,
    (DYNAMIC_OBJECT,),
    NOISE_SEED,
    twist=Twist((0.5, 0.1, 0.0), (0.0, 0.0, 0.7)),
)


def _ranges() -> npt.NDArray[np.float32]:
    """Ranges near and far, and rows of background, (h, w)."""
    shape = (CAMERA.height_px, CAMERA.width_px)
    range_m = np.random.default_rng(6).uniform(0.3, 5.0, shape).astype(np.float32)
    range_m[:20] = np.inf
    return range_m


RANGES = _ranges()
CAPTURE_CONTEXT = CaptureContext(NOISE_SEED, RANGES)


def make_any_effect(name: str, changes: Mapping[str, float] | None = None) -> Effect:
    """Effect with the defaults of its keys; `changes` by field."""
    effect_type = EFFECT_TYPES[name]
    fields = {p.field: p.default for p in effect_type.parameters} | dict(changes or {})
    return effect_type.factory(**fields)


# Names of the effects that change the image; the others change the scene.
IMAGE_EFFECTS = [
    effect_type.name
    for effect_type in EFFECT_TYPES.values()
    if is_image_effect(make_any_effect(effect_type.name))
]


def make_effect(name: str, changes: Mapping[str, float] | None = None) -> ImageEffect:
    """Image effect with the defaults of its keys; `changes` by field."""
    effect = make_any_effect(name, changes)
    assert is_image_effect(effect), f"{name} changes the scene, not the image"
    return effect


def make_test_pattern(max_radiance: float = 1.0, camera: OmniCamera = CAMERA) -> Floats:
    """Radiance from 0 to `max_radiance`, (h, w, 3): greys, fine in the dark, edges, and colours.

    Black outside the mirror, as every image is.
    """
    height, width = camera.height_px, camera.width_px
    rng = np.random.default_rng(5)
    radiance = rng.uniform(0.0, 1.0, (height, width, 3)) ** 3
    radiance[: height // 3] = np.geomspace(1e-4, 1.0, width)[:, None]
    radiance[height // 2 : height // 2 + 6] = 1.0
    radiance[:, width // 2 : width // 2 + 2] = 0.0
    on_mirror = direction_from_pixel(camera, pixel_sample_positions(camera))[1]
    return max_radiance * radiance * on_mirror


def max_grey_level_change(effect: ImageEffect, image: Floats, camera: OmniCamera = CAMERA) -> float:
    """Change, in grey levels, not rounded, of the pixel that changes most."""
    changed = effect.apply(image, camera, CAPTURE_CONTEXT)
    return 255.0 * float(np.abs(srgb_from_linear(changed) - srgb_from_linear(image)).max())


def assert_effect_negligible(
    effect: ImageEffect, max_radiance: float = 1.0, camera: OmniCamera = CAMERA
) -> None:
    """Assert that the criterion leaves an effect out, and that the change would be invisible."""
    bound = effect.bound(SceneSummary(max_radiance), camera)
    assert bound.value <= THRESHOLD
    assert (
        max_grey_level_change(effect, make_test_pattern(max_radiance, camera), camera)
        <= bound.value + 1e-9
    )


def assert_effect_not_negligible(
    effect: ImageEffect, max_radiance: float = 1.0, camera: OmniCamera = CAMERA
) -> None:
    """Assert that the criterion enables an effect with a visible change below the bound."""
    bound = effect.bound(SceneSummary(max_radiance), camera)
    assert bound.value > THRESHOLD
    assert bound.reason
    change = max_grey_level_change(effect, make_test_pattern(max_radiance, camera), camera)
    assert 0.5 * THRESHOLD < change <= bound.value * (1.0 + 1e-3)


def assert_summary_bounds_effect(effect: ImageEffect, max_radiance: float = 1.0) -> None:
    """Assert that no pixel behind an effect is brighter than the effect's summary."""
    behind = effect.apply(make_test_pattern(max_radiance), CAMERA, CAPTURE_CONTEXT)
    assert behind.max() <= effect.update_summary(SceneSummary(max_radiance)).max_radiance + 1e-9


def assert_criterion(
    *, off: Iterable[tuple[ImageEffect, float]], on: Iterable[tuple[ImageEffect, float]]
) -> None:
    """Assert that a criterion leaves out what would be invisible, and enables what shows.

    Args:
        off: effects that are left out, each with the largest radiance.
        on: effects that are enabled, whose summaries hold, too.
    """
    for effect, max_radiance in off:
        assert_effect_negligible(effect, max_radiance)
    for effect, max_radiance in on:
        assert_effect_not_negligible(effect, max_radiance)
        for factor in (1.0, 1.5, 2.0):
            assert_summary_bounds_effect(effect, factor * max_radiance)


def make_baked_map(light: tuple[float, float, float]) -> OcclusionMap:
    """Baked light of one surface: least, mean and largest irradiance over that of an open one."""
    ranges = np.array([[[one] * 3] for one in light])
    rows, bounds = np.zeros((1, 4)), np.array([[0, 0, 1, 1]], dtype=np.int32)
    texels = np.arange(48, dtype=np.uint16).reshape(3, 4, 4)
    return OcclusionMap(np.zeros(1, dtype=np.int32), rows, rows, bounds, texels, ranges)
