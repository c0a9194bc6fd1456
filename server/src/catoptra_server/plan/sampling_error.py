"""What a finite number of samples leaves of a picture whose every sample is in its place.

A sample stands for a square of the image. A thing is shown with the squares whose middles it
covers, so its outline is displaced by half a square's diagonal at most, in any direction and for
any shape; a disc's middle by less, 0.59 of a side, for discs that cover one or four samples. Edges
that are displaced alike on all sides cancel: the middle of a larger disc is found much better.

Where a face's texels are denser than the samples, one bilinear tap a sample passes over texels:
things there flicker, or vanish. Where they are sparser, the picture is blurred.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.plan.face_texels import face_scale
from catoptra_server.plan.render_plan import RendererKind, RenderPlan


@dataclass(frozen=True, slots=True)
class TexelDensity:
    """Texels a pixel over the image: fewest, the median of the mean of both directions, most."""

    min_per_px: float
    median_per_px: float
    max_per_px: float


@dataclass(frozen=True, slots=True)
class SamplingError:
    """samples: along a pixel's side. edge_px: of outlines. texels: of the faces; trace has none."""

    samples: int
    edge_px: float
    texels: TexelDensity | None

    @property
    def minification(self) -> float:
        """Return the most texels from one sample to the next; 0 without faces."""
        return self.texels.max_per_px / self.samples if self.texels else 0.0

    @property
    def magnification(self) -> float:
        """Return the most samples from one texel to the next; 0 without faces."""
        return self.samples / self.texels.min_per_px if self.texels else 0.0

    @property
    def one_tap_undersamples(self) -> bool:
        """Return whether somewhere one look-up a sample passes over texels."""
        return self.minification > 1.0


def sampling_error(camera: OmniCamera, plan: RenderPlan) -> SamplingError:
    """Return what the plan's samples leave in a camera's image."""
    is_raster = plan.renderer is RendererKind.RASTER
    return SamplingError(
        samples=plan.samples,
        edge_px=math.sqrt(0.5) / plan.samples,
        texels=texel_density(camera, plan.face_size_px) if is_raster else None,
    )


def texel_density(camera: OmniCamera, face_size_px: int) -> TexelDensity:
    """Return the texels a pixel of faces of a size, where the image shows the mirror."""
    scale = face_scale(camera)
    texels = 0.5 * face_size_px
    return TexelDensity(
        min_per_px=texels * scale.min_units_per_px,
        median_per_px=texels * scale.median_units_per_px,
        max_per_px=texels * scale.max_units_per_px,
    )
