"""Fog: the air between mirror and surface absorbs light and adds light of its own.

L' = L exp(-beta D) + A (1 - exp(-beta D)), D the range, beta the extinction per metre, A the
airlight, the same in all directions. The background, infinitely far away, has the colour of the
airlight. Source: Koschmieder's law. Domain: homogeneous fog; beta = 0 is clear air; the
meteorological visibility, a contrast of 5 %, is 3 / beta. Not a change of the image but of the air
in the scene: each renderer fogs every sample by its own distance (`FogMedium`), so that
outlines stay as smooth as in clear air. Criterion: the largest change, in encoded grey levels, of
any radiance from black to the brightest at the farthest surface's range, and of the background's
least and greatest at infinity. The background counts even if no pixel shows any: in a room without
an opening the thinnest fog is enabled, and the frame itself decides.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.elementary import exp, ln
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.world.objects import CameraState, FogMedium

# The change is largest at black or at the brightest radiance; the grid is for the kink of the sRGB
# curve, beside which the change may exceed both by a hundredth of its small value there.
_NUM_RADIANCES = 257


@dataclass(frozen=True, slots=True)
class Fog:
    """Homogeneous fog of one density and colour."""

    density_per_m: float
    """Extinction beta."""
    red: float
    """Airlight, linear radiance."""
    green: float
    blue: float

    name: ClassVar[str] = "Fog"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset(
        {"max_radiance", "max_distance_m", "background_radiance"}
    )

    @property
    def airlight(self) -> tuple[float, float, float]:
        """Linear RGB of the airlight."""
        return self.red, self.green, self.blue

    @property
    def medium(self) -> FogMedium | None:
        """The air; None if it is clear."""
        if self.density_per_m == 0.0:
            return None
        return FogMedium(self.density_per_m, self.airlight)

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Largest change of surfaces at the farthest range and of the background."""
        medium = self.medium
        if medium is None:
            return EffectBound(0.0, "the air is clear")
        brightest = summary.max_radiance
        # With those that just reach white, behind which the change ends.
        white = [min(brightest, 1.0 / gain) for gain in summary.gains if gain > 0.0]
        spaced = exp(np.linspace(ln(1e-7), 0.0, _NUM_RADIANCES)) * brightest
        radiances = np.concatenate(((0.0, *white), spaced))[:, None]
        percent = 100.0 * float(medium.transmittance(np.array(summary.max_distance_m)))
        surfaces = EffectBound(
            _max_change(medium, radiances, summary.max_distance_m, summary.gains),
            f"{percent:.3g} % of light passes {summary.max_distance_m:.3g} m of fog",
        )
        # Without a known background the airlight stands for it, and changes nothing.
        behind = np.asarray(summary.background_radiance or (self.airlight, self.airlight))
        background = EffectBound(
            _max_change(medium, behind, math.inf, summary.gains),
            "the background, where visible, has the airlight",
        )
        return max(surfaces, background, key=lambda bound: bound.value)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of a scene at least as bright as the airlight."""
        if self.density_per_m == 0.0:
            return summary
        brightest = max(summary.max_radiance, *self.airlight)
        return replace(
            summary, max_radiance=brightest, background_radiance=(self.airlight, self.airlight)
        )

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Camera state in the fog."""
        return replace(camera_state, fog=self.medium)


def _max_change(medium: FogMedium, radiance: Floats, range_m: float, gains: Gains) -> float:
    """Largest change of any of the radiances behind fog of a depth, grey levels."""
    fogged = medium.mix(radiance, np.array(range_m))
    return float(find_changes(fogged, radiance, gains).max())


EFFECT_TYPE = EffectType(
    "Fog",
    Fog,
    (
        EffectParameter("FogDensity", "density_per_m", 0.0, 0.0, 100.0),
        # Grey as an overcast sky, which scatters the same light into the fog.
        EffectParameter("FogRed", "red", 0.5, 0.0, 100.0),
        EffectParameter("FogGreen", "green", 0.5, 0.0, 100.0),
        EffectParameter("FogBlue", "blue", 0.5, 0.0, 100.0),
    ),
)
