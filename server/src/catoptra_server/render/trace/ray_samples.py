"""The rays of a camera: one direction a sample, in the mirror frame, float32 for Embree.

Computed once per view in float64, from the camera model or from the mirror mesh that replaces it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.lenses import Lens
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    ImageSize,
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.robot.render_settings import PerPixel

# Float64 directions and what they are computed from take 130 bytes a sample, the result 13: a batch
# takes 70 MB, where a whole image of 8192 px took 8 GB.
_SAMPLES_PER_BATCH = 2**19


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

    @property
    def memory_bytes(self) -> int:
        """Size of the arrays."""
        return self.pixels.nbytes + self.directions.nbytes + self.on_mirror.nbytes

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
    if isinstance(plan.surface, PerPixel):
        return _make_samples(camera, plan.samples, partial(direction_from_pixel, camera))
    look_up = partial(mirror_mesh_directions, camera, plan.surface)
    return _make_samples(camera, plan.samples, look_up)


def lens_rays(camera: Lens, samples: int, mirror_from_camera: Floats | None = None) -> RaySamples:
    """Rays of a perspective camera, rotated by a (3, 3) rotation if there is one."""

    def look_up(pixels: Floats) -> tuple[Floats, Bools]:
        directions, valid = camera.direction_from_pixel(pixels)
        # Rotated here, in float64, so that a face's rays need no rotation of their own per frame.
        return (
            directions if mirror_from_camera is None else directions @ mirror_from_camera.T,
            valid,
        )

    return _make_samples(camera, samples, look_up)


def face_rays(camera: FaceCamera, samples: int) -> RaySamples:
    """Rays of one virtual camera of the cube."""
    return lens_rays(camera.perspective_camera, samples, camera.mirror_from_camera)


def _make_samples(
    camera: ImageSize,
    samples_per_side: int,
    look_up: Callable[[Floats], tuple[Floats, Bools]],
) -> RaySamples:
    """Samples of an image, computed in batches of rows.

    Args:
        camera: size of the image.
        samples_per_side: samples along a pixel's side.
        look_up: (..., 3) directions of (..., 2) pixel positions, and their (...,) validity.
    """
    per_pixel = samples_per_side**2
    num_pixels = camera.width_px * camera.height_px
    # Zeros of the whole image, filled from the front: pages beyond the last valid pixel are never
    # resident, and joining the batches would take twice the memory.
    pixels = np.zeros(num_pixels, dtype=np.intp)
    directions = np.zeros((num_pixels, per_pixel, 3), dtype=np.float32)
    on_mirror = np.zeros((num_pixels, per_pixel), dtype=bool)
    end = 0
    for rows in _split_rows(camera, per_pixel):
        found, valid = look_up(pixel_sample_positions(camera, samples_per_side, rows=rows))
        found, valid = found.reshape(-1, per_pixel, 3), valid.reshape(-1, per_pixel)
        # Pixels off the mirror stay black without a ray: 1 - pi/4 of a square image with inscribed
        # rim.
        shown = np.flatnonzero(valid.any(axis=-1))
        batch = slice(end, end := end + len(shown))
        pixels[batch] = shown + rows.start * camera.width_px
        directions[batch], on_mirror[batch] = found[shown], valid[shown]
    return RaySamples(
        width_px=camera.width_px,
        height_px=camera.height_px,
        samples_per_pixel=per_pixel,
        pixels=pixels[:end],
        directions=directions[:end].reshape(-1, 3),
        on_mirror=on_mirror[:end].reshape(-1),
    )


def _split_rows(camera: ImageSize, samples_per_pixel: int) -> Iterator[range]:
    """Yield the rows of an image in batches of at most _SAMPLES_PER_BATCH samples."""
    num_rows = max(1, _SAMPLES_PER_BATCH // (camera.width_px * samples_per_pixel))
    for first in range(0, camera.height_px, num_rows):
        yield range(first, min(first + num_rows, camera.height_px))
