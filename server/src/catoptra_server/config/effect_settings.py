"""What a capture camera's section says of effects: a mode each, and their numbers.

The keys are those of the table in `effects/`: `ShotNoise=auto` is a mode, `FullWell=18000` a number
that several effects may share. An effect without a mode is not simulated, and not spoken of.
"""

from __future__ import annotations

from catoptra_server.config.section_reader import SectionReader
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import EffectMode, EffectSetting, EffectSettings, EffectType

_MODES = [mode.value for mode in EffectMode]


def read_effect_settings(section: SectionReader) -> EffectSettings:
    """Return the effects that a section names, in optical order."""
    wishes = [_read_effect_setting(section, kind) for kind in EFFECT_TYPES]
    return EffectSettings(
        tuple(wish for wish in wishes if wish is not None),
        threshold_grey_levels=section.get_float(
            "EffectThreshold", 0.5, min_value=0.0, max_value=255.0
        ),
        threshold_px=section.get_float("EffectThresholdPx", 0.5, min_value=0.0, max_value=1000.0),
    )


def _read_effect_setting(section: SectionReader, kind: EffectType) -> EffectSetting | None:
    """Return the wish for an effect; its numbers are checked whether it has a mode or not."""
    values = {
        p.field: section.get_float(p.key, p.default, min_value=p.min_value, max_value=p.max_value)
        for p in kind.parameters
    }
    if not section.has_key(kind.name):
        return None
    return EffectSetting(kind.factory(**values), EffectMode(section.get_choice(kind.name, _MODES)))
