"""The yardstick: embreex's own `run` and NumPy around it, as a competent user would write it.

Directions of all rays are computed once; a frame turns them by one matrix product and looks colours
up. Constant light: one sRGB colour a triangle. Textures: bilinear texels in linear light, then a
table of encoded greys. Nothing of catoptra_server.render is used. embreex releases the GIL, so
chunks of rays run on a thread pool; which number of threads and chunks is fastest is tried first.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World
from cost.numpy_shading import ColourTable, RayShading, TexturedShading

Float32s = npt.NDArray[np.float32]

# Chunks of rays that are tried: the first on one thread, the others on one thread a processor.
CHUNKS = (1, 2, 8, 24)
TRIAL_FRAMES = 5
_RGB = np.dtype("V3")  # a pixel as one element: NumPy copies it at once


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays of consecutive pixels."""

    pixels: npt.NDArray[np.intp]
    """(p,) flat indices in the image."""
    directions: Float32s
    """(p * samples, 3) unit directions, mirror frame."""
    off_mirror: npt.NDArray[np.intp]
    """Rays that do not see the mirror, black."""


class EmbreexNumpy:
    """A scene in embreex, and the rays of one camera."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        """Commit the triangles and tabulate their light."""
        self._embree = rtcore_scene.EmbreeScene()
        TriangleMesh(self._embree, scene.corners.astype(np.float32))
        self._scene, self._world = scene, world
        self._threads = len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self._threads)

    def prepare(self, camera: OmniCamera, samples: int, state: CameraState) -> EmbreexView:
        """View of a camera with the fastest of the chunks, found by frames of one state."""
        is_textured = bool((self._scene.texture_index >= 0).any())
        kind = TexturedShading if is_textured else ColourTable
        shading = kind(self._scene, self._world, self._embree, samples**2)
        rays = make_rays(camera, samples)
        views = [
            EmbreexView(camera, shading, split_rays(rays, n), self._pool if n > 1 else None)
            for n in CHUNKS
        ]
        # In turns, and the fastest frame of each: other load disturbs the choice least.
        trials = [[_frame_s(view, state) for view in views] for _ in range(TRIAL_FRAMES)]
        return views[int(np.argmin(np.min(trials, axis=0)))]

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()


class EmbreexView:
    """Rays of a camera in chunks."""

    def __init__(
        self,
        camera: OmniCamera,
        shading: RayShading,
        chunks: list[Rays],
        pool: ThreadPoolExecutor | None,
    ) -> None:
        """Keep the chunks; without a pool the caller's thread renders them."""
        self._shape = camera.height_px, camera.width_px, 3
        self._shading, self._chunks, self._pool = shading, chunks, pool

    def describe(self) -> str:
        """Number of chunks and where they run."""
        return f"{len(self._chunks)} chunks on {'a pool' if self._pool else 'one thread'}"

    def render(self, state: CameraState) -> npt.NDArray[np.uint8]:
        """(h, w, 3) sRGB image of the static scene."""
        image = np.zeros(self._shape, dtype=np.uint8)
        pixels = image.reshape(-1).view(_RGB)
        pose = state.world_from_mirror
        turn, origin = (x.astype(np.float32) for x in (pose.rotation.T, pose.translation))

        def render_chunk(rays: Rays) -> None:
            directions = rays.directions @ turn
            origins = np.broadcast_to(origin, directions.shape)
            colours = self._shading.shade(origins, directions, rays.off_mirror)
            pixels[rays.pixels] = colours.view(_RGB).reshape(-1)

        if self._pool is None:
            for rays in self._chunks:
                render_chunk(rays)
        else:
            list(self._pool.map(render_chunk, self._chunks))
        return image


def make_rays(camera: OmniCamera, samples: int) -> Rays:
    """Rays of all pixels of which at least one sample sees the mirror."""
    positions = pixel_sample_positions(camera, samples)
    directions, valid = direction_from_pixel(camera, positions)
    directions, valid = directions.reshape(-1, samples**2, 3), valid.reshape(-1, samples**2)
    pixels = np.flatnonzero(valid.any(axis=-1))
    return Rays(
        pixels,
        directions[pixels].reshape(-1, 3).astype(np.float32),
        np.flatnonzero(~valid[pixels].reshape(-1)),
    )


def split_rays(rays: Rays, count: int) -> list[Rays]:
    """Rays in `count` chunks of whole pixels."""
    per_pixel = len(rays.directions) // len(rays.pixels)
    is_off = np.zeros(len(rays.directions), dtype=bool)
    is_off[rays.off_mirror] = True
    bounds = np.linspace(0, len(rays.pixels), count + 1).astype(int)
    slices = [slice(a, b) for a, b in pairwise(bounds)]
    chunks = [(part, slice(part.start * per_pixel, part.stop * per_pixel)) for part in slices]
    return [
        Rays(rays.pixels[part], rays.directions[own], np.flatnonzero(is_off[own]))
        for part, own in chunks
    ]


def _frame_s(view: EmbreexView, state: CameraState) -> float:
    """Seconds of one frame."""
    begin = time.perf_counter()
    view.render(state)
    return time.perf_counter() - begin
