"""The rays of a camera: one direction a sample, in the mirror frame, float32 for Embree.

Computed once per view in float64, from the camera model or from the mirror mesh that replaces it.
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
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.robot.render_settings import PerPixel


@dataclass(frozen=True, slots=True, eq=False)
class RaySamples:
    """The rays of an image, for pixels with at least one valid ray."""

    width_px: int
    """Columns of the image."""
    height_px: int
    """Rows of the image."""
    samples_per_pixel: int
    """Rays of each pixel."""
    pixels: npt.NDArray[np.intp]
    """(p,) flat indices of pixels."""
    directions: npt.NDArray[np.float32]
    """(p * samples_per_pixel, 3) unit directions, pixel by pixel."""
    on_mirror: Bools
    """(p * samples_per_pixel,) whether each sample sees the mirror; always True for a lens."""

    def select(self, mask: Bools) -> RaySamples:
        """Rays of the pixels in a (p,) mask."""
        # The rays of a pixel are consecutive.
        rays = np.repeat(mask, self.samples_per_pixel)
        return replace(
            self,
            pixels=self.pixels[mask],
            directions=self.directions[rays],
            on_mirror=self.on_mirror[rays],
        )


def omni_rays(camera: OmniCamera, plan: RenderPlan) -> RaySamples:
    """Rays of an omnidirectional camera, by the camera model or by the plan's mirror mesh."""
    grid = pixel_sample_positions(camera, plan.samples)
    if isinstance(plan.surface, PerPixel):
        directions, valid = direction_from_pixel(camera, grid)
    else:
        directions, valid = mirror_mesh_directions(camera, plan.surface, grid)
    return _make_samples(directions, valid)


def lens_rays(camera: Lens, samples: int, mirror_from_camera: Floats | None = None) -> RaySamples:
    """Rays of a perspective camera, rotated by a (3, 3) rotation if there is one."""
    directions, valid = camera.direction_from_pixel(pixel_sample_positions(camera, samples))
    if mirror_from_camera is not None:
        # Rotated here, in float64, so that a face's rays need no rotation of their own per frame.
        directions = directions @ mirror_from_camera.T
    return _make_samples(directions, valid)


def face_rays(camera: FaceCamera, samples: int) -> RaySamples:
    """Rays of one virtual camera of the cube."""
    return lens_rays(camera.perspective_camera, samples, camera.mirror_from_camera)


def _make_samples(directions: Floats, valid: Bools) -> RaySamples:
    """Samples of (h, w, per_pixel, 3) directions and (h, w, per_pixel) validity."""
    height, width, per_pixel = valid.shape
    # Pixels off the mirror stay black without a ray: 1 - pi/4 of a square image with inscribed rim.
    pixels = np.flatnonzero(valid.any(axis=-1))
    directions_of_pixels = directions.reshape(height * width, per_pixel, 3)[pixels]
    return RaySamples(
        width_px=width,
        height_px=height,
        samples_per_pixel=per_pixel,
        pixels=pixels,
        directions=np.ascontiguousarray(directions_of_pixels.reshape(-1, 3), dtype=np.float32),
        on_mirror=valid.reshape(height * width, per_pixel)[pixels].reshape(-1),
    )
