"""Effects of a camera's section: a mode for each, and their parameters.

The keys are those of EFFECT_TYPES in `effects/`: `ShotNoise=auto` is a mode, `FullWell=18000` a
parameter that several effects share. An effect without a mode is neither simulated nor reported.
The keys are the same for a capture camera and for a perspective one, which has no mirror.
"""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_server.config.section_reader import SectionReader
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import (
    DecisionBasis,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
)

_MODES = [mode.value for mode in EffectMode]
_BASES = [basis.value for basis in DecisionBasis]
_DEFAULT_BASIS = DecisionBasis.MEASURED.value


def read_effect_settings(section: SectionReader, *, has_viewpoint: bool = True) -> EffectSettings:
    """Settings of the effects that a capture camera's section gives a mode, in optical order.

    Args:
        section: the capture camera's section.
        has_viewpoint: whether the mirror has a single viewpoint.

    Raises:
        ConfigError: for an effect that a mirror without a viewpoint cannot have, a parameter
            outside its range or an unknown mode.
    """
    for kind in EFFECT_TYPES:
        if kind.needs_viewpoint and not has_viewpoint and section.has_key(kind.name):
            expected = (
                "no such effect of a mirror without a single viewpoint: its virtual image is "
                "astigmatic, which is not simulated"
            )
            raise section.make_error(kind.name, expected=expected)
    return _read_effect_settings(section, EFFECT_TYPES)


def read_lens_effect_settings(section: SectionReader) -> EffectSettings:
    """Settings of the effects that the section of a camera without a mirror gives a mode.

    Raises:
        ConfigError: for an effect of mirrors, a parameter outside its range or an unknown mode.
    """
    kinds = [kind for kind in EFFECT_TYPES if not kind.needs_mirror]
    for kind in EFFECT_TYPES:
        if kind.needs_mirror and section.has_key(kind.name):
            known = ", ".join(one.name for one in kinds)
            expected = f"an effect of a lens, which has no mirror: {known}"
            raise section.make_error(kind.name, expected=expected)
    return _read_effect_settings(section, kinds)


def _read_effect_settings(section: SectionReader, kinds: Sequence[EffectType]) -> EffectSettings:
    settings = [_read_effect_setting(section, kind) for kind in kinds]
    return EffectSettings(
        tuple(setting for setting in settings if setting is not None),
        threshold_grey_levels=section.get_float(
            "EffectThreshold", 0.5, min_value=0.0, max_value=255.0
        ),
        basis=DecisionBasis(section.get_choice("EffectDecision", _BASES, _DEFAULT_BASIS)),
        threshold_px=_read_threshold_px(section),
    )


def _read_threshold_px(section: SectionReader) -> float | None:
    if not section.has_key("EffectThresholdPx"):
        return None
    return section.get_float("EffectThresholdPx", min_value=0.0, max_value=1000.0)


def _read_effect_setting(section: SectionReader, kind: EffectType) -> EffectSetting | None:
    """Setting of one effect; None without a mode."""
    # Read even without a mode: a typing error is found before the effect is switched on, and a
    # parameter of an effect that is off does not count as an unknown key.
    values = {
        p.field: section.get_float(p.key, p.default, min_value=p.min_value, max_value=p.max_value)
        for p in kind.parameters
    }
    mode = section.get_choice(kind.name, _MODES, "")
    if not mode:
        return None
    effect = kind.factory(**values)
    fault = kind.find_fault(effect) if kind.find_fault else None
    if fault:
        raise section.make_error(fault.key, expected=fault.expected)
    return EffectSetting(effect, EffectMode(mode))
