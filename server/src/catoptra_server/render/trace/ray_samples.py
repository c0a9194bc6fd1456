"""Which rays a camera sends out: one direction a sample, in the mirror frame, float32 for Embree.

Computed once a view in float64 from the camera law, or from the polygon mirror that stands in for
it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.lenses import Lens
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_server.render.render_plan import PerPixel, RenderPlan
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions


@dataclass(frozen=True, slots=True, eq=False)
class RaySamples:
    """The rays of a picture, only of pixels that have at least one.

    pixels: (p,) flat index of each such pixel. directions: (p * per_pixel, 3) float32 unit vectors,
    pixel by pixel. on_mirror: (p * per_pixel,) False where a sample of such a pixel sees no mirror.
    """

    width_px: int
    height_px: int
    samples_per_pixel: int
    pixels: npt.NDArray[np.intp]
    directions: npt.NDArray[np.float32]
    on_mirror: Bools

    def select(self, mask: Bools) -> RaySamples:
        """Return the rays of the (p,) chosen pixels."""
        rays = np.repeat(mask, self.samples_per_pixel)
        return replace(
            self,
            pixels=self.pixels[mask],
            directions=self.directions[rays],
            on_mirror=self.on_mirror[rays],
        )


def omni_rays(camera: OmniCamera, plan: RenderPlan) -> RaySamples:
    """Return the rays of an omnidirectional camera, by the law or by the plan's polygon mirror."""
    grid = pixel_sample_positions(camera, plan.samples)
    if isinstance(plan.surface, PerPixel):
        directions, valid = direction_from_pixel(camera, grid)
    else:
        directions, valid = mirror_mesh_directions(camera, plan.surface, grid)
    return _make_samples(directions, valid)


def lens_rays(camera: Lens, samples: int, mirror_from_camera: Floats | None = None) -> RaySamples:
    """Return the rays of a camera with a lens, turned by a (3, 3) rotation if there is one."""
    directions, valid = camera.direction_from_pixel(pixel_sample_positions(camera, samples))
    if mirror_from_camera is not None:
        directions = directions @ mirror_from_camera.T
    return _make_samples(directions, valid)


def face_rays(camera: FaceCamera, samples: int) -> RaySamples:
    """Return the rays of one virtual camera of the cube."""
    return lens_rays(camera.perspective_camera, samples, camera.mirror_from_camera)


def _make_samples(directions: Floats, valid: Bools) -> RaySamples:
    """Return samples of (h, w, per_pixel, 3) directions and (h, w, per_pixel) validity."""
    height, width, per_pixel = valid.shape
    pixels = np.flatnonzero(valid.any(axis=-1))
    kept = directions.reshape(height * width, per_pixel, 3)[pixels]
    return RaySamples(
        width_px=width,
        height_px=height,
        samples_per_pixel=per_pixel,
        pixels=pixels,
        directions=np.ascontiguousarray(kept.reshape(-1, 3), dtype=np.float32),
        on_mirror=valid.reshape(height * width, per_pixel)[pixels].reshape(-1),
    )
