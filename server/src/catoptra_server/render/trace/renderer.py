"""The trace renderer: rays of a view in chunks over a few threads. Embree releases the GIL.

A sample's radiance is looked up by the triangle that it meets; samples are averaged in linear light
and encoded last. With one sample a pixel and nothing that varies over a triangle, the encoded
colour itself is looked up, and a frame costs little more than its rays.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.plan.render_plan import RenderPlan
from catoptra_server.render.renderer import Exposure, FaceCamera, RenderedImage
from catoptra_server.render.trace.embree_scene import EmbreeScene, Float32s
from catoptra_server.render.trace.samples import RaySamples, face_samples, omni_samples
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh

# Linear light is encoded through a table: 16 bits are finer than a 256th of an sRGB step even in
# the darkest, steepest part of the curve (12.92 * 255 / 65535 = 0.05 steps).
_LEVELS = 65535
# Chunks a thread: enough that the last one to finish leaves the others idle only briefly.
_CHUNKS_PER_THREAD = 4


def _encoding_table() -> npt.NDArray[np.uint8]:
    linear = np.arange(_LEVELS + 1) / _LEVELS
    return np.rint(255.0 * srgb_from_linear(linear)).astype(np.uint8)


_ENCODED = _encoding_table()


def encoded(linear: Float32s) -> npt.NDArray[np.uint8]:
    """Return uint8 sRGB of linear radiance; light outside [0, 1] is clipped, as a sensor does."""
    return _ENCODED[(np.clip(linear, 0.0, 1.0) * _LEVELS + 0.5).astype(np.uint16)]


class TraceRenderer:
    """Embree on a thread pool. `threads` 0: one for each processor this process may use."""

    def __init__(self, scene: SceneMesh, world: World, *, threads: int = 0) -> None:
        self._threads = threads or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="trace")
        self._scene = EmbreeScene(scene, world)
        self._triangles = len(scene)

    def describe(self) -> str:
        """Return what draws, for logs."""
        return f"trace: Embree, {self._threads} threads, {self._triangles} triangles"

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> TraceView:
        """Return a view of the scene by an omnidirectional camera."""
        return TraceView(self._scene, omni_samples(camera, plan), self._pool, self._threads)

    def prepare_face(self, camera: FaceCamera, samples: int) -> TraceView:
        """Return a view of the scene by one virtual camera of the cube."""
        return TraceView(self._scene, face_samples(camera, samples), self._pool, self._threads)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()


class TraceView:
    """The prepared rays of one picture."""

    def __init__(
        self, scene: EmbreeScene, samples: RaySamples, pool: ThreadPoolExecutor, threads: int
    ) -> None:
        self._scene = scene
        self._samples = samples
        self._pool = pool
        self._chunks = list(_chunks(len(samples.pixels), threads * _CHUNKS_PER_THREAD))
        self._looks_up_colours = samples.per_pixel == 1 and not scene.needs_hit_points
        self._colours = encoded(scene.radiance)
        self._all_on_mirror = bool(samples.on_mirror.all())

    def draw(self, exposure: Exposure) -> RenderedImage:
        """Return the picture of an exposure."""
        begin = time.perf_counter()
        samples = self._samples
        rgb = np.zeros((samples.height_px * samples.width_px, 3), dtype=np.uint8)
        pose = exposure.world_from_mirror
        rotation = pose.rotation.T.astype(np.float32)
        origin = (pose.translation - self._scene.origin).astype(np.float32)
        list(
            self._pool.map(
                lambda chunk: self._draw_chunk(rgb, chunk, rotation, origin), self._chunks
            )
        )
        image = rgb.reshape(samples.height_px, samples.width_px, 3)
        image.setflags(write=False)
        return RenderedImage(image, {"trace": 1e3 * (time.perf_counter() - begin)})

    def _draw_chunk(
        self, rgb: npt.NDArray[np.uint8], chunk: slice, rotation: Float32s, origin: Float32s
    ) -> None:
        """Trace and shade the pixels of one chunk into the (pixels, 3) picture."""
        per_pixel = self._samples.per_pixel
        rays = slice(chunk.start * per_pixel, chunk.stop * per_pixel)
        directions = self._samples.directions[rays] @ rotation
        origins = np.broadcast_to(origin, directions.shape)
        pixels = self._samples.pixels[chunk]
        if self._looks_up_colours:
            rgb[pixels] = self._colours[self._scene.hit_triangles(origins, directions)]
            return
        rgb[pixels] = encoded(self._mean_radiance(origins, directions, rays))

    def _mean_radiance(self, origins: Float32s, directions: Float32s, rays: slice) -> Float32s:
        """Return the (pixels, 3) mean radiance of the samples of each pixel."""
        if self._scene.needs_hit_points:
            radiance = self._scene.hit_radiance(origins, directions)
        else:
            radiance = self._scene.radiance[self._scene.hit_triangles(origins, directions)]
        if not self._all_on_mirror:
            radiance *= self._samples.on_mirror[rays, None]
        mean: Float32s = radiance.reshape(-1, self._samples.per_pixel, 3).mean(axis=1)
        return mean

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""


def _chunks(count: int, parts: int) -> Iterator[slice]:
    """Yield slices that cover `count` elements in `parts` nearly equal pieces."""
    borders = np.linspace(0, count, parts + 1).astype(int)
    for start, stop in pairwise(borders):
        if stop > start:
            yield slice(int(start), int(stop))
