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

from catoptra_server.effects import (
    auto_exposure,
    bayer,
    bloom,
    chromatic_aberration,
    defocus,
    defocus_by_depth,
    diffraction,
    exposure,
    fixed_pattern,
    fog,
    mirror_dust,
    mirror_reflectance,
    misalignment,
    motion_blur,
    own_body,
    quantisation,
    read_noise,
    rolling_shutter,
    shadows,
    shot_noise,
    vignetting,
    white_balance,
)
from catoptra_server.effects.effect import Kind

EFFECTS: tuple[Kind, ...] = (
    own_body.KIND,
    shadows.KIND,
    rolling_shutter.KIND,
    motion_blur.KIND,
    fog.KIND,
    defocus_by_depth.KIND,
    defocus.KIND,
    misalignment.KIND,
    chromatic_aberration.KIND,
    diffraction.KIND,
    mirror_dust.KIND,
    mirror_reflectance.KIND,
    vignetting.KIND,
    exposure.KIND,
    auto_exposure.KIND,
    bloom.KIND,
    fixed_pattern.KIND,
    shot_noise.KIND,
    read_noise.KIND,
    quantisation.KIND,
    bayer.KIND,
    white_balance.KIND,
)

__all__ = ["EFFECTS"]
