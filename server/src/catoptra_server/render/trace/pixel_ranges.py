"""Ranges at pixel centres: one ray each, against the scene and the dynamic objects."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import Float32s, SrgbScale
from catoptra_server.render.trace.ray_samples import omni_rays
from catoptra_server.render.trace.ray_view import RayChunk, split_rays

# Object instances carry packed radiance on some scale; ranges do not use the radiance.
_ANY_SCALE = 1


class PixelRangeTracer:
    """The prepared rays of one camera's pixel centres."""

    def __init__(
        self,
        scene: EmbreeScene,
        objects: EmbreeObjectScenes,
        camera: OmniCamera,
        plan: RenderPlan,
        pool: ThreadPoolExecutor,
    ) -> None:
        """Prepare one ray a pixel, split for the thread pool."""
        self._scene = scene
        self._object_scenes = objects
        self._pool = pool
        self._size = (camera.height_px, camera.width_px)
        # One sample a pixel lies at the pixel's centre.
        samples = omni_rays(camera, replace(plan, samples=1))
        self._chunks = split_rays(samples)
        self.memory_bytes = samples.memory_bytes
        """Size of the rays."""

    def measure(self, camera_state: CameraState) -> Float32s:
        """(h, w) ranges, metres; inf where no surface is hit."""
        range_m = np.full(self._size, np.inf, dtype=np.float32)
        pose = camera_state.world_from_mirror
        rotation = pose.rotation.T.astype(np.float32)
        scale = SrgbScale.for_samples(_ANY_SCALE)
        instances = self._object_scenes.place_objects(camera_state.objects, pose.translation, scale)
        origin = (pose.translation - self._scene.origin).astype(np.float32)

        def measure_chunk(chunk: RayChunk) -> None:
            directions = chunk.directions @ rotation
            distance = self._scene.distances(np.broadcast_to(origin, directions.shape), directions)
            # The scene's distance limits the rays to objects: only nearer hits overwrite it.
            for instance in instances:
                rays, hit_distance, _ = instance.closest_hit(directions, distance)
                distance[rays] = hit_distance
            distance[chunk.off_mirror] = np.inf
            # Each task writes pixels of its own, so the threads share the array without a lock.
            range_m.reshape(-1)[chunk.pixels] = distance

        list(self._pool.map(measure_chunk, self._chunks))
        return range_m
