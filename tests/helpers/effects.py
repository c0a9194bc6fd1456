"""A test card in linear light, and how far an effect moves what is seen of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera, direction_from_pixel, pixel_centres
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects import EFFECTS
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import Effect
from catoptra_server.effects.frame_key import FrameKey
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.render.renderer import Exposure
from catoptra_server.scene.bodies import Body, body_mesh
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.description import Box, Material
from catoptra_server.scene.motion import Twist
from catoptra_server.scene.primitives import box
from helpers.worlds import VIEW, omni_camera

CAMERA = omni_camera(width_px=96)
KEY = FrameKey((7, 11), 3)
THRESHOLD = 0.5

# A camera that drives ahead and turns while another body crosses its way.
BODY = Body(
    body_mesh([(box(Box((0.4, 0.4, 0.4))), Material((0.5, 0.5, 0.5)))]),
    Pose.from_rpy((1.0, 0.5, -0.3)),
    Twist((0.0, -0.6, 0.0), (0.0, 0.0, 1.0)),
)
EXPOSURE = Exposure(
    VIEW.world_from_mirror, (BODY,), KEY, twist=Twist((0.5, 0.1, 0.0), (0.0, 0.0, 0.7))
)


def _ranges() -> npt.NDArray[np.float32]:
    """Return near and far, and nothing at all."""
    shape = (CAMERA.height_px, CAMERA.width_px)
    range_m = np.random.default_rng(6).uniform(0.3, 5.0, shape).astype(np.float32)
    range_m[:20] = np.inf
    return range_m


RANGES = _ranges()
CAPTURE = Capture(KEY, RANGES)


# The names of the effects that change the picture; the others change what there is to be seen.
PICTURE_EFFECTS = [
    kind.name
    for kind in EFFECTS
    if isinstance(kind.make(**{p.field: p.default for p in kind.parameters}), Effect)
]


def effect_of(name: str, changes: Mapping[str, float] | None = None) -> Effect:
    """Return an effect with the defaults of its keys; `changes` by field."""
    kind = next(kind for kind in EFFECTS if kind.name == name)
    fields = {p.field: p.default for p in kind.parameters} | dict(changes or {})
    effect = kind.make(**fields)
    assert isinstance(effect, Effect), f"{name} changes the scene, not the picture"
    return effect


def card(largest: float = 1.0, camera: OmniCamera = CAMERA) -> Floats:
    """Return (h, w, 3) light from 0 to `largest`: greys, dark ones finely, edges, and colours.

    Black where no mirror is seen, as every picture is.
    """
    height, width = camera.height_px, camera.width_px
    rng = np.random.default_rng(5)
    light = rng.uniform(0.0, 1.0, (height, width, 3)) ** 3
    light[: height // 3] = np.geomspace(1e-4, 1.0, width)[:, None]
    light[height // 2 : height // 2 + 6] = 1.0
    light[:, width // 2 : width // 2 + 2] = 0.0
    rim = direction_from_pixel(camera, pixel_centres(camera))[1]
    return largest * light * rim


def seen_change(effect: Effect, light: Floats, camera: OmniCamera = CAMERA) -> float:
    """Return by how many grey levels, not rounded, the pixel changes that changes most."""
    changed = effect.apply(light, camera, CAPTURE)
    return 255.0 * float(np.abs(srgb_from_linear(changed) - srgb_from_linear(light)).max())


def assert_left_out(effect: Effect, largest: float = 1.0, camera: OmniCamera = CAMERA) -> None:
    """Assert that the criterion calls an effect needless, and that nobody would have seen it."""
    bound = effect.bound(SceneSummary(largest), camera)
    assert bound.value <= THRESHOLD
    assert seen_change(effect, card(largest, camera), camera) <= bound.value + 1e-9


def assert_called_for(effect: Effect, largest: float = 1.0, camera: OmniCamera = CAMERA) -> None:
    """Assert that the criterion calls for an effect, that it is seen, and within its bound."""
    bound = effect.bound(SceneSummary(largest), camera)
    assert bound.value > THRESHOLD
    assert bound.reason
    change = seen_change(effect, card(largest, camera), camera)
    assert 0.5 * THRESHOLD < change <= bound.value * (1.0 + 1e-3)


def assert_summary_holds(effect: Effect, largest: float = 1.0) -> None:
    """Assert that no pixel behind an effect is brighter than its summary says."""
    behind = effect.apply(card(largest), CAMERA, CAPTURE)
    assert behind.max() <= effect.after(SceneSummary(largest)).largest_radiance + 1e-9
