"""Shadows: lights with a direction or a place are hidden by what stands or moves before them.

Not a change of the picture but of the scene's light: `render/scene_effects` asks for it, and each
renderer asks of every place which lights it sees. Radiance = albedo (E_sky + sum of E_l V_l), V_l
1 where light l is seen and 0 where it is not: the lights are points and directions, so shadows have
no penumbra. Domain: surfaces that take light; what is unlit only casts shadows. Criterion: what the
surface that would change most, in encoded grey levels, has of lights that something could hide;
0 where nothing could (a necessary condition of planes, `bounds/shadow_candidates`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import GREY_LEVELS, EffectBound, EffectType
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class Shadows:
    """No numbers: lights and things are the world's."""

    name: ClassVar[str] = "Shadows"
    unit: ClassVar[str] = GREY_LEVELS

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what the surface that would change most loses in shadow."""
        shade = summary.max_shadow_loss
        if shade.lost_radiance == 0.0:
            return EffectBound(0.0, "nothing stands before a light with a direction or a place")
        value = grey_level(shade.remaining_radiance + shade.lost_radiance) - grey_level(
            shade.remaining_radiance
        )
        return EffectBound(
            value,
            f"light of {shade.lost_radiance:.3g} can be hidden, {shade.remaining_radiance:.3g} is left",
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: where nothing hides a light it is as bright as ever."""
        return summary


EFFECT_TYPE = EffectType("Shadows", Shadows)
