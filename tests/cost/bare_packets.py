"""Rays of a frame in coherent packets without any shading: the most that a renderer can reach.

The native kernel's own packets, on a device of its own, so that only public names are used.
"""

from __future__ import annotations

import os

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine, KernelRays
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World


class BarePackets:
    """The rays of one camera, traced and dropped."""

    def __init__(self, rays: KernelRays) -> None:
        """Keep prepared rays."""
        self._rays = rays

    def trace(self, state: CameraState) -> None:
        """Trace all rays once."""
        self._rays.trace_bare(state)

    def close(self) -> None:
        """Free the rays."""
        self._rays.close()


class BarePacketScene:
    """A scene on a kernel device of its own."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        """Commit a scene; without the kernel nothing is measured."""
        self._engine: KernelEngine | None = None
        threads = len(os.sched_getaffinity(0))
        try:
            self._engine = KernelEngine(scene, world, threads=threads, scene_lights=world.lights)
        except KernelUnavailableError:
            return

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> BarePackets | None:
        """Prepare the rays of a camera; None without the kernel."""
        if self._engine is None:
            return None
        return BarePackets(self._engine.prepare(omni_ray_table(camera, plan)))

    def close(self) -> None:
        """Free the scene."""
        if self._engine is not None:
            self._engine.close()
