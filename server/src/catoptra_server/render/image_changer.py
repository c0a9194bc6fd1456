"""Image effects on an exposed image: the protocol of their appliers, and the one in NumPy.

An image effect is its float64 formula in `effects/`, which is its definition, and one native stage
(`trace/kernel/image.py`). Both renderers hand over an image in linear light: raster reads its own
back, since shaders with the same formulas took several times as long on llvmpipe. NumPy needs 36 ms
for the effects of the real camera; NumPy applies whatever has no stage, and everything where the
kernel cannot run.

Also sRGB bytes of linear light by a table, which NumPy and the kernel share: images behind effects
cost a look-up instead of a power. Float64 twin: `world/world_description.py:srgb_from_linear`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import cache
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import CaptureContext, EffectChange, ImageEffect, Threshold
from catoptra_server.render.renderer import Image, LinearImage
from catoptra_server.world.world_description import srgb_from_linear

_AUTO_EXPOSURE = "AutoExposure"
_ImageT = TypeVar("_ImageT")


@dataclass(frozen=True, slots=True, eq=False)
class ExposedImage:
    """An image before its effects."""

    light: LinearImage
    """(h, w, 3) linear light."""
    camera: RadialCamera
    context: CaptureContext


@dataclass(frozen=True, slots=True, eq=False)
class ChangedImage(Generic[_ImageT]):
    """An image behind its effects."""

    image: _ImageT
    """(h, w, 3), linear, or sRGB and read-only."""
    stage_ms: dict[str, float]
    """Milliseconds of each effect, and of the encoding; the kernel's are shares of its passes."""
    changes: dict[str, EffectChange]
    """Changes by the effects with a threshold; infinite if the effect is seen and nobody measured
    how much."""


class ImageChanger(Protocol):
    """Applies image effects in order; thresholds as of `renderer.View`."""

    @property
    def description(self) -> str:
        """What computes, for logs."""

    def change(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
    ) -> ChangedImage[LinearImage]:
        """Change an image in linear light."""

    def encode(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
    ) -> ChangedImage[Image]:
        """Change an image and encode it."""

    def close(self) -> None:
        """Free what belongs to this changer alone."""


class NumpyImageChanger:
    """Applies the effects' own formulas to whole images."""

    description = "NumPy"

    def change(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
    ) -> ChangedImage[LinearImage]:
        """Change an image everywhere."""
        light = exposed.light
        stage_ms: dict[str, float] = {}
        changes: dict[str, EffectChange] = {}
        for number, effect in enumerate(effects):
            begin_s = time.perf_counter()
            before, light = light, effect.apply(light, exposed.camera, exposed.context)
            stage_ms[effect.name] = 1e3 * (time.perf_counter() - begin_s)
            if effect.name in thresholds and thresholds[effect.name].is_measured:
                # Not loaded at the start of a server whose kernel measures.
                from catoptra_server.effects.kernels.grey_levels import measure_change

                after, threshold = light, thresholds[effect.name]
                rest = effects[number + 1 :]
                if any(one.name == _AUTO_EXPOSURE for one in rest):
                    # Behind all others, since the exposure takes back what all pixels share.
                    for one in rest:
                        before = one.apply(before, exposed.camera, exposed.context)
                        after = one.apply(after, exposed.camera, exposed.context)
                    threshold = Threshold(0.0)
                changes[effect.name] = measure_change(before, after, threshold)
        return ChangedImage(light, stage_ms, changes)

    def encode(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
    ) -> ChangedImage[Image]:
        """Change an image and encode it."""
        changed = self.change(exposed, effects, thresholds)
        begin_s = time.perf_counter()
        rgb = encode_srgb(changed.image)
        # Read-only, as the engine's frames: callers may keep both without a copy.
        rgb.setflags(write=False)
        stage_ms = changed.stage_ms | {"encode": 1e3 * (time.perf_counter() - begin_s)}
        return ChangedImage(rgb, stage_ms, changed.changes)

    def close(self) -> None:
        """Free nothing."""


def narrow_thresholds(
    thresholds: Mapping[str, Threshold],
    effects: tuple[ImageEffect, ...],
    camera: RadialCamera,
    sample_light: Callable[[], tuple[LinearImage, float]],
) -> Mapping[str, Threshold]:
    """Thresholds by the gain that a frame's light gives to its automatic exposure, if it has one.

    Args:
        thresholds: Thresholds for any gain within the control's limits.
        effects: Image effects of the frame.
        camera: Camera of the frame.
        sample_light: Light that reaches the first effect, in a part of the pixels and black in the
            others; and the number of all over the number of these.
    """
    if not any(effect.name == _AUTO_EXPOSURE for effect in effects):
        return thresholds
    # Loaded with the effect itself.
    from catoptra_server.effects.kernels.grey_levels import mean_luminance
    from catoptra_server.effects.sensor.auto_exposure import expect_gain

    light, factor = sample_light()
    return expect_gain(thresholds, effects, factor * mean_luminance(light, camera))


_MAX_LEVEL = 2**16 - 1
"""Level of white: a level is a 20th of a grey even in the curve's steepest part (12.92 * 255)."""


def encode_srgb(light: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """uint8 sRGB of linear light, clipped to [0, 1]; black for NaN."""
    # Black for NaN: fmax prefers numbers.
    clipped = np.minimum(np.fmax(light, np.float32(0.0)), np.float32(1.0))
    levels = (clipped * np.float32(_MAX_LEVEL) + np.float32(0.5)).astype(np.int32)
    return srgb_table().take(levels)


@cache
def srgb_table() -> npt.NDArray[np.uint8]:
    """(_MAX_LEVEL + 1,) sRGB greys of evenly spaced light from 0 to 1."""
    linear = np.arange(_MAX_LEVEL + 1) / _MAX_LEVEL
    encoded = np.rint(255.0 * srgb_from_linear(linear)).astype(np.uint8)
    # Shared by all views and by the kernel.
    encoded.setflags(write=False)
    return encoded
