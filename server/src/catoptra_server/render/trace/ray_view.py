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

from catoptra_server.render.renderer import Exposure, Image, RenderedImage
from catoptra_server.render.trace.packed_light import Colours, Float32s
from catoptra_server.render.trace.ray_colours import Colouring, Placement
from catoptra_server.render.trace.samples import RaySamples

# Rays a task: enough that the last ones to finish leave other threads idle only briefly, and not so
# few that handing tasks out shows.
_RAYS_PER_CHUNK = 40_000


Drawn = tuple[Colours, dict[str, float]]


class RayView:
    """The prepared rays of one picture."""

    def __init__(self, colours: Colouring, samples: RaySamples, pool: ThreadPoolExecutor) -> None:
        self._colours = colours
        self._samples = samples
        self._pool = pool
        self._chunks = ray_chunks(samples)

    def draw(self, exposure: Exposure) -> RenderedImage:
        """Return the picture of an exposure."""
        rgb, stage_ms = self.picture(exposure)
        return RenderedImage(cast(Image, rgb), stage_ms)

    def picture(self, exposure: Exposure) -> Drawn:
        """Return an exposure as its colours are stored, and milliseconds by stage."""
        begin = time.perf_counter()
        samples = self._samples
        rgb = np.zeros((samples.height_px, samples.width_px, 3), dtype=self._colours.channel)
        placement = self._colours.placed(exposure)

        def draw_chunk(chunk: RayChunk) -> None:
            chunk.draw(rgb, self._colours, placement)

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

    def draw(self, rgb: Colours, colours: Colouring, placement: Placement) -> None:
        """Write the chunk's pixels into a picture."""
        found = colours.of_rays(self.directions, placement, off_mirror=self.off_mirror)
        rgb.reshape(-1).view(colours.pixel)[self.pixels] = found.view(colours.pixel).reshape(-1)


def ray_chunks(samples: RaySamples) -> list[RayChunk]:
    """Return rays in chunks of a task each."""
    parts = -(-len(samples.directions) // _RAYS_PER_CHUNK)
    return [
        RayChunk(
            samples.pixels[pixels],
            samples.directions[rays],
            np.flatnonzero(~samples.on_mirror[rays]),
        )
        for pixels, rays in _slices(len(samples.pixels), parts, samples.per_pixel)
    ]


def _slices(count: int, parts: int, per_pixel: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices of pixels and of their rays that cover `count` pixels in `parts` pieces."""
    borders = np.linspace(0, count, parts + 1).astype(int).tolist()
    for start, stop in pairwise(borders):
        yield slice(start, stop), slice(start * per_pixel, stop * per_pixel)
