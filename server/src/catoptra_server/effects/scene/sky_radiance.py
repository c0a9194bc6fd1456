"""Sky radiance: that of the sky by direction, where a world has `Sky=` or a panorama.

Not a change of the image but of what rays show that meet nothing. Without the effect that is the
mean of the sky; light by the sky stays. Domain: cameras of such a world that name no mode decide by
the criterion. Criterion: the difference between the sky's least and largest radiances.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import AVERAGING, EffectBound, EffectType, Gains, SceneSummary
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.world.objects import CameraState


@dataclass(frozen=True, slots=True)
class SkyRadiance:
    """Sky by direction. No parameters: the world's file has the sky."""

    name: ClassVar[str] = "SkyRadiance"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"background_radiance"})

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change between the darkest and the brightest of the sky."""
        if summary.background_radiance is None:
            return EffectBound(255.0, "nothing is known of the background")
        least, largest = (np.array(one)[None] for one in summary.background_radiance)
        change = float(find_changes(largest, least, summary.gains).max())
        if change == 0.0:
            return EffectBound(0.0, "the background has one colour")
        return EffectBound(change, f"radiances from {least.min():.3g} to {largest.max():.3g}")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: it counts with the brightest of the sky."""
        return summary

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Return the same state: `apply_scene_effects` takes from it what is left out."""
        return camera_state


EFFECT_TYPE = EffectType("SkyRadiance", SkyRadiance)
