"""Angles between the samples of a mirror's image, for the level of a texture on a cube's face.

A face's texels are not the image's samples: how many of them a sample covers depends on where on
the mirror it is. The angles vary smoothly with the incidence angle, so a polynomial of their
logarithms holds them; glsl/include/texture_levels.glsl evaluates it.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.polynomial import Polynomial

from catoptra_protocol.optics.image_scale import compute_image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.raster.shader_programs import set_uniform

NUM_TERMS = 8
"""Coefficients of a polynomial; the bundled mirrors need them for an error below 1 %."""


@dataclass(frozen=True, slots=True, eq=False)
class SampleSpacing:
    """Angles between samples by the cosine of the incidence angle."""

    log_spacing: Floats
    """(8, 2) coefficients, lowest power first: logarithms of the radial and tangential angles."""
    cosine_limits: tuple[float, float]
    """Smallest and largest cosine in the image, where the polynomials' variable is -1 and 1."""

    def at(self, cosine: Floats) -> Floats:
        """(n, 2) radial and tangential angles between samples, rad; float64 twin of the shader."""
        low, high = self.cosine_limits
        x = np.clip((2.0 * cosine - low - high) / (high - low), -1.0, 1.0)
        powers = x[:, None] ** np.arange(NUM_TERMS)
        return np.exp(powers @ self.log_spacing)


def fit_spacing(camera: OmniCamera, samples: int) -> SampleSpacing:
    """Spacing of an image with `samples` along a pixel's side."""
    scale = compute_image_scale(camera)
    cosine = (1.0 - scale.t) * (1.0 + scale.t) / (1.0 + scale.t * scale.t)
    limits = (float(cosine.min()), float(cosine.max()))
    # Rings may crowd at one end of the cosines, as beside the antipode of a wide rim: even steps.
    even = np.linspace(*limits, 64)
    columns = [
        Polynomial.fit(even, np.interp(even, cosine[::-1], -np.log(row[::-1])), NUM_TERMS - 1).coef
        for row in (samples * scale.radial, samples * scale.tangential)
    ]
    return SampleSpacing(np.stack(columns, axis=-1), limits)


def set_spacing(program: moderngl.Program, spacing: SampleSpacing | None, axis: Floats) -> None:
    """Write the uniforms of a program that reads textures; no other program is changed.

    Args:
        spacing: None where the samples are the fragments themselves.
        axis: (3,) axis of the mirror, world axes.
    """
    if program.get("has_spacing", None) is None:
        return
    set_uniform(program, "has_spacing", float(spacing is not None))
    if spacing is not None:
        set_uniform(program, "log_spacing", spacing.log_spacing)
        set_uniform(program, "cosine_limits", spacing.cosine_limits)
        set_uniform(program, "spacing_axis", axis)
