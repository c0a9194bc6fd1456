"""The native engine: a scene on a kernel device, and the rays of cameras.

A frame is one call, from the rays and the camera's pose to pixels. C code: `src/`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_server.render.renderer import NO_THRESHOLDS
from catoptra_server.render.srgb_encoding import srgb_table
from catoptra_server.render.trace.kernel.exposure_arrays import (
    ObjectTable,
    exposure_arrays,
)
from catoptra_server.render.trace.kernel.instruction_sets import choose_instruction_set
from catoptra_server.render.trace.kernel.kernel_image_changer import KernelImageChanger
from catoptra_server.render.trace.kernel.kernel_library import KernelDevice
from catoptra_server.render.trace.kernel.kernel_rays import KernelRays
from catoptra_server.render.trace.kernel.kernel_structs import (
    OUTPUT_HITS,
    FrameCounts,
    SceneStruct,
)
from catoptra_server.render.trace.kernel.scene_arrays import (
    Owned,
    caster_arrays,
    encoded_table,
    hemisphere_struct,
    light_array,
    occlusion_struct,
    radiance_table,
    scene_arrays,
    surfaces_struct,
    texture_array,
)
from catoptra_server.render.trace.ray_table import Float32s, RayTable
from catoptra_server.render.trace.trace_engine import (
    TracedExposure,
    find_ego_body,
    first_state,
    scene_centre,
)
from catoptra_server.world import shading
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import Light, World


class KernelEngine:
    """A scene on a kernel device."""

    def __init__(
        self,
        scene: SceneMesh,
        world: World,
        *,
        threads: int,
        scene_lights: tuple[Light, ...],
        instruction_set: str = "auto",
        packet_width: int = 0,
    ) -> None:
        """Commit a scene.

        Args:
            scene: Triangles of the static scene.
            world: Lights of dynamic objects, and background.
            threads: Threads, the calling one included.
            scene_lights: Lights of the static scene.
            instruction_set: As Embree names it; "auto" for the processor's best.
            packet_width: Rays of a packet, 1, 4, 8 or 16; 0 for the instruction set's.

        Raises:
            KernelUnavailableError: The kernel's or Embree's library is missing.
        """
        name = choose_instruction_set(instruction_set)
        self._device = KernelDevice(name, threads, packet_width=packet_width)
        self.image_changer = KernelImageChanger(self._device)
        width = self._device.packet_width
        self.description = f"kernel (Embree {name}, packets of {width}), {threads} threads"
        self._mesh = scene
        self._world = world
        self._scene_lights = scene_lights
        self.centre = scene_centre(scene)
        """(3,) origin of Embree's coordinates in the world."""
        self._owners: list[object] = []
        self._meshes: list[int] = []
        self._objects = ObjectTable(self._device, self.centre)
        self._has_shadow_tables = False
        try:
            self._scene = self._make_scene()
        except BaseException:
            # Nobody else knows the device: its threads would stay.
            self._device.close()
            raise

    @property
    def num_object_meshes(self) -> int:
        """Number of object meshes committed so far."""
        return len(self._objects)

    def _make_scene(self) -> SceneStruct:
        """Scene without what only shadows need."""
        radiance = radiance_table(self._mesh, self._scene_lights, self._world.background)
        encoded = encoded_table(radiance)
        textures = self._keep(texture_array(self._mesh))
        lights, num_lights = light_array(self._world.lights, self._scene_lights, self.centre)
        # The table of greys is cached for the life of the process.
        self._owners += [radiance, encoded, lights]
        scene = SceneStruct(
            mesh=self._commit(scene_arrays(self._mesh, self.centre)),
            sharp_radiance=radiance.ctypes.data,
            ambient_radiance=radiance.ctypes.data,
            encoded=encoded.ctypes.data,
            num_textures=len(self._mesh.textures),
            textures=ctypes.addressof(textures),
            num_lights=num_lights,
            lights=ctypes.addressof(lights),
            hemisphere=hemisphere_struct(self._world.lights),
            srgb_table=srgb_table().ctypes.data,
            surfaces=self._keep(surfaces_struct(self._mesh, self.centre)),
            occlusion=self._keep(occlusion_struct(self._mesh.occlusion, self.centre)),
        )
        if self._mesh.occlusion is not None:
            scene.ambient_radiance = self._tabulate_ambient()
        return scene

    def _tabulate_ambient(self) -> int:
        """Address of the facets' radiance by hemisphere lights alone."""
        ambient = shading.hemisphere_lights(self._scene_lights)
        radiance = radiance_table(self._mesh, ambient, self._world.background)
        self._owners.append(radiance)
        return radiance.ctypes.data

    def _keep(self, owned: Owned) -> Any:
        """Structure whose arrays live as long as the engine."""
        self._owners += [owned.struct, *owned.owners]
        return owned.struct

    def _commit(self, owned: Owned) -> int:
        """Mesh of the device, released with the engine."""
        mesh = self._device.commit_mesh(self._keep(owned))
        self._meshes.append(mesh)
        return mesh

    def _prepare_shadows(self) -> None:
        """Add to the scene what only shadows need, at the first frame with shadows."""
        if self._has_shadow_tables:
            return
        if self._mesh.occlusion is None:
            self._scene.ambient_radiance = self._tabulate_ambient()
        if not self._mesh.casts_shadows.all():
            self._scene.casters = self._commit(caster_arrays(self._mesh, self.centre))
            casters = np.flatnonzero(self._mesh.casts_shadows).astype(np.int32)
            self._owners.append(casters)
            self._scene.caster_triangles = casters.ctypes.data
        self._scene.light_maps = self._device.build_light_maps(self._scene)
        self._has_shadow_tables = True

    def prepare(self, rays: RayTable) -> KernelRays:
        """Prepare the rays of a camera."""
        return KernelRays(rays, self._device, self)

    def render(
        self,
        view: int,
        exposure: TracedExposure,
        output: int,
        *arrays: npt.NDArray[np.generic],
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
        inverse_range: Float32s | None = None,
        labels: Owned | None = None,
        flow: Owned | None = None,
    ) -> FrameCounts:
        """Render an exposure into arrays: an image, hits, labels or flow."""
        if first_state(exposure).has_shadows:
            self._prepare_shadows()
        frame = exposure_arrays(exposure, self.centre, self._objects)
        frame.struct.output = output
        frame.struct.measures_shadows = "Shadows" in thresholds
        frame.struct.shadow_threshold = thresholds.get("Shadows", 0.0)
        frame.struct.measures_fog = "Fog" in thresholds
        if "SelfView" in thresholds:
            frame.struct.watched_object = find_ego_body(exposure)
        frame.struct.blur_threshold = thresholds.get("MotionBlur", -1.0)
        if inverse_range is not None:
            frame.struct.inverse_range = inverse_range.ctypes.data
        if labels is not None:
            labels.struct.centre[:] = self.centre.tolist()
            frame.struct.labels = ctypes.addressof(labels.struct)
        if flow is not None:
            frame.struct.flow = ctypes.addressof(flow.struct)
        if output == OUTPUT_HITS:
            struct = frame.struct
            struct.range_m, struct.triangle, struct.object = (a.ctypes.data for a in arrays)
        elif arrays:
            frame.struct.image = arrays[0].ctypes.data
        return self._device.render(self._scene, view, frame.struct)

    def trace_bare(self, view: int, exposure: TracedExposure) -> None:
        """Trace a view's rays without any use of the hits."""
        frame = exposure_arrays(exposure, self.centre, self._objects)
        self._device.trace(self._scene, view, frame.struct)

    def close(self) -> None:
        """Free the scene and end the threads."""
        self._objects.close()
        self._device.release_light_maps(self._scene)
        while self._meshes:
            self._device.release_mesh(self._meshes.pop())
        self._device.close()
