"""What a capture camera's section says of effects: a mode each, and their numbers.

The keys are those of the table in `effects/`: `ShotNoise=auto` is a mode, `FullWell=18000` a number
that several effects may share. An effect without a mode is not simulated, and not spoken of.
"""

from __future__ import annotations

from catoptra_server.config.settings import Settings
from catoptra_server.effects import EFFECTS
from catoptra_server.effects.effect import EffectWishes, Kind, Mode, Wish

_MODES = [mode.value for mode in Mode]


def read_effects(section: Settings) -> EffectWishes:
    """Return the effects that a section names, in optical order."""
    wishes = [_wish(section, kind) for kind in EFFECTS]
    return EffectWishes(
        tuple(wish for wish in wishes if wish is not None),
        threshold_grey_levels=section.number("EffectThreshold", 0.5, at_least=0.0, at_most=255.0),
        threshold_px=section.number("EffectThresholdPx", 0.5, at_least=0.0, at_most=1000.0),
    )


def _wish(section: Settings, kind: Kind) -> Wish | None:
    """Return the wish for an effect; its numbers are checked whether it has a mode or not."""
    values = {
        p.field: section.number(p.key, p.default, at_least=p.at_least, at_most=p.at_most)
        for p in kind.parameters
    }
    if not section.has(kind.name):
        return None
    return Wish(kind.make(**values), Mode(section.choice(kind.name, _MODES)))
