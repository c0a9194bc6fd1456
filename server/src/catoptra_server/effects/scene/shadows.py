"""Shadows: objects occlude directional and point lights.

Not a change of the image but of the scene's illumination; each renderer determines the visible
lights of every point. Radiance = albedo (E_sky + sum of E_l V_l), with V_l = 1 where light l is
visible and 0 elsewhere: lights are points and directions, so shadows have no penumbra. Domain: lit
surfaces; unlit ones only cast shadows. Criterion: the radiance from occludable lights on the
surface whose encoded value changes most, in grey levels; 0 if nothing can occlude a light (a
necessary condition on planes, `bounds`). In mode auto the native kernel casts no rays to lamps
whose light, together, changes the finished pixel by at most the threshold.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import UNCHANGED, EffectBound, EffectType, Gains, SceneSummary
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.world.objects import CameraState


@dataclass(frozen=True, slots=True)
class Shadows:
    """Shadows of all casters. No parameters: the world file has lights and objects."""

    name: ClassVar[str] = "Shadows"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = UNCHANGED
    reads: ClassVar[frozenset[str]] = frozenset({"max_shadow_loss"})

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Loss, in grey levels, of the surface that changes most in shadow."""
        # A pair and not a ratio: how visible a loss is depends on the light that remains.
        loss = summary.max_shadow_loss
        if loss.lost_radiance == 0.0:
            return EffectBound(0.0, "no object is in front of a directional or point light")
        # Encoded before the difference: the same linear loss shows most where little light is left.
        lit, shadowed = loss.remaining_radiance + loss.lost_radiance, loss.remaining_radiance
        return EffectBound(
            grey_level(lit) - grey_level(shadowed),
            f"radiance of {loss.lost_radiance:.3g} can be occluded, {shadowed:.3g} remains",
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: unshadowed surfaces keep their radiance."""
        return summary

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Camera state whose lights are occluded."""
        return replace(camera_state, has_shadows=True)


EFFECT_TYPE = EffectType("Shadows", Shadows)
