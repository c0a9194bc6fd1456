"""Image effects as stages of the kernel: the numbers and maps that `src/image.h` asks for.

To give an effect native code: a kind in `src/image.h`, its C code, and a function in STAGE_MAKERS.
Effects without one are applied by their own formula. Maps are cached by effect and camera, and live
as long as the kernel reads them: whoever makes a stage keeps what it is given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.kernels.disc_kernel import DiscKernelTable
from catoptra_server.effects.kernels.lens_blur import interior_mask
from catoptra_server.effects.kernels.noise import frame_noise_key
from catoptra_server.effects.medium import defocus, defocus_by_depth
from catoptra_server.effects.medium.chromatic_aberration import channel_offsets_px
from catoptra_server.effects.medium.diffraction import kernel_half_width_px, kernel_weights
from catoptra_server.effects.medium.misalignment import lookup_offset_map
from catoptra_server.effects.medium.vignetting import vignetting_map
from catoptra_server.effects.mirror.mirror_dust import coverage_map
from catoptra_server.effects.mirror.mirror_reflectance import reflectance_map
from catoptra_server.effects.sensor.fixed_pattern import FixedPattern, gain_and_offset_maps
from catoptra_server.render.trace.kernel.kernel_structs import ImageStage
from catoptra_server.world.camera_state import NoiseSeed

(
    _GAIN,
    _AUTO_GAIN,
    _CLIPPED_GAIN,
    _COVER,
    _PATTERN,
    _QUANTISE,
    _SHOT_NOISE,
    _READ_NOISE,
    _BLUR,
    _WARP,
    _MAGNIFY,
    _BLOOM,
    _BAYER,
) = range(13)

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class MadeStage:
    """A stage and the arrays that it refers to."""

    struct: ImageStage
    arrays: tuple[Array, ...]


StageMaker = Callable[[Any, RadialCamera, CaptureContext], MadeStage]


def make_stage(
    effect: ImageEffect, camera: RadialCamera, context: CaptureContext, threshold: float | None
) -> MadeStage | None:
    """Stage of an effect; None for one without native code.

    Args:
        effect: Effect of the image.
        camera: Camera of the image.
        context: Seed and ranges.
        threshold: Change in grey levels that nobody sees; None to draw everywhere.
    """
    maker = STAGE_MAKERS.get(effect.name)
    if maker is None:
        return None
    stage = maker(effect, camera, context)
    stage.struct.threshold = -1.0 if threshold is None else threshold
    return stage


def _make(
    kind: int,
    *maps: Array | None,
    numbers: tuple[float, ...] = (),
    key: Array | None = None,
    size: int = 0,
    num_rows: int = 0,
) -> MadeStage:
    struct = ImageStage(kind=kind, size=size, num_rows=num_rows)
    struct.numbers[: len(numbers)] = numbers
    if key is not None:
        struct.key[:3] = key.tolist()
    for index, array in enumerate(maps):
        if array is not None:
            assert array.flags.c_contiguous, "the kernel reads arrays without strides"
            struct.maps[index] = array.ctypes.data
    return MadeStage(struct, tuple(array for array in maps if array is not None))


@lru_cache(maxsize=16)
def _interior(camera: RadialCamera) -> npt.NDArray[np.uint8]:
    """Mask of blurs, (h, w)."""
    return interior_mask(camera).astype(np.uint8)


def _make_defocus(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    rows = defocus.table_row_map(effect, camera)
    return _make_disc_blur(defocus.kernel_table(effect, camera), rows, _interior(camera))


def _make_defocus_by_depth(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    assert context.range_m is not None, "defocus by depth needs ranges"
    return _make_disc_blur(
        defocus_by_depth.kernel_table(effect, camera),
        defocus_by_depth.disc_parameter_map(effect, camera),
        _interior(camera),
        np.ascontiguousarray(context.range_m, dtype=np.float32),
    )


def _make_disc_blur(table: DiscKernelTable, *maps: Array) -> MadeStage:
    weights = table.float32_weights()
    return _make(_BLUR, weights, *maps, size=table.half_width_px, num_rows=len(weights))


def _make_diffraction(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_BLUR, _colour_weights(effect), size=kernel_half_width_px(effect))


@lru_cache(maxsize=8)
def _colour_weights(effect: Any) -> npt.NDArray[np.float32]:
    """Weights, (3, pairs), of a kernel for each colour."""
    return np.ascontiguousarray(kernel_weights(effect).astype(np.float32).T)


def _make_misalignment(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_WARP, lookup_offset_map(effect, cast(Any, camera)))


def _make_magnification(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_MAGNIFY, *channel_offsets_px(effect, camera))


def _make_dust(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    coverage = coverage_map(effect, cast(Any, camera), context.noise_seed.camera_key)
    return _make(_COVER, coverage, numbers=(effect.albedo,))


def _make_reflectance(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_GAIN, _reflectances(effect, camera))


@lru_cache(maxsize=4)
def _reflectances(effect: Any, camera: RadialCamera) -> npt.NDArray[np.float32]:
    return reflectance_map(effect, cast(Any, camera)).astype(np.float32)


def _make_vignetting(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_GAIN, _vignettes(camera))


@lru_cache(maxsize=4)
def _vignettes(camera: RadialCamera) -> npt.NDArray[np.float32]:
    return vignetting_map(camera).astype(np.float32)


def _make_exposure(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_GAIN, numbers=(effect.gain,) * 3)


def _make_auto_exposure(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    numbers = (effect.target_luminance, effect.min_gain, effect.max_gain)
    return _make(_AUTO_GAIN, numbers=numbers)


def _make_white_balance(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_CLIPPED_GAIN, numbers=(effect.red_gain, 1.0, effect.blue_gain))


def _make_blooming(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_BLOOM, numbers=(effect.overflow_fraction,), size=int(effect.length_px))


def _make_fixed_pattern(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    seed = NoiseSeed(context.noise_seed.camera_key)
    return _make(_PATTERN, *_pattern_planes(effect, seed, camera.height_px, camera.width_px))


@lru_cache(maxsize=4)
def _pattern_planes(
    effect: FixedPattern, seed: NoiseSeed, height: int, width: int
) -> tuple[npt.NDArray[np.float32], ...]:
    """Gains and offsets, (3, h, w)."""
    maps = gain_and_offset_maps(effect, seed, height, width)
    return tuple(np.ascontiguousarray(np.moveaxis(one, -1, 0)) for one in maps)


def _make_shot_noise(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    key = frame_noise_key(context.noise_seed, effect.name)
    return _make(_SHOT_NOISE, numbers=(1.0 / effect.full_well_e,), key=key)


def _make_read_noise(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    key = frame_noise_key(context.noise_seed, effect.name)
    return _make(_READ_NOISE, numbers=(effect.standard_deviation,), key=key)


def _make_quantisation(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_QUANTISE, numbers=(effect.max_code,))


def _make_bayer(effect: Any, camera: RadialCamera, context: CaptureContext) -> MadeStage:
    return _make(_BAYER)


STAGE_MAKERS: Mapping[str, StageMaker] = {
    "Defocus": _make_defocus,
    "DefocusByDepth": _make_defocus_by_depth,
    "Misalignment": _make_misalignment,
    "ChromaticAberration": _make_magnification,
    "Diffraction": _make_diffraction,
    "MirrorDust": _make_dust,
    "MirrorReflectance": _make_reflectance,
    "Vignetting": _make_vignetting,
    "Exposure": _make_exposure,
    "AutoExposure": _make_auto_exposure,
    "Blooming": _make_blooming,
    "FixedPattern": _make_fixed_pattern,
    "ShotNoise": _make_shot_noise,
    "ReadNoise": _make_read_noise,
    "Quantisation": _make_quantisation,
    "Bayer": _make_bayer,
    "WhiteBalance": _make_white_balance,
}
