"""Effects of a recipe: modes for all its cameras, and ranges that parameters are drawn from.

An effect that the recipe names replaces the camera's own, parameters included; the others stay.
Effects that need a mirror, or a single viewpoint, are left out for cameras without.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from catoptra_server.config.effect_settings import (
    read_effect_settings,
    read_lens_effect_settings,
)
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import Entry
from catoptra_server.datasets.recipe import EffectOverrides, ValueRange
from catoptra_server.datasets.recipe_values import read_range
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import (
    EffectMode,
    EffectParameter,
    EffectSettings,
    EffectType,
)

SECTION = "Catoptra.Effects"


def read_effects(section: SectionReader) -> EffectOverrides:
    """Effects of the section; none for an absent one.

    Raises:
        ConfigError: For an unknown mode, or a parameter whose range is empty or out of bounds.
    """
    modes, values = [], []
    for kind in EFFECT_TYPES:
        mode = section.get_choice(kind.name, [mode.value for mode in EffectMode], "")
        if mode:
            modes.append((kind.name, mode))
    for parameter in _parameters():
        low, high = parameter.min_value, parameter.max_value
        if section.get_str(parameter.key, ""):
            found = read_range(
                section, parameter.key, ValueRange(0.0, 0.0), min_value=low, max_value=high
            )
            values.append((parameter.key, found))
    overrides = EffectOverrides(tuple(modes), tuple(values), section.where)
    # Combinations that cannot be drawn are found now, not in the middle of the data set.
    for end in ("low", "high"):
        drawn = {key: float(getattr(values, end)) for key, values in overrides.values}
        for has_mirror in (True, False):
            _read_settings(overrides, drawn, has_mirror=has_mirror, has_viewpoint=True)
    return overrides


def _parameters() -> Iterator[EffectParameter]:
    """Yield the parameters of all effects, one that several share once."""
    seen: set[str] = set()
    for kind in EFFECT_TYPES:
        for parameter in kind.parameters:
            if parameter.key not in seen:
                seen.add(parameter.key)
                yield parameter


def draw_effects(
    overrides: EffectOverrides,
    own: EffectSettings,
    generator: np.random.Generator,
    *,
    has_mirror: bool,
    has_viewpoint: bool,
) -> EffectSettings:
    """Settings of one sample: those of the camera, with the recipe's in their place.

    Args:
        overrides: Effects of the recipe.
        own: Effects of the camera's own file.
        generator: Random numbers of the sample's effects.
        has_mirror: Whether the camera has a mirror.
        has_viewpoint: Whether it has a single viewpoint.

    Raises:
        ConfigError: Drawn parameters cannot be drawn together.
    """
    if not overrides.modes:
        return own
    drawn = {key: values.draw(generator) for key, values in overrides.values}
    wanted = _read_settings(overrides, drawn, has_mirror=has_mirror, has_viewpoint=has_viewpoint)
    by_name = {one.effect.name: one for one in (*own.settings, *wanted.settings)}
    ordered = tuple(by_name[kind.name] for kind in EFFECT_TYPES if kind.name in by_name)
    return EffectSettings(
        ordered,
        threshold_grey_levels=own.threshold_grey_levels,
        threshold_px=own.threshold_px,
        basis=own.basis,
    )


def _read_settings(
    overrides: EffectOverrides,
    drawn: Mapping[str, float],
    *,
    has_mirror: bool,
    has_viewpoint: bool,
) -> EffectSettings:
    """Settings of drawn parameters, by the readers of robot files: one place has all checks."""
    kinds = {kind.name: kind for kind in EFFECT_TYPES}
    modes = [
        (name, mode)
        for name, mode in overrides.modes
        if _is_possible(kinds[name], has_mirror=has_mirror, has_viewpoint=has_viewpoint)
    ]
    texts = (*modes, *((key, repr(value)) for key, value in drawn.items()))
    entries = [Entry(key, text, "", overrides.where) for key, text in texts]
    section = SectionReader(SECTION, overrides.where, entries)
    if has_mirror:
        return read_effect_settings(section, has_viewpoint=has_viewpoint)
    return read_lens_effect_settings(section)


def _is_possible(kind: EffectType, *, has_mirror: bool, has_viewpoint: bool) -> bool:
    if not has_mirror:
        return not kind.needs_mirror
    return has_viewpoint or not kind.needs_viewpoint
