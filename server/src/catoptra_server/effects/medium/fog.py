"""Fog: the air between mirror and surface absorbs light and adds light of its own.

L' = L exp(-beta D) + A (1 - exp(-beta D)), D the range at the pixel centre, beta the extinction per
metre, A the airlight, the same in all directions. The background, infinitely far away, has the
colour of the airlight. Source: Koschmieder's law. Domain: homogeneous fog; beta = 0 is clear air;
the meteorological visibility, a contrast of 5 %, is 3 / beta. Pixels outside the mirror do not
change. Both renderers fog each sample by its own distance where fog is the first of a frame's image
effects, as in the table (`take_fog`); by the range of the pixel behind another effect, which is off
at edges by the difference of the fog between both ranges. Criterion: the largest change, in encoded
grey levels, of any radiance from black to the brightest at the farthest surface's range, and of the
background, whose radiance is known, at infinity. The background counts even if no pixel shows any:
in a room without an opening the thinnest fog is enabled, and the frame itself decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import pixel_sample_positions
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.capture.fog_medium import FogMedium
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    EffectBound,
    EffectParameter,
    EffectType,
    ImageEffect,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.scene.colour import srgb_from_linear

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
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset(
        {"max_radiance", "max_distance_m", "background_radiance"}
    )
    needs_range: ClassVar[bool] = True

    @property
    def airlight(self) -> tuple[float, float, float]:
        """Linear RGB of the airlight."""
        return self.red, self.green, self.blue

    @np.errstate(under="ignore")  # exp of a large optical depth is 0, as intended
    def transmittance(self, range_m: npt.NDArray[Real]) -> npt.NDArray[Real]:
        """Fraction of light that passes through ranges; 0 at inf in any fog."""
        # Without this case clear air at infinity would be exp(0 * inf).
        if self.density_per_m == 0.0:
            return np.ones_like(range_m)
        transmitted: npt.NDArray[Real] = np.exp(range_m * range_m.dtype.type(-self.density_per_m))
        return transmitted

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Largest change of surfaces at the farthest range and of the background."""
        if self.density_per_m == 0.0:
            return EffectBound(0.0, "the air is clear")
        transmittance = float(self.transmittance(np.array(summary.max_distance_m)))
        brightest = min(summary.max_radiance, 1.0)
        radiances = np.append(0.0, np.geomspace(1e-7, 1.0, _NUM_RADIANCES) * brightest)[:, None]
        surfaces = EffectBound(
            self._max_change(radiances, transmittance),
            f"{100.0 * transmittance:.3g} % of light passes {summary.max_distance_m:.3g} m of fog",
        )
        # Without a known background the airlight stands for it, and changes nothing.
        behind = np.asarray(summary.background_radiance or self.airlight)
        background = EffectBound(
            self._max_change(behind, 0.0), "the background, where visible, has the airlight"
        )
        return max(surfaces, background, key=lambda bound: bound.value)

    def _max_change(self, radiance: Floats, transmittance: float) -> float:
        """Largest change of any of the radiances behind fog of a transmittance, grey levels."""
        fogged = radiance * transmittance + np.asarray(self.airlight) * (1.0 - transmittance)
        return 255.0 * float(np.abs(srgb_from_linear(fogged) - srgb_from_linear(radiance)).max())

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of a scene at least as bright as the airlight."""
        if self.density_per_m == 0.0:
            return summary
        brightest = max(summary.max_radiance, *self.airlight)
        return replace(summary, max_radiance=brightest, background_radiance=self.airlight)

    @np.errstate(under="ignore")
    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Mix the image with the airlight by each pixel's range."""
        assert context.range_m is not None, "fog needs ranges"
        transmittance = self.transmittance(context.range_m.astype(image.dtype))[..., None]
        airlight = np.asarray(self.airlight, dtype=image.dtype)
        # Pixels outside the mirror have an infinite range; the mask keeps them black.
        absorbed = (1 - transmittance) * mirror_mask(camera)
        return image * (1 - absorbed) + airlight * absorbed

    def uniforms(
        self,
        camera: RadialCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Density, airlight, and the mask of pixels that see the mirror."""
        return {
            "density_per_m": float32_array(self.density_per_m),
            "airlight": float32_array(*self.airlight),
            "mirror_mask": mirror_mask(camera),
        }


@lru_cache(maxsize=4)
def mirror_mask(camera: RadialCamera) -> npt.NDArray[np.float32]:
    """Mask, (h, w, 1): 1 where a pixel's centre sees the mirror, 0 elsewhere."""
    mask = camera.direction_from_pixel(pixel_sample_positions(camera))[1].astype(np.float32)
    mask.setflags(write=False)
    return mask


def take_fog(
    camera_state: CameraState, effects: tuple[ImageEffect, ...]
) -> tuple[CameraState, tuple[ImageEffect, ...]]:
    """Camera state in the fog that is first among the effects, and the other effects.

    Renderers know the distance of each sample: outlines stay as smooth as in clear air.
    """
    if not effects or not isinstance(effects[0], Fog):
        return camera_state, effects
    density_per_m = effects[0].density_per_m
    fog = FogMedium(density_per_m, effects[0].airlight) if density_per_m > 0.0 else None
    return replace(camera_state, fog=fog), effects[1:]


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
