"""The two engines of the trace renderer behind one interface: native kernel and NumPy reference.

An engine holds a scene; `prepare` gives it the rays of a camera. Both shade by the same model
(`scene/shading`) and agree to one grey level wherever all samples of a pixel meet one surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import Image, LinearImage
from catoptra_server.render.trace.ray_table import Float32s, RayTable

STATIC_SCENE = 0
"""Object number of the static scene; dynamic objects follow in the order of the camera state."""
NOTHING = -1
"""Object and triangle number of a ray without a hit."""


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """What each ray of an image meets first, in the layout of the ray table.

    Invalid rays meet nothing.
    """

    range_m: Float32s
    """(t, samples^2, 16) distances along the rays, metres; inf where nothing is met."""
    triangle: npt.NDArray[np.int32]
    """(t, samples^2, 16) index of the triangle in the scene's or the object's mesh, or NOTHING."""
    object: npt.NDArray[np.int32]
    """(t, samples^2, 16) STATIC_SCENE, 1 + index of a dynamic object, or NOTHING."""


class TracedRays(Protocol):
    """The rays of one camera, prepared by an engine."""

    @property
    def memory_bytes(self) -> int:
        """Size of the rays and of the engine's tables for them."""

    def render_srgb(self, camera_state: CameraState) -> Image:
        """(h, w, 3) sRGB of one sharp exposure, read-only; black off the mirror."""

    def render_linear(self, camera_state: CameraState) -> LinearImage:
        """(h, w, 3) linear light of one sharp exposure; zero off the mirror."""

    def find_hits(self, camera_state: CameraState) -> RayHits:
        """First hit of each ray."""

    def close(self) -> None:
        """Free what belongs to these rays."""


class TraceEngine(Protocol):
    """A scene, ready to be traced."""

    @property
    def description(self) -> str:
        """Engine, instruction set, packet width and threads, for logs."""

    def prepare(self, rays: RayTable) -> TracedRays:
        """Prepare the rays of a camera."""

    def close(self) -> None:
        """Free the scene."""


def pixel_ranges(rays: RayTable, hits: RayHits) -> Float32s:
    """(h, w) distances of an image of one sample a pixel, metres; inf where nothing is met.

    Args:
        rays: Table of one sample a pixel.
        hits: Hits of these rays.
    """
    return assemble_grid(rays, hits.range_m[..., None], fill=np.float32(np.inf))[..., 0]


def assemble_grid(
    rays: RayTable, values: npt.NDArray[np.float32], *, fill: np.float32
) -> npt.NDArray[np.float32]:
    """(h * samples, w * samples, k) grid of (t, samples^2, 16, k) values of rays.

    Args:
        rays: Table that the values belong to.
        values: Values in the table's layout.
        fill: Value of samples in tiles without a ray.
    """
    samples, depth = rays.samples, values.shape[-1]
    side = 4 * samples
    rows, columns = -(-rays.height_px // 4), rays.num_tile_columns
    tiles = np.full((rows * columns, side, side, depth), fill, dtype=np.float32)
    blocks = values.reshape(-1, samples, samples, 4, 4, depth)
    tiles[rays.tiles] = blocks.transpose(0, 1, 3, 2, 4, 5).reshape(-1, side, side, depth)
    grid = tiles.reshape(rows, columns, side, side, depth).transpose(0, 2, 1, 3, 4)
    whole = grid.reshape(rows * side, columns * side, depth)
    return whole[: rays.height_px * samples, : rays.width_px * samples]
