"""Image effects by the kernel: one call for all, each with milliseconds of its own."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.kernels.luminance import count_valid_pixels
from catoptra_server.effects.kernels.noise import normal_quantile_table
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.render.image_changer import (
    ChangedImage,
    ExposedImage,
    NumpyImageChanger,
)
from catoptra_server.render.renderer import Image, LinearImage
from catoptra_server.render.srgb_encoding import srgb_table
from catoptra_server.render.trace.kernel.image_stages import MadeStage, make_stage
from catoptra_server.render.trace.kernel.instruction_sets import AUTO, choose_instruction_set
from catoptra_server.render.trace.kernel.kernel_library import KernelDevice
from catoptra_server.render.trace.kernel.kernel_structs import ImageJob, ImageStage

_ALIGNMENT = 64
_NOISE_EFFECTS = frozenset({"ShotNoise", "ReadNoise"})


@dataclass(slots=True, eq=False)
class _Run:
    """One image on its way through its effects, and the results so far."""

    exposed: ExposedImage
    thresholds: Mapping[str, float]
    stage_ms: dict[str, float] = field(default_factory=dict)
    changes: dict[str, float] = field(default_factory=dict)
    layout_ms: float = 0.0
    """Milliseconds of the encoding, and of the change of the arrays' layout."""


def open_image_changer(threads: int, instruction_set: str = AUTO) -> KernelImageChanger:
    """Image changer on a device of its own, for images that others expose.

    Args:
        threads: Threads, the calling one included.
        instruction_set: As Embree names it; "auto" for the processor's best.

    Raises:
        KernelUnavailableError: The kernel's or Embree's library is missing.
    """
    return KernelImageChanger(KernelDevice(choose_instruction_set(instruction_set), threads))


class KernelImageChanger:
    """Image effects on a kernel device; belongs to the thread of the renderer."""

    description = "the native kernel"

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
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
    ) -> ChangedImage[LinearImage]:
        """Change an image; cells that change by too little stay as they are."""
        run = _Run(exposed, thresholds)
        result = np.zeros(exposed.light.shape, dtype=np.float32)
        self._apply(run, effects, result)
        return ChangedImage(result, run.stage_ms, run.changes)

    def encode(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, float],
    ) -> ChangedImage[Image]:
        """Change an image and encode it."""
        run = _Run(exposed, thresholds)
        rgb = np.zeros(exposed.light.shape, dtype=np.uint8)
        self._apply(run, effects, rgb)
        rgb.setflags(write=False)
        return ChangedImage(rgb, run.stage_ms | {"encode": run.layout_ms}, run.changes)

    def _apply(
        self, run: _Run, effects: tuple[ImageEffect, ...], result: LinearImage | Image
    ) -> None:
        """Apply effects into an image of float32, or of uint8 for an encoded one."""
        made: list[tuple[str, MadeStage]] = []
        for effect in effects:
            exposed, threshold = run.exposed, run.thresholds.get(effect.name)
            stage = make_stage(effect, exposed.camera, exposed.context, threshold)
            if stage is not None:
                made.append((effect.name, stage))
                continue
            # In its place between native stages, so that the order stays.
            between = np.zeros(exposed.light.shape, dtype=np.float32)
            self._run_stages(run, made, between)
            made = []
            exposed = replace(exposed, light=between)
            changed = self._numpy.change(exposed, (effect,), run.thresholds)
            light = np.ascontiguousarray(changed.image, dtype=np.float32)
            run.exposed = replace(exposed, light=light)
            run.stage_ms |= changed.stage_ms
            run.changes |= changed.changes
        self._run_stages(run, made, result)

    def _run_stages(
        self, run: _Run, made: Sequence[tuple[str, MadeStage]], result: LinearImage | Image
    ) -> None:
        """Run native stages into an image, and note their results."""
        light = run.exposed.light
        stages = (ImageStage * max(1, len(made)))(*(stage.struct for _, stage in made))
        has_noise = any(name in _NOISE_EFFECTS for name, _ in made)
        is_encoded = result.dtype == np.uint8
        job = ImageJob(
            width=light.shape[1],
            height=light.shape[0],
            light=light.ctypes.data,
            linear=None if is_encoded else result.ctypes.data,
            rgb=result.ctypes.data if is_encoded else None,
            srgb_table=srgb_table().ctypes.data,
            quantiles=normal_quantile_table().ctypes.data if has_noise else None,
            mirror_pixels=count_valid_pixels(run.exposed.camera),
            num_stages=len(made),
            stages=ctypes.addressof(stages),
        )
        job.scratch = self._reserve(self._device.image_scratch_bytes(job))
        self._device.change_image(job)
        run.layout_ms += job.encode_ms
        for (name, _), stage in zip(made, stages, strict=False):
            run.stage_ms[name] = stage.ms
            if stage.threshold >= 0.0:
                run.changes[name] = stage.change
            if stage.threshold >= 0.0 and name == DefocusByDepth.name:
                run.changes[Defocus.name] = stage.other_change

    def _reserve(self, size: int) -> int:
        """Address of memory of a size, kept for the next frames."""
        if len(self._scratch) < size + _ALIGNMENT:
            self._scratch = np.empty(size + _ALIGNMENT, dtype=np.uint8)
        return -(-self._scratch.ctypes.data // _ALIGNMENT) * _ALIGNMENT

    def close(self) -> None:
        """Close the device, which then belongs to this changer alone."""
        self._device.close()
