"""Error of a finite number of samples in an image whose every sample is exact.

A sample stands for a square of the image. A surface is shown with the squares whose centres its
image covers, so an outline is displaced by half a square's diagonal at most, in any direction and
for any shape. A frame keeps the mean of each pixel's samples. The centre of a disc, measured as the
centroid of that light, is displaced by the samples no more than its outline, and a little by the
pixels; a disc smaller than a pixel can lie anywhere in its pixel.

With texels denser than samples, one bilinear lookup a sample skips texels: small objects flicker or
vanish. With texels sparser than samples, the image is blurred.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.planning.texel_footprint import TexelFootprint, texel_footprint
from catoptra_server.render.renderer import RenderPlan

# Largest displacement of the centroid of a disc one pixel wide, in the limit of infinitely many
# samples; less for larger discs. Searched in tests/server/planning/test_sampling_error.py.
PIXEL_CENTROID_ERROR_PX = 0.07


@dataclass(frozen=True, slots=True)
class SamplingError:
    """Error of a plan's samples."""

    samples: int
    """Samples along a pixel's side."""
    edge_error_px: float
    """Largest displacement of an outline."""
    texel_footprint: TexelFootprint | None
    """Texels of the faces; None without faces."""

    @property
    def centroid_error_px(self) -> float:
        """Largest displacement of the measured centroid of a disc of one pixel or more."""
        return self.edge_error_px + PIXEL_CENTROID_ERROR_PX

    @property
    def minification(self) -> float:
        """Largest number of texels from one sample to the next; 0 without faces."""
        return (
            self.texel_footprint.max_texels_per_px / self.samples if self.texel_footprint else 0.0
        )

    @property
    def is_undersampled(self) -> bool:
        """Whether one lookup a sample skips texels anywhere in the image."""
        return self.minification > 1.0


def sampling_error(camera: OmniCamera, plan: RenderPlan) -> SamplingError:
    """Error of a plan's samples in a camera's image."""
    has_texels = plan.renderer.uses_faces
    return SamplingError(
        samples=plan.samples,
        edge_error_px=math.sqrt(0.5) / plan.samples,
        texel_footprint=texel_footprint(camera, plan.face_regions) if has_texels else None,
    )
