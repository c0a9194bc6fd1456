"""Rays of the pixels' centres, and of their samples: the exact camera model, in one table.

Of a displaced capture camera (`Misalignment`) each pixel has the ray of the point that its light
came from; of a rolling shutter each ray has the time of its row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera_rays import ray_from_pixel, rays_from_pixel_grid
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.medium.misalignment import Misalignment, lookup_offset_map
from catoptra_server.render.renderer import trajectory
from catoptra_server.render.trace.ray_table import (
    BLOCK_RAYS,
    TILE_PX,
    RayTable,
    build_ray_table,
    lens_ray_table,
)
from catoptra_server.render.trace.trace_engine import (
    MovingExposure,
    TracedExposure,
    assemble_grid,
)
from catoptra_server.world.camera_state import CameraState, Shutter

LabelCamera = OmniCamera | PerspectiveCamera


@dataclass(frozen=True, slots=True)
class RaySource:
    """Everything that the rays of an image depend on, but for the poses."""

    camera: LabelCamera
    misalignment: Misalignment | None = None
    """Displacement of the capture camera; None for an aligned one."""
    exposure_s: float = 0.0
    """Exposure time of a row; of no effect without a readout."""
    readout_s: float = 0.0
    """Readout time; 0 for a global shutter."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnExposure:
    """An exposure as its picture was drawn."""

    camera: LabelCamera
    """Exact model of the camera."""
    camera_state: CameraState
    """State with all objects that the picture shows, and its shutter."""
    image_effects: tuple[ImageEffect, ...] = ()
    """Image effects that the picture has."""
    samples: int = 1
    """Samples along a pixel's side."""

    @property
    def ray_source(self) -> RaySource:
        """Everything that the rays depend on, but for the poses."""
        displaced = (one for one in self.image_effects if isinstance(one, Misalignment))
        return make_ray_source(self.camera, next(displaced, None), self.camera_state.shutter)


def make_ray_source(
    camera: LabelCamera, misalignment: Misalignment | None, shutter: Shutter | None
) -> RaySource:
    """Source of the rays of a camera under the effects of a frame."""
    if shutter is None or shutter.readout_s == 0.0:
        return RaySource(camera, misalignment)
    return RaySource(camera, misalignment, shutter.exposure_s, shutter.readout_s)


def build_label_rays(source: RaySource, samples: int) -> RayTable:
    """Rays of an image.

    Args:
        source: Camera and effects.
        samples: Samples along a pixel's side; of 1 the pixels' centres.
    """
    table = _build_table(source, samples)
    return table if source.readout_s == 0.0 else replace(table, times=_row_times(source, table))


def _build_table(source: RaySource, samples: int) -> RayTable:
    camera = source.camera
    if isinstance(camera, PerspectiveCamera):
        return lens_ray_table(camera, samples)
    look_up: Callable[[Floats, Floats], tuple[Floats | None, Floats, Bools]]
    if source.misalignment is None:
        look_up = partial(rays_from_pixel_grid, camera)
    else:
        look_up = partial(_misaligned_rays, camera, source.misalignment)
    return build_ray_table(camera, samples, look_up)


def _misaligned_rays(
    camera: OmniCamera, misalignment: Misalignment, u: Floats, v: Floats
) -> tuple[Floats | None, Floats, Bools]:
    """Rays of a grid of a displaced camera: those of the points that its pixels look up."""
    lookup = lookup_offset_map(misalignment, camera)
    # Offsets vary by hundredths of a pixel from one pixel to the next: samples have their pixel's.
    # Tiles of the last row and column may reach beyond the image.
    rows = np.minimum(v.astype(np.intp), camera.height_px - 1)
    columns = np.minimum(u.astype(np.intp), camera.width_px - 1)
    at = lookup[rows[:, None], columns]
    points = np.stack(np.meshgrid(u, v), axis=-1) + at[..., :2]
    origins, directions, valid = ray_from_pixel(camera, points)
    return None if camera.is_central else origins, directions, valid & (at[..., 2] > 0.0)


def _row_times(source: RaySource, table: RayTable) -> npt.NDArray[np.float32]:
    """(t, samples^2, 16) times of rays within the whole exposure, 0 to 1, by their rows."""
    samples = table.samples
    block = np.arange(samples * samples) // samples
    lane = np.arange(BLOCK_RAYS) // TILE_PX
    row_in_tile = (block[:, None] * TILE_PX + lane) // samples
    row = (table.tiles // table.num_tile_columns * TILE_PX)[:, None, None] + row_in_tile
    total_s = source.exposure_s + source.readout_s
    fraction = (row + 0.5) / table.height_px - 0.5
    return np.asarray(0.5 + source.readout_s / total_s * fraction, dtype=np.float32)


def label_exposure(camera_state: CameraState) -> TracedExposure:
    """The exposure as its labels see it: sharp, at its middle or at each row's time."""
    # Neither light nor air has labels.
    plain = replace(camera_state, has_shadows=False, fog=None)
    shutter = plain.shutter
    if shutter is None or shutter.readout_s == 0.0:
        return replace(plain, shutter=None)
    return MovingExposure(trajectory(plain))


def mask_of_rays(table: RayTable) -> Bools:
    """(h, w) whether a pixel's centre has a ray, of a table of one sample a pixel."""
    bits = np.unpackbits(table.valid[..., None].view(np.uint8), axis=-1, bitorder="little")
    grid = assemble_grid(table, bits[..., None].astype(np.float32), fill=np.float32(0.0))
    return np.asarray(grid[..., 0] > 0.0)
