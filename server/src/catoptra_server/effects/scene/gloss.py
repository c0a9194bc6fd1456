"""Gloss: polished floors and lacquer mirror what is above them.

L' = (1 - F) L + F ((1 - r) M + r E), M the light along the mirrored ray, r the roughness, E the
sky's irradiance, which stands for the mean of what a rough surface spreads. F is Fresnel's
reflectance, F0 + (max(1 - r, F0) - F0) (1 - cos)^5. The mirrored ray averages textures over the
square of the roughness, radians. Source: Schlick 1994; for rough surfaces Lagarde 2011. Domain:
static surfaces with `Gloss` in the world's file; one ray a sample, which shows other surfaces
without their gloss, and edges that are sharp at any roughness. Where roughness spreads it over more
than a pixel, the native kernel casts one a pixel in tiles of which all meet one facet. As a mean of
radiances the light exceeds that of no surface. Criterion: a black surface that mirrors the
brightest, at a grazing angle. In mode auto the native kernel casts no ray where neither the
brightest light nor black in the mirror would change the pixel by more than the threshold. Raster
draws no gloss: its rows say so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import AVERAGING, EffectBound, EffectType, Gains, SceneSummary
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.world.objects import CameraState


@dataclass(frozen=True, slots=True)
class Gloss:
    """Mirrored light. No parameters: the world's file has the materials."""

    name: ClassVar[str] = "Gloss"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance", "max_fresnel"})

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change of a black surface, and of one just white, beside the brightest and black."""
        part, brightest = summary.max_fresnel, summary.max_radiance
        if part == 0.0:
            return EffectBound(0.0, "no surface is glossy")
        white = [min(brightest, 1.0 / gain) for gain in summary.gains if gain > 0.0]
        own = np.array([0.0, brightest, *white])[:, None]
        changes = [
            find_changes((1.0 - part) * own + part * mirrored, own, summary.gains).max()
            for mirrored in (0.0, brightest)
        ]
        reason = f"{100.0 * part:.3g} % of a radiance of {brightest:.3g} may be mirrored"
        return EffectBound(float(max(changes)), reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: a mean of radiances is no brighter than they are."""
        return summary

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Camera state whose surfaces mirror."""
        return replace(camera_state, has_gloss=True)


EFFECT_TYPE = EffectType("Gloss", Gloss)
