"""Image effects by the kernel: one call for all, each a stage of it.

A stage is the numbers and maps that `src/image.h` describes. Stages share passes over the image
(`src/image_chain.c`), and a pass's time by relative times of their kinds: milliseconds of a stage
are such a share. The kernel leaves plain each cell of 16 x 8 px that a stage can change by no more
than its plain change; the largest change and the pixels that change visibly are the same for any
number of threads. Before a mosaic it computes the colours that the mosaic keeps, and measures
those; the mosaic's own change is then measured up to its limits, and infinite beyond: seen, but not
how much. Where a first blur by range changes light by more than its limit, what lens, sensor and
response leave of it decides; a factor of light is measured behind the automatic exposure that
follows it. Effects without a stage are applied by their own formula, in their place in the order.

To give an effect native code: a kind in `src/image.h`, its C code, and a function in STAGE_MAKERS.
Maps are cached by effect and camera; a stage keeps the arrays that the kernel reads.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import EffectChange, ImageEffect, Threshold
from catoptra_server.effects.kernels.convolution import (
    DiscKernelTable,
    float32_weights,
    table_row,
)
from catoptra_server.effects.kernels.grey_levels import (
    count_valid_pixels,
    frame_noise_key,
    normal_quantile_table,
)
from catoptra_server.effects.kernels.lens_blur import (
    circle_of_confusion,
    circle_of_confusion_map,
    interior_mask,
    map_of_radius,
)
from catoptra_server.effects.medium.chromatic_aberration import (
    ChromaticAberration,
    channel_offsets_px,
)
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.effects.medium.diffraction import (
    Diffraction,
    kernel_half_width_px,
    kernel_weights,
)
from catoptra_server.effects.medium.misalignment import (
    Misalignment,
    lookup_maps,
)
from catoptra_server.effects.medium.veiling_glare import (
    VeilingGlare,
    glare_kernel,
    glare_spread,
    source_glare,
)
from catoptra_server.effects.medium.vignetting import Vignetting, vignetting_map
from catoptra_server.effects.mirror.mirror_dust import MirrorDust, coverage_map
from catoptra_server.effects.mirror.mirror_holder import (
    MirrorHolder,
    opposite_sums,
    strut_coverage,
    tube_maps,
)
from catoptra_server.effects.mirror.mirror_reflectance import MirrorReflectance, reflectance_map
from catoptra_server.effects.sensor.fixed_pattern import FixedPattern, gain_and_offset_maps
from catoptra_server.render.image_changer import (
    ChangedImage,
    ExposedImage,
    NumpyImageChanger,
    srgb_table,
)
from catoptra_server.render.renderer import Image, LinearImage
from catoptra_server.render.trace.kernel.exposure_arrays import change_limits, read_change
from catoptra_server.render.trace.kernel.kernel_structs import ImageJob, ImageStage
from catoptra_server.render.trace.kernel.library import KernelDevice, choose_instruction_set
from catoptra_server.world.objects import NoiseSeed

(
    _GAIN,
    _AUTO_GAIN,
    _CLIPPED_GAIN,
    _RESPONSE,
    _COVER,
    _PATTERN,
    _QUANTISE,
    _SHOT_NOISE,
    _READ_NOISE,
    _GLARE,
    _BLUR,
    _WARP,
    _MAGNIFY,
    _BLOOM,
    _BAYER,
    _GHOST,
) = range(16)
# A line of the processor's cache, which the kernel's rows of vectors begin at.
_ALIGNMENT = 64
# The table of quantiles is computed at its first use: not for frames without noise.
_NOISE_EFFECTS = frozenset({"ShotNoise", "ReadNoise"})
# Rows and columns of a cell.
_CELL_PX = (8, 16)
# Below zero the kernel draws everywhere.
_EVERYWHERE = Threshold(-1.0)
_Array = npt.NDArray[Any]
_Float32s = npt.NDArray[np.float32]


class KernelImageChanger:
    """Image effects on a kernel device; belongs to the thread of the renderer."""

    description = "the native kernel"

    def __init__(self, device: KernelDevice) -> None:
        """Begin without memory to work in."""
        self._device = device
        self._numpy = NumpyImageChanger()
        self._scratch = np.zeros(0, dtype=np.uint8)

    @classmethod
    def open(cls, threads: int) -> KernelImageChanger:
        """Image changer on a device of its own, for images that others expose.

        Args:
            threads: Threads, the calling one included.

        Raises:
            KernelUnavailableError: The kernel's library is missing.
        """
        return cls(KernelDevice(choose_instruction_set(), threads))

    @property
    def memory_bytes(self) -> int:
        """Size of the memory that images are changed in."""
        return self._scratch.nbytes

    def change(
        self,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
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
        thresholds: Mapping[str, Threshold],
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
        made: list[tuple[str, _StageWithMaps]] = []
        for number, effect in enumerate(effects):
            exposed, make_stage = run.exposed, STAGE_MAKERS.get(effect.name)
            if make_stage is not None:
                stage = make_stage(effect, exposed)
                threshold = run.thresholds.get(effect.name, _EVERYWHERE)
                stage.struct.limits = change_limits(threshold, exposed.light[..., 0].size)
                stage.struct.least_gain, stage.struct.largest_gain = threshold.gains
                stage.struct.spill[:] = threshold.spill
                # The pixels that change visibly are counted where they do.
                is_by_largest = threshold.is_measured and threshold.visible_share >= 1.0
                is_followed = not number and len(effects) > 1
                if effect.name == DefocusByDepth.name and is_followed and is_by_largest:
                    stage = _defer_change(stage, exposed)
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
        self,
        run: _Run,
        made: Sequence[tuple[str, _StageWithMaps]],
        result: LinearImage | Image,
    ) -> None:
        """Run native stages into an image, and note their results."""
        light = run.exposed.light
        _narrow_gains([stage.struct for _, stage in made])
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
            if stage.limits.max_change >= 0.0:
                run.changes[name] = read_change(stage.change, job.width * job.height)
            if stage.limits.max_change >= 0.0 and name == DefocusByDepth.name:
                other = read_change(stage.other_change, job.width * job.height)
                run.changes[Defocus.name] = other

    def _reserve(self, size: int) -> int:
        """Address of memory of a size, kept for the next frames."""
        if len(self._scratch) < size + _ALIGNMENT:
            self._scratch = np.empty(size + _ALIGNMENT, dtype=np.uint8)
        return -(-self._scratch.ctypes.data // _ALIGNMENT) * _ALIGNMENT

    def close(self) -> None:
        """Close the device, which then belongs to this changer alone."""
        self._device.close()


@dataclass(slots=True, eq=False)
class _Run:
    """One image on its way through its effects, and the results so far."""

    exposed: ExposedImage
    thresholds: Mapping[str, Threshold]
    stage_ms: dict[str, float] = field(default_factory=dict)
    changes: dict[str, EffectChange] = field(default_factory=dict)
    layout_ms: float = 0.0
    """Milliseconds of the encoding, and of the change of the arrays' layout."""


def _defer_change(stage: _StageWithMaps, exposed: ExposedImage) -> _StageWithMaps:
    """A first blur by range whose change the lens behind it decides."""
    height, width = exposed.light.shape[:2]
    deferred = np.zeros((-(-height // _CELL_PX[0]), -(-width // _CELL_PX[1])), dtype=np.float32)
    stage.struct.deferred = deferred.ctypes.data
    return replace(stage, arrays=(*stage.arrays, deferred))


def _narrow_gains(stages: Sequence[ImageStage]) -> None:
    """Narrow the largest gains of what follows each stage by the largest factors of maps, over the
    largest that their effects know of without a camera."""
    factor = 1.0
    for stage in reversed(stages):
        stage.largest_gain *= factor
        stage.spill[0] *= factor
        if stage.kind == _GAIN and stage.maps[0]:
            factor *= stage.numbers[0]


@dataclass(frozen=True, slots=True, eq=False)
class _StageWithMaps:
    """A stage and the arrays that it refers to."""

    struct: ImageStage
    arrays: tuple[_Array, ...]


def _make(
    kind: int,
    *maps: _Array | None,
    numbers: tuple[float, ...] = (),
    key: _Array | None = None,
    size: int = 0,
    num_rows: int = 0,
) -> _StageWithMaps:
    struct = ImageStage(kind=kind, size=size, num_rows=num_rows)
    struct.numbers[: len(numbers)] = numbers
    if key is not None:
        struct.key[:3] = key.tolist()
    for index, array in enumerate(maps):
        if array is not None:
            assert array.flags.c_contiguous, "the kernel reads arrays without strides"
            struct.maps[index] = array.ctypes.data
    return _StageWithMaps(struct, tuple(array for array in maps if array is not None))


@lru_cache(maxsize=16)
def _interior(camera: RadialCamera, size: int) -> npt.NDArray[np.uint8]:
    """Mask of blurs by kernels of a half width, (h + 2 size, w + 2 size + 16): edges repeat."""
    mask = interior_mask(camera).astype(np.uint8)
    # The kernel reads whole vectors of 16.
    return np.pad(mask, ((size, size), (size, size + 16)), "edge")


def _make_defocus(effect: Defocus, exposed: ExposedImage) -> _StageWithMaps:
    camera = exposed.camera
    return _make_disc_blur(effect.kernel_table(camera), _infinity_rows(effect, camera), camera)


@lru_cache(maxsize=4)
def _infinity_rows(effect: Defocus, camera: RadialCamera) -> _Float32s:
    """Fractional row of the kernel table for each pixel, (h, w)."""
    circle = circle_of_confusion_map(effect.aperture, camera)
    return table_row(circle.infinity_diameter_px).astype(np.float32)


def _make_defocus_by_depth(effect: DefocusByDepth, exposed: ExposedImage) -> _StageWithMaps:
    camera, range_m = exposed.camera, exposed.context.range_m
    assert range_m is not None, "defocus by depth needs ranges"
    ranges = np.ascontiguousarray(range_m, dtype=np.float32)
    parameters = _disc_parameters(effect, camera)
    return _make_disc_blur(effect.kernel_table(camera), parameters, camera, ranges)


@lru_cache(maxsize=4)
def _disc_parameters(effect: DefocusByDepth, camera: RadialCamera) -> _Float32s:
    """Maps, (4, h, w): infinity_diameter_px, near_px, power_per_m, offset."""

    def discs(radius_px: npt.NDArray[np.float64]) -> _Float32s:
        circle = circle_of_confusion(effect.aperture, camera, radius_px)
        return circle.parameters.astype(np.float32)

    return np.ascontiguousarray(np.moveaxis(map_of_radius(camera, discs), -1, 0))


def _make_disc_blur(
    table: DiscKernelTable, discs: _Float32s, camera: RadialCamera, *by_range: _Float32s
) -> _StageWithMaps:
    weights, size = float32_weights(table), table.half_width_px
    interior = _interior(camera, size)
    stage = _make(_BLUR, weights, discs, interior, *by_range, size=size, num_rows=len(weights))
    stage.struct.numbers[0] = table.max_step
    return stage


def _make_diffraction(effect: Diffraction, exposed: ExposedImage) -> _StageWithMaps:
    return _make(_BLUR, _colour_weights(effect), size=kernel_half_width_px(effect))


@lru_cache(maxsize=8)
def _colour_weights(effect: Diffraction) -> _Float32s:
    """Weights, (3, pairs), of a kernel for each colour."""
    return np.ascontiguousarray(kernel_weights(effect).astype(np.float32).T)


def _make_dust(effect: MirrorDust, exposed: ExposedImage) -> _StageWithMaps:
    key = exposed.context.noise_seed.camera_key
    coverage = coverage_map(effect, cast(OmniCamera, exposed.camera), key)
    return _make(_COVER, coverage, numbers=(effect.albedo,))


def _make_reflectance(effect: MirrorReflectance, exposed: ExposedImage) -> _StageWithMaps:
    gains, largest = _gain_map(reflectance_map, effect, exposed.camera)
    return _make(_GAIN, gains, numbers=(largest / effect.gains[1],))


def _make_vignetting(effect: Vignetting, exposed: ExposedImage) -> _StageWithMaps:
    gains, largest = _gain_map(vignetting_map, exposed.camera)
    return _make(_GAIN, gains, numbers=(largest,))


@lru_cache(maxsize=8)
def _gain_map(make_map: Callable[..., _Array], *arguments: object) -> tuple[_Float32s, float]:
    """Map of factors, (h, w), and the largest."""
    gains = make_map(*arguments).astype(np.float32)
    return gains, float(gains.max())


def _make_fixed_pattern(effect: FixedPattern, exposed: ExposedImage) -> _StageWithMaps:
    seed = NoiseSeed(exposed.context.noise_seed.camera_key)
    return _make(_PATTERN, *_pattern_planes(effect, seed, *exposed.light.shape[:2]))


@lru_cache(maxsize=4)
def _pattern_planes(
    effect: FixedPattern, seed: NoiseSeed, height: int, width: int
) -> tuple[_Float32s, ...]:
    """Gains and offsets, (3, h, w)."""
    maps = gain_and_offset_maps(effect, seed, height, width)
    return tuple(np.ascontiguousarray(np.moveaxis(one, -1, 0)) for one in maps)


def _make_noise(
    kind: int, effect: ImageEffect, exposed: ExposedImage, scale: float
) -> _StageWithMaps:
    key = frame_noise_key(exposed.context.noise_seed, effect.name)
    return _make(kind, numbers=(scale,), key=key)


def _make_misalignment(effect: Misalignment, exposed: ExposedImage) -> _StageWithMaps:
    camera = cast(OmniCamera, exposed.camera)
    maps, reach_px = _offset_maps(effect, camera)
    return _make(_WARP, *maps, lookup_maps(effect, camera)[1], size=reach_px)


@lru_cache(maxsize=4)
def _offset_maps(effect: Misalignment, camera: OmniCamera) -> tuple[tuple[_Float32s, ...], int]:
    """Offsets in u and in v, (h, w) each, and the reach of the pixels that they mix."""
    lookup = lookup_maps(effect, camera)[0]
    maps = tuple(np.ascontiguousarray(lookup[..., axis]) for axis in (0, 1))
    return maps, _shift_reach_px(maps)


def _shift_reach_px(offsets: tuple[_Float32s, ...]) -> int:
    return 1 + math.ceil(max(float(np.abs(one).max()) for one in offsets))


def _make_chromatic_aberration(
    effect: ChromaticAberration, exposed: ExposedImage
) -> _StageWithMaps:
    offsets = _magnified_offsets(effect, exposed.camera)
    return _make(_MAGNIFY, *offsets, size=_shift_reach_px(offsets))


@lru_cache(maxsize=4)
def _magnified_offsets(effect: ChromaticAberration, camera: RadialCamera) -> tuple[_Float32s, ...]:
    """Offsets of columns, (2, w), and of rows, (2, h)."""
    offsets = channel_offsets_px(effect, camera)
    return tuple(np.ascontiguousarray(one.reshape(-1, 2).T) for one in offsets)


def _make_holder(effect: MirrorHolder, exposed: ExposedImage) -> _StageWithMaps:
    camera = cast(OmniCamera, exposed.camera)
    maps = _holder_maps(effect, camera)
    if effect.num_struts:
        return _make(_COVER, *maps, numbers=(effect.albedo,))
    return _make(_GHOST, *maps, numbers=opposite_sums(camera))


@lru_cache(maxsize=4)
def _holder_maps(effect: MirrorHolder, camera: OmniCamera) -> tuple[_Float32s, ...]:
    maps = (strut_coverage(effect, camera),) if effect.num_struts else tube_maps(effect, camera)
    return tuple(one.astype(np.float32) for one in maps)


def _make_glare(effect: VeilingGlare, exposed: ExposedImage) -> _StageWithMaps:
    camera = exposed.camera
    spread = glare_spread(effect, camera)
    sources = source_glare(effect, camera, exposed.context).astype(np.float32)
    return _make(
        _GLARE,
        glare_kernel(effect, camera),
        sources if len(sources) else None,
        numbers=(1.0 - effect.index, spread.veil, spread.inverse_square),
        size=spread.cell_px,
        num_rows=len(sources),
    )


STAGE_MAKERS: Mapping[str, Callable[[Any, ExposedImage], _StageWithMaps]] = {
    "Defocus": _make_defocus,
    "DefocusByDepth": _make_defocus_by_depth,
    "Misalignment": _make_misalignment,
    "ChromaticAberration": _make_chromatic_aberration,
    "Diffraction": _make_diffraction,
    "MirrorHolder": _make_holder,
    "MirrorDust": _make_dust,
    "MirrorReflectance": _make_reflectance,
    "Vignetting": _make_vignetting,
    "VeilingGlare": _make_glare,
    "Exposure": lambda effect, exposed: _make(_GAIN, numbers=(effect.gain,) * 3),
    "AutoExposure": lambda effect, exposed: _make(
        _AUTO_GAIN, numbers=(effect.target_luminance, effect.min_gain, effect.max_gain)
    ),
    "Blooming": lambda effect, exposed: _make(
        _BLOOM, numbers=(effect.overflow_fraction,), size=int(effect.length_px)
    ),
    "FixedPattern": _make_fixed_pattern,
    "ShotNoise": lambda effect, exposed: _make_noise(
        _SHOT_NOISE, effect, exposed, 1.0 / effect.full_well_e
    ),
    "ReadNoise": lambda effect, exposed: _make_noise(
        _READ_NOISE, effect, exposed, effect.standard_deviation
    ),
    "Quantisation": lambda effect, exposed: _make(_QUANTISE, numbers=(effect.max_code,)),
    "Bayer": lambda effect, exposed: _make(_BAYER),
    "WhiteBalance": lambda effect, exposed: _make(
        _CLIPPED_GAIN, numbers=(effect.red_gain, 1.0, effect.blue_gain)
    ),
    "Response": lambda effect, exposed: _make(
        _RESPONSE, effect.table if effect.curve else None, numbers=effect.numbers
    ),
}
