"""Fog: what lies between the mirror and a surface swallows its light, and adds its own.

L' = L exp(-beta D) + A (1 - exp(-beta D)), D the range of what the middle of a pixel sees, beta the
extinction of light a metre, A the airlight: the fog's own light, alike in all directions. What is
endlessly far away has the airlight's colour. Source: Koschmieder's law. Domain: fog that is the
same everywhere; beta 0 is none; where the eye loses contrast, at 5 %, beta is 3 over the distance.
Beside the mirror nothing changes. The error: a pixel that shows two surfaces has the range of one
of them, and one of several samples at the rim is all mirror if its middle is; so at edges a row of
pixels is off, by what the fog adds between both ranges, and at the rim by half of what it adds; the
criterion does not know of it. Criterion: how much light between black and the brightest changes at
the farthest surface's range, in encoded grey levels, and the background, whose light is known, at
an endless one. A background that is nowhere seen counts, too: a room without an opening runs even
the thinnest fog.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.scene.colour import srgb_from_linear

# The change has its extremes at black and at the brightest light; the grid is for the kink of the
# sRGB curve, beside which it may be larger by a hundredth of what little it is there.
_NUM_RADIANCES = 257


@dataclass(frozen=True, slots=True)
class Fog:
    """density_per_m: beta. red, green, blue: the airlight, linear."""

    density_per_m: float
    red: float
    green: float
    blue: float

    name: ClassVar[str] = "Fog"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = True

    @property
    def airlight(self) -> tuple[float, float, float]:
        """Return the fog's own colour, linear."""
        return self.red, self.green, self.blue

    @np.errstate(under="ignore")  # what vanishes does not come through
    def transmittance(self, range_m: npt.NDArray[Real]) -> npt.NDArray[Real]:
        """Return the part of light that comes through ranges; inf: none, if there is any fog."""
        if self.density_per_m == 0.0:
            return np.ones_like(range_m)
        through: npt.NDArray[Real] = np.exp(range_m * range_m.dtype.type(-self.density_per_m))
        return through

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the change of the light that changes most, at the farthest range."""
        if self.density_per_m == 0.0:
            return EffectBound(0.0, "the air is clear")
        least = float(self.transmittance(np.array(summary.max_distance_m)))
        top = min(summary.max_radiance, 1.0)
        any_light = np.append(0.0, np.geomspace(1e-7, 1.0, _NUM_RADIANCES) * top)[:, None]
        surfaces = EffectBound(
            self._max_change(any_light, least),
            f"{100.0 * least:.3g} % of light comes through {summary.max_distance_m:.3g} m of fog",
        )
        behind = np.asarray(summary.background_radiance or self.airlight)
        background = EffectBound(
            self._max_change(behind, 0.0),
            "the background, where it is seen, has the fog's own light",
        )
        return max(surfaces, background, key=lambda bound: bound.value)

    def _max_change(self, radiance: Floats, transmittance: float) -> float:
        """Return by how many grey levels light changes at most of which so much comes through."""
        fogged = radiance * transmittance + np.asarray(self.airlight) * (1.0 - transmittance)
        return 255.0 * float(np.abs(srgb_from_linear(fogged) - srgb_from_linear(radiance)).max())

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of a scene that is as bright as the fog where that is brighter."""
        if self.density_per_m == 0.0:
            return summary
        largest = max(summary.max_radiance, *self.airlight)
        return replace(summary, max_radiance=largest, background_radiance=self.airlight)

    @np.errstate(under="ignore")
    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture through the fog."""
        assert context.range_m is not None, "fog asks what each pixel sees"
        through = self.transmittance(context.range_m.astype(image.dtype))[..., None]
        airlight = np.asarray(self.airlight, dtype=image.dtype)
        lost = (1 - through) * mirror_mask(camera)
        return image * (1 - lost) + airlight * lost

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return density, airlight, and which pixels see the mirror."""
        return {
            "density_per_m": float32_array(self.density_per_m),
            "airlight": float32_array(*self.airlight),
            "mirror_mask": mirror_mask(camera),
        }


@lru_cache(maxsize=4)
def mirror_mask(camera: OmniCamera) -> npt.NDArray[np.float32]:
    """Return (h, w, 1): 1 where a pixel sees the mirror in its middle, 0 beside."""
    mask = direction_from_pixel(camera, pixel_sample_positions(camera))[1].astype(np.float32)
    mask.setflags(write=False)
    return mask


EFFECT_TYPE = EffectType(
    "Fog",
    Fog,
    (
        EffectParameter("FogDensity", "density_per_m", 0.0, 0.0, 100.0),
        # Grey as an overcast sky, which scatters the same light into it.
        EffectParameter("FogRed", "red", 0.5, 0.0, 100.0),
        EffectParameter("FogGreen", "green", 0.5, 0.0, 100.0),
        EffectParameter("FogBlue", "blue", 0.5, 0.0, 100.0),
    ),
)
