"""What a finite number of samples leaves of a picture whose every sample is in its place.

A sample stands for a square of the image. A thing is shown with the squares whose middles it
covers, so its outline is displaced by half a square's diagonal at most, in any direction and for
any shape. What a frame keeps of that is each pixel's share of light. The middle of a disc, measured
as the centroid of that light, is displaced no more than its outline by the samples, and a little
by the pixels; a disc smaller than a pixel is somewhere in it.

Where a face's texels are denser than the samples, one bilinear tap a sample passes over texels:
things there flicker, or vanish. Where they are sparser, the picture is blurred.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.texel_footprint import TexelFootprint, texel_footprint
from catoptra_server.render.render_plan import RendererKind, RenderPlan

# Of the centroid of a disc from one pixel wide on, drawn with endlessly many samples; less for
# larger ones. Searched in tests/server/planning/test_sampling_error.py.
PIXEL_CENTROID_ERROR_PX = 0.07


@dataclass(frozen=True, slots=True)
class SamplingError:
    """samples: along a pixel's side. edge_error_px: of outlines. texels: of the faces; trace has none."""

    samples: int
    edge_error_px: float
    texel_footprint: TexelFootprint | None

    @property
    def centroid_error_px(self) -> float:
        """Return how far off the centroid of a disc of a pixel or more may be, if seen."""
        return self.edge_error_px + PIXEL_CENTROID_ERROR_PX

    @property
    def minification(self) -> float:
        """Return the most texels from one sample to the next; 0 without faces."""
        return (
            self.texel_footprint.max_texels_per_px / self.samples if self.texel_footprint else 0.0
        )

    @property
    def is_undersampled(self) -> bool:
        """Return whether somewhere one look-up a sample passes over texels."""
        return self.minification > 1.0


def sampling_error(camera: OmniCamera, plan: RenderPlan) -> SamplingError:
    """Return what the plan's samples leave in a camera's image."""
    is_raster = plan.renderer is RendererKind.RASTER
    return SamplingError(
        samples=plan.samples,
        edge_error_px=math.sqrt(0.5) / plan.samples,
        texel_footprint=texel_footprint(camera, plan.face_regions) if is_raster else None,
    )
