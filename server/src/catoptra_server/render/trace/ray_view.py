"""An image of which every ray is traced, in chunks on a thread pool. Embree releases the GIL."""

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

# Rays per task: few enough that threads idle only briefly at the end of a frame, enough that the
# overhead per task does not show.
_RAYS_PER_CHUNK = 40_000


RenderedColours = tuple[Colours, dict[str, float]]


class RayView:
    """The prepared rays of one image."""

    def __init__(self, shader: RayShader, samples: RaySamples, pool: ThreadPoolExecutor) -> None:
        """Split the rays into one chunk per task."""
        self._shader = shader
        self._samples = samples
        self._pool = pool
        self._chunks = split_rays(samples)

    @property
    def memory_bytes(self) -> int:
        """Size of the tables, without the rays, which sources share."""
        return self._shader.memory_bytes + sum(chunk.off_mirror.nbytes for chunk in self._chunks)

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Render one exposure of the camera."""
        rgb, stage_ms = self.render_colours(camera_state)
        return RenderedImage(cast(Image, rgb), stage_ms)

    def render_colours(self, camera_state: CameraState) -> RenderedColours:
        """Render an exposure into the colours of the shader's scale; also milliseconds by stage."""
        begin = time.perf_counter()
        samples = self._samples
        rgb = np.zeros((samples.height_px, samples.width_px, 3), dtype=self._shader.channel_dtype)
        transform = self._shader.transform_view(camera_state)

        def render_chunk(chunk: RayChunk) -> None:
            chunk.render(rgb, self._shader, transform)

        # list() waits for all chunks and raises the first error of any.
        list(self._pool.map(render_chunk, self._chunks))
        # Frames are handed to other threads, which encode and send them while the next one is
        # rendered.
        rgb.setflags(write=False)
        return rgb, {"trace": 1e3 * (time.perf_counter() - begin)}

    def close(self) -> None:
        """Do nothing: all resources belong to the renderer."""


@dataclass(frozen=True, slots=True, eq=False)
class RayChunk:
    """The pixels of one task and their rays."""

    pixels: npt.NDArray[np.intp]
    """(p,) flat indices of pixels in the image."""
    directions: Float32s
    """(p * samples, 3) unit directions, mirror frame."""
    off_mirror: npt.NDArray[np.intp]
    """Indices of rays that do not see the mirror."""

    def render(self, rgb: Colours, shader: RayShader, transform: ViewTransform) -> None:
        """Write the chunk's pixels into an image."""
        colours = shader.shade_rays(self.directions, transform, off_mirror=self.off_mirror)
        # A pixel's bytes as one element: twice as fast to scatter as rows of three.
        rgb.reshape(-1).view(shader.pixel_dtype)[self.pixels] = colours.view(
            shader.pixel_dtype
        ).reshape(-1)


def split_rays(samples: RaySamples) -> list[RayChunk]:
    """Split rays into chunks of one task each."""
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
    bounds = np.linspace(0, count, parts + 1).astype(int).tolist()
    for start, stop in pairwise(bounds):
        yield slice(start, stop), slice(start * per_pixel, stop * per_pixel)
