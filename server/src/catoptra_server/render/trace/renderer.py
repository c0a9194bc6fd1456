"""The trace renderer: rays of a view in chunks over a few threads. Embree releases the GIL.

A sample's light is looked up by the triangle that it meets; samples are summed in linear light and
encoded last, by one more look-up: a frame costs little more than its rays.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.plan.render_plan import RenderPlan
from catoptra_server.render.renderer import Exposure, FaceCamera, RenderedImage
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.moving_bodies import BodyScenes, PlacedBody, body_hits
from catoptra_server.render.trace.packed_light import Float32s, LightScale, Packed
from catoptra_server.render.trace.samples import (
    RaySamples,
    face_samples,
    lens_samples,
    omni_samples,
)
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh

# Chunks a thread: enough that the last one to finish leaves the others idle only briefly.
_CHUNKS_PER_THREAD = 4
_PIXEL = np.dtype("V3")


class TraceRenderer:
    """Embree on a thread pool. `threads` 0: one for each processor this process may use."""

    def __init__(self, scene: SceneMesh, world: World, *, threads: int = 0) -> None:
        self._threads = threads or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="trace")
        self._scene = EmbreeScene(scene, world)
        self._bodies = BodyScenes(world.lights)
        self._triangles = len(scene)

    @property
    def body_meshes(self) -> int:
        """Return how many meshes of bodies were committed so far."""
        return len(self._bodies)

    def describe(self) -> str:
        """Return what draws, for logs."""
        return f"trace: Embree, {self._threads} threads, {self._triangles} triangles"

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> TraceView:
        """Return a view of the scene by an omnidirectional camera."""
        return self._view(omni_samples(camera, plan))

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> TraceView:
        """Return a view of the scene by an ordinary camera."""
        return self._view(lens_samples(camera, samples))

    def prepare_face(self, camera: FaceCamera, samples: int) -> TraceView:
        """Return a view of the scene by one virtual camera of the cube."""
        return self._view(face_samples(camera, samples))

    def _view(self, samples: RaySamples) -> TraceView:
        return TraceView(self._scene, self._bodies, samples, self._pool, self._threads)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()


class TraceView:
    """The prepared rays of one picture."""

    def __init__(
        self,
        scene: EmbreeScene,
        bodies: BodyScenes,
        samples: RaySamples,
        pool: ThreadPoolExecutor,
        threads: int,
    ) -> None:
        self._scene = scene
        self._bodies = bodies
        self._samples = samples
        self._pool = pool
        self._scale = LightScale.for_samples(samples.per_pixel)
        self._table = scene.light_table(self._scale)
        self._chunks = [
            _Chunk.of(samples, pixels)
            for pixels in _slices(len(samples.pixels), threads * _CHUNKS_PER_THREAD)
        ]

    def draw(self, exposure: Exposure) -> RenderedImage:
        """Return the picture of an exposure."""
        begin = time.perf_counter()
        samples, pose = self._samples, exposure.world_from_mirror
        rgb = np.zeros((samples.height_px * samples.width_px, 3), dtype=np.uint8)
        rotation = pose.rotation.T.astype(np.float32)
        origin = (pose.translation - self._scene.origin).astype(np.float32)
        bodies = self._bodies.placed(exposure.bodies, pose.translation, self._scale)

        # Three bytes as one element: twice as fast as rows of three to scatter.
        whole_pixels = rgb.view(_PIXEL).reshape(-1)

        def draw_chunk(chunk: _Chunk) -> None:
            colours = self._colours(chunk, rotation, origin, bodies)
            whole_pixels[chunk.pixels] = colours.view(_PIXEL).reshape(-1)

        list(self._pool.map(draw_chunk, self._chunks))
        image = rgb.reshape(samples.height_px, samples.width_px, 3)
        image.setflags(write=False)
        return RenderedImage(image, {"trace": 1e3 * (time.perf_counter() - begin)})

    def _colours(
        self,
        chunk: _Chunk,
        rotation: Float32s,
        origin: Float32s,
        bodies: tuple[PlacedBody, ...],
    ) -> npt.NDArray[np.uint8]:
        """Return the (pixels, 3) colours of one chunk."""
        directions = chunk.directions @ rotation
        origins = np.broadcast_to(origin, directions.shape)
        light = self._scene.hit_light(origins, directions, table=self._table, scale=self._scale)
        if bodies:
            self._add_bodies(light, bodies, directions, origin)
        light[chunk.off_mirror] = 0
        return self._scale.colours(self._scale.pixel_sums(light))

    def _add_bodies(
        self,
        light: Packed,
        bodies: tuple[PlacedBody, ...],
        directions: Float32s,
        origin: Float32s,
    ) -> None:
        """Replace the light of rays that meet a body which the scene does not hide."""
        rays, distance, of_bodies = body_hits(bodies, directions, self._scale)
        if not len(rays):
            return
        along = directions[rays]
        hidden = self._scene.hidden(np.broadcast_to(origin, along.shape), along, distance)
        light[rays[~hidden]] = of_bodies[~hidden]

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""


@dataclass(frozen=True, slots=True, eq=False)
class _Chunk:
    """The pixels that one task draws, their rays, and which of these see no mirror."""

    pixels: npt.NDArray[np.intp]
    directions: Float32s
    off_mirror: npt.NDArray[np.intp]

    @classmethod
    def of(cls, samples: RaySamples, pixels: slice) -> _Chunk:
        rays = slice(pixels.start * samples.per_pixel, pixels.stop * samples.per_pixel)
        return cls(
            samples.pixels[pixels],
            samples.directions[rays],
            np.flatnonzero(~samples.on_mirror[rays]),
        )


def _slices(count: int, parts: int) -> Iterator[slice]:
    """Yield slices that cover `count` elements in `parts` nearly equal pieces."""
    borders = np.linspace(0, count, parts + 1).astype(int)
    for start, stop in pairwise(borders):
        if stop > start:
            yield slice(int(start), int(stop))
