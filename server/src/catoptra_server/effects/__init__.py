"""Effects of scene, lens, mirror and sensor on a camera's image: the table, in optical order.

The order follows the light: the scene effects come first, since they change the objects, the
light, the air or the times that a renderer works on; the image effects follow, from the lens to the
sensor's white balance. Motion and defocus act before anything that lies on mirror and
lens, which neither moves nor blurs with the scene. `plan_effects` decides in this order, and both
renderers apply the enabled effects in this order.

To add an image effect:

1. `<folder>/<name>.py` with a frozen dataclass as in `effect.ImageEffect`: formula, source, domain
   and criterion in the module's docstring; the folder is `medium` (air and lens), `mirror` or
   `sensor`. Mathematics that several effects need goes to `kernels`.
2. A stage of the kernel: `render/trace/kernel/image.py:STAGE_MAKERS`.
3. A line in EFFECT_TYPES, at the effect's position in optical order.

To add a scene effect: `scene/<name>.py` as in `effect.SceneEffect`, and the line.
Keys of the capture camera's section, both renderers, `explain` and the frame header follow from the
table. Effects that no robot file names cost nothing: no pass, no program, no buffer.
"""

from __future__ import annotations

from catoptra_server.effects.effect import EffectType
from catoptra_server.effects.medium import (
    chromatic_aberration,
    defocus,
    defocus_by_depth,
    diffraction,
    misalignment,
    vignetting,
)
from catoptra_server.effects.mirror import mirror_dust, mirror_reflectance
from catoptra_server.effects.scene import fog, motion_blur, rolling_shutter, self_view, shadows
from catoptra_server.effects.sensor import (
    auto_exposure,
    bayer,
    blooming,
    exposure,
    fixed_pattern,
    quantisation,
    read_noise,
    shot_noise,
    white_balance,
)

EFFECT_TYPES: tuple[EffectType, ...] = (
    self_view.EFFECT_TYPE,
    shadows.EFFECT_TYPE,
    fog.EFFECT_TYPE,
    rolling_shutter.EFFECT_TYPE,
    motion_blur.EFFECT_TYPE,
    # Supersedes Defocus where both are named, so this criterion decides first.
    defocus_by_depth.EFFECT_TYPE,
    defocus.EFFECT_TYPE,
    misalignment.EFFECT_TYPE,
    chromatic_aberration.EFFECT_TYPE,
    diffraction.EFFECT_TYPE,
    mirror_dust.EFFECT_TYPE,
    mirror_reflectance.EFFECT_TYPE,
    vignetting.EFFECT_TYPE,
    # From here on radiance 1 fills a pixel's well.
    exposure.EFFECT_TYPE,
    auto_exposure.EFFECT_TYPE,
    blooming.EFFECT_TYPE,
    fixed_pattern.EFFECT_TYPE,
    shot_noise.EFFECT_TYPE,
    read_noise.EFFECT_TYPE,
    quantisation.EFFECT_TYPE,
    # Noise before the mosaic: the three colours of a pixel have independent noise, so the mosaic
    # keeps one measurement of each pixel.
    bayer.EFFECT_TYPE,
    white_balance.EFFECT_TYPE,
)

__all__ = ["EFFECT_TYPES"]
