"""A test card in linear light, and how far an effect moves what is seen of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.capture.noise_seed import NoiseSeed
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.dynamic_object import DynamicObject, build_object_mesh
from catoptra_server.scene.primitives import box
from catoptra_server.scene.twist import Twist
from catoptra_server.scene.world_description import Box, Material
from helpers.worlds import CAMERA_STATE, make_omni_camera

CAMERA = make_omni_camera(width_px=96)
NOISE_SEED = NoiseSeed((7, 11), 3)
THRESHOLD = 0.5

# A camera that drives ahead and turns while another body crosses its way.
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
    """Return near and far, and nothing at all."""
    shape = (CAMERA.height_px, CAMERA.width_px)
    range_m = np.random.default_rng(6).uniform(0.3, 5.0, shape).astype(np.float32)
    range_m[:20] = np.inf
    return range_m


RANGES = _ranges()
CAPTURE_CONTEXT = CaptureContext(NOISE_SEED, RANGES)


# The names of the effects that change the picture; the others change what there is to be seen.
IMAGE_EFFECTS = [
    kind.name
    for kind in EFFECT_TYPES
    if isinstance(kind.factory(**{p.field: p.default for p in kind.parameters}), ImageEffect)
]


def make_effect(name: str, changes: Mapping[str, float] | None = None) -> ImageEffect:
    """Return an effect with the defaults of its keys; `changes` by field."""
    kind = next(kind for kind in EFFECT_TYPES if kind.name == name)
    fields = {p.field: p.default for p in kind.parameters} | dict(changes or {})
    effect = kind.factory(**fields)
    assert isinstance(effect, ImageEffect), f"{name} changes the scene, not the picture"
    return effect


def make_test_pattern(max_radiance: float = 1.0, camera: OmniCamera = CAMERA) -> Floats:
    """Return (h, w, 3) light from 0 to `largest`: greys, dark ones finely, edges, and colours.

    Black where no mirror is seen, as every picture is.
    """
    height, width = camera.height_px, camera.width_px
    rng = np.random.default_rng(5)
    light = rng.uniform(0.0, 1.0, (height, width, 3)) ** 3
    light[: height // 3] = np.geomspace(1e-4, 1.0, width)[:, None]
    light[height // 2 : height // 2 + 6] = 1.0
    light[:, width // 2 : width // 2 + 2] = 0.0
    rim = direction_from_pixel(camera, pixel_sample_positions(camera))[1]
    return max_radiance * light * rim


def max_grey_level_change(effect: ImageEffect, light: Floats, camera: OmniCamera = CAMERA) -> float:
    """Return by how many grey levels, not rounded, the pixel changes that changes most."""
    changed = effect.apply(light, camera, CAPTURE_CONTEXT)
    return 255.0 * float(np.abs(srgb_from_linear(changed) - srgb_from_linear(light)).max())


def assert_effect_negligible(
    effect: ImageEffect, max_radiance: float = 1.0, camera: OmniCamera = CAMERA
) -> None:
    """Assert that the criterion calls an effect needless, and that nobody would have seen it."""
    bound = effect.bound(SceneSummary(max_radiance), camera)
    assert bound.value <= THRESHOLD
    assert (
        max_grey_level_change(effect, make_test_pattern(max_radiance, camera), camera)
        <= bound.value + 1e-9
    )


def assert_effect_not_negligible(
    effect: ImageEffect, max_radiance: float = 1.0, camera: OmniCamera = CAMERA
) -> None:
    """Assert that the criterion calls for an effect, that it is seen, and within its bound."""
    bound = effect.bound(SceneSummary(max_radiance), camera)
    assert bound.value > THRESHOLD
    assert bound.reason
    change = max_grey_level_change(effect, make_test_pattern(max_radiance, camera), camera)
    assert 0.5 * THRESHOLD < change <= bound.value * (1.0 + 1e-3)


def assert_summary_bounds_effect(effect: ImageEffect, max_radiance: float = 1.0) -> None:
    """Assert that no pixel behind an effect is brighter than its summary says."""
    behind = effect.apply(make_test_pattern(max_radiance), CAMERA, CAPTURE_CONTEXT)
    assert behind.max() <= effect.update_summary(SceneSummary(max_radiance)).max_radiance + 1e-9
