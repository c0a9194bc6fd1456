"""What scene, lens and sensor do to a picture, in one visible table, in optical order.

First what changes what there is to be seen, then what changes the picture of it. What moves or
blurs the scene stands before what lies on mirror and lens.

To add one: write `<name>.py` beside the others (the protocol is in `effect.py`; formula, source,
domain and criterion in its docstring), `glsl/effect_<name>.frag`, and its line here. Its keys in
the capture camera's section, its place in both renderers, in `explain` and in the stream's header
follow from these. Mathematics that several need, or that would hide one's idea, is in `shared/`. Of
what no robot's file names nothing is built.
"""

from __future__ import annotations

from catoptra_server.effects.effect import EffectType
from catoptra_server.effects.medium import (
    chromatic_aberration,
    defocus,
    defocus_by_depth,
    diffraction,
    fog,
    misalignment,
    vignetting,
)
from catoptra_server.effects.mirror import mirror_dust, mirror_reflectance
from catoptra_server.effects.scene import motion_blur, rolling_shutter, self_view, shadows
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
    rolling_shutter.EFFECT_TYPE,
    motion_blur.EFFECT_TYPE,
    fog.EFFECT_TYPE,
    defocus_by_depth.EFFECT_TYPE,
    defocus.EFFECT_TYPE,
    misalignment.EFFECT_TYPE,
    chromatic_aberration.EFFECT_TYPE,
    diffraction.EFFECT_TYPE,
    mirror_dust.EFFECT_TYPE,
    mirror_reflectance.EFFECT_TYPE,
    vignetting.EFFECT_TYPE,
    exposure.EFFECT_TYPE,
    auto_exposure.EFFECT_TYPE,
    blooming.EFFECT_TYPE,
    fixed_pattern.EFFECT_TYPE,
    shot_noise.EFFECT_TYPE,
    read_noise.EFFECT_TYPE,
    quantisation.EFFECT_TYPE,
    bayer.EFFECT_TYPE,
    white_balance.EFFECT_TYPE,
)

__all__ = ["EFFECT_TYPES"]
