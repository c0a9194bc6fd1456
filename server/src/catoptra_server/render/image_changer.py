"""Image effects on an exposed image: the protocol, and the effects' own formulas in NumPy.

Both renderers expose images; the native changer is `trace/kernel/kernel_image_changer`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Generic, Protocol, TypeVar

import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.renderer import Image, LinearImage
from catoptra_server.render.srgb_encoding import encode_srgb
from catoptra_server.world.world_description import srgb_from_linear

ImageT = TypeVar("ImageT")


@dataclass(frozen=True, slots=True, eq=False)
class ExposedImage:
    """An image before its effects."""

    light: LinearImage
    """(h, w, 3) linear light."""
    camera: RadialCamera
    context: CaptureContext


@dataclass(frozen=True, slots=True, eq=False)
class ChangedImage(Generic[ImageT]):
    """An image behind its effects."""

    image: ImageT
    """(h, w, 3), linear, or sRGB and read-only."""
    stage_ms: dict[str, float]
    """Milliseconds of each effect, and of the encoding."""
    changes: dict[str, float]
    """Largest change by effect, grey levels, of the effects with a threshold."""


class ImageChanger(Protocol):
    """Applies image effects in their order; thresholds are those of `renderer.View`."""

    @property
    def description(self) -> str:
        """What computes, for logs."""

    def change(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
    ) -> ChangedImage[LinearImage]:
        """Change an image in linear light."""

    def encode(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
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
        thresholds: Mapping[str, float],
    ) -> ChangedImage[LinearImage]:
        """Change an image everywhere."""
        light = exposed.light
        stage_ms: dict[str, float] = {}
        changes: dict[str, float] = {}
        for effect in effects:
            begin_s = time.perf_counter()
            before, light = light, effect.apply(light, exposed.camera, exposed.context)
            stage_ms[effect.name] = 1e3 * (time.perf_counter() - begin_s)
            if effect.name in thresholds:
                changes[effect.name] = measure_change(before, light)
        return ChangedImage(light, stage_ms, changes)

    def encode(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
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


def measure_change(before: LinearImage, after: LinearImage) -> float:
    """Largest change of any pixel between two linear images, encoded grey levels, not rounded."""
    levels = (srgb_from_linear(one.astype(np.float64)) for one in (before, after))
    return 255.0 * float(np.abs(np.subtract(*levels)).max())
