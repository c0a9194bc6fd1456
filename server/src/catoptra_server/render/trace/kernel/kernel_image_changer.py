"""Image effects by the kernel: one call for all, each with milliseconds of its own."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.kernels.luminance import count_valid_pixels
from catoptra_server.effects.kernels.noise import normal_quantile_table
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.render.renderer import LinearImage
from catoptra_server.render.trace.image_changer import (
    ChangedImage,
    EncodedImage,
    NumpyImageChanger,
)
from catoptra_server.render.trace.kernel.image_stages import MadeStage, make_stage
from catoptra_server.render.trace.kernel.kernel_library import KernelDevice
from catoptra_server.render.trace.kernel.kernel_structs import ImageJob, ImageStage
from catoptra_server.render.trace.srgb_encoding import srgb_table

_ALIGNMENT = 64
_NOISE_EFFECTS = frozenset({"ShotNoise", "ReadNoise"})


class KernelImageChanger:
    """Image effects on a kernel device; belongs to the thread of the renderer."""

    def __init__(self, device: KernelDevice) -> None:
        """Begin without memory to work in."""
        self._device = device
        self._numpy = NumpyImageChanger()
        self._scratch = np.zeros(0, dtype=np.uint8)

    @property
    def memory_bytes(self) -> int:
        """Size of the memory that images are changed in."""
        return self._scratch.nbytes

    def change(
        self,
        light: LinearImage,
        effects: tuple[ImageEffect, ...],
        camera: RadialCamera,
        context: CaptureContext,
        thresholds: Mapping[str, float],
    ) -> ChangedImage:
        """Change a linear image; cells that change by too little stay as they are."""
        result = np.zeros(light.shape, dtype=np.float32)
        stage_ms, changes, _ = self._run(
            light, effects, camera, context, thresholds, linear=result, rgb=None
        )
        return ChangedImage(result, stage_ms, changes)

    def encode(
        self,
        light: LinearImage,
        effects: tuple[ImageEffect, ...],
        camera: RadialCamera,
        context: CaptureContext,
        thresholds: Mapping[str, float],
    ) -> EncodedImage:
        """Change an image and encode it."""
        rgb = np.zeros(light.shape, dtype=np.uint8)
        stage_ms, changes, encode_ms = self._run(
            light, effects, camera, context, thresholds, linear=None, rgb=rgb
        )
        rgb.setflags(write=False)
        return EncodedImage(rgb, stage_ms | {"encode": encode_ms}, changes)

    def _run(
        self,
        light: LinearImage,
        effects: tuple[ImageEffect, ...],
        camera: RadialCamera,
        context: CaptureContext,
        thresholds: Mapping[str, float],
        *,
        linear: LinearImage | None,
        rgb: npt.NDArray[np.uint8] | None,
    ) -> tuple[dict[str, float], dict[str, float], float]:
        """Milliseconds and changes by effect, and the milliseconds of the encoding."""
        stage_ms: dict[str, float] = {}
        changes: dict[str, float] = {}
        made: list[tuple[str, MadeStage]] = []
        encode_ms = 0.0
        for effect in effects:
            stage = make_stage(effect, camera, context, thresholds.get(effect.name))
            if stage is not None:
                made.append((effect.name, stage))
                continue
            # In its place between native stages, so that the order stays.
            between = np.zeros(light.shape, dtype=np.float32)
            encode_ms += self._run_stages(light, made, camera, stage_ms, changes, between, None)
            changed = self._numpy.change(between, (effect,), camera, context, thresholds)
            light, made = np.ascontiguousarray(changed.light, dtype=np.float32), []
            stage_ms |= changed.stage_ms
            changes |= changed.changes
        encode_ms += self._run_stages(light, made, camera, stage_ms, changes, linear, rgb)
        return stage_ms, changes, encode_ms

    def _run_stages(
        self,
        light: LinearImage,
        made: Sequence[tuple[str, MadeStage]],
        camera: RadialCamera,
        stage_ms: dict[str, float],
        changes: dict[str, float],
        linear: LinearImage | None,
        rgb: npt.NDArray[np.uint8] | None,
    ) -> float:
        """Run native stages and note their results; the milliseconds of loading and storing."""
        stages = (ImageStage * max(1, len(made)))(*(stage.struct for _, stage in made))
        has_noise = any(name in _NOISE_EFFECTS for name, _ in made)
        job = ImageJob(
            width=light.shape[1],
            height=light.shape[0],
            light=light.ctypes.data,
            linear=None if linear is None else linear.ctypes.data,
            rgb=None if rgb is None else rgb.ctypes.data,
            srgb_table=srgb_table().ctypes.data,
            quantiles=normal_quantile_table().ctypes.data if has_noise else None,
            mirror_pixels=count_valid_pixels(camera),
            num_stages=len(made),
            stages=ctypes.addressof(stages),
        )
        job.scratch = self._reserve(self._device.image_scratch_bytes(job))
        self._device.change_image(job)
        for (name, _), stage in zip(made, stages, strict=False):
            stage_ms[name] = stage.ms
            if stage.threshold >= 0.0:
                changes[name] = stage.change
            if stage.threshold >= 0.0 and name == DefocusByDepth.name:
                changes[Defocus.name] = stage.other_change
        return float(job.encode_ms)

    def _reserve(self, size: int) -> int:
        """Address of memory of a size, kept for the next frames."""
        if len(self._scratch) < size + _ALIGNMENT:
            self._scratch = np.empty(size + _ALIGNMENT, dtype=np.uint8)
        return -(-self._scratch.ctypes.data // _ALIGNMENT) * _ALIGNMENT
