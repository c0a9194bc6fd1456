"""A picture of which every ray is traced, in chunks over a few threads. Embree releases the GIL."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import numpy as np
import numpy.typing as npt

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import Image, RenderedImage
from catoptra_server.render.trace.packed_light import Colours, Float32s
from catoptra_server.render.trace.ray_samples import RaySamples
from catoptra_server.render.trace.ray_shader import RayShader, ViewTransform

# Rays a task: enough that the last ones to finish leave other threads idle only briefly, and not so
# few that handing tasks out shows.
_RAYS_PER_CHUNK = 40_000


RenderedColours = tuple[Colours, dict[str, float]]


class RayView:
    """The prepared rays of one picture."""

    def __init__(self, shader: RayShader, samples: RaySamples, pool: ThreadPoolExecutor) -> None:
        self._shader = shader
        self._samples = samples
        self._pool = pool
        self._chunks = split_rays(samples)

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Return the picture of an exposure."""
        rgb, stage_ms = self.render_colours(camera_state)
        return RenderedImage(cast(Image, rgb), stage_ms)

    def render_colours(self, camera_state: CameraState) -> RenderedColours:
        """Return an exposure as its colours are stored, and milliseconds by stage."""
        begin = time.perf_counter()
        samples = self._samples
        rgb = np.zeros((samples.height_px, samples.width_px, 3), dtype=self._shader.channel_dtype)
        placement = self._shader.transform_view(camera_state)

        def draw_chunk(chunk: RayChunk) -> None:
            chunk.render(rgb, self._shader, placement)

        list(self._pool.map(draw_chunk, self._chunks))
        rgb.setflags(write=False)
        return rgb, {"trace": 1e3 * (time.perf_counter() - begin)}

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""


@dataclass(frozen=True, slots=True, eq=False)
class RayChunk:
    """The pixels that one task draws, their rays, and which of these see no mirror."""

    pixels: npt.NDArray[np.intp]
    directions: Float32s
    off_mirror: npt.NDArray[np.intp]

    def render(self, rgb: Colours, shader: RayShader, transform: ViewTransform) -> None:
        """Write the chunk's pixels into a picture."""
        found = shader.shade_rays(self.directions, transform, off_mirror=self.off_mirror)
        rgb.reshape(-1).view(shader.pixel_dtype)[self.pixels] = found.view(
            shader.pixel_dtype
        ).reshape(-1)


def split_rays(samples: RaySamples) -> list[RayChunk]:
    """Return rays in chunks of a task each."""
    parts = -(-len(samples.directions) // _RAYS_PER_CHUNK)
    return [
        RayChunk(
            samples.pixels[pixels],
            samples.directions[rays],
            np.flatnonzero(~samples.on_mirror[rays]),
        )
        for pixels, rays in _slices(len(samples.pixels), parts, samples.samples_per_pixel)
    ]


def _slices(count: int, parts: int, per_pixel: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices of pixels and of their rays that cover `count` pixels in `parts` pieces."""
    borders = np.linspace(0, count, parts + 1).astype(int).tolist()
    for start, stop in pairwise(borders):
        yield slice(start, stop), slice(start * per_pixel, stop * per_pixel)
