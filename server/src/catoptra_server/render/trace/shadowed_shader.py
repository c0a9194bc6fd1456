"""Shading with shadows: `ray_shader` with a ray to each light.

Built at the first camera state with shadows. Radiance that no shadow can change, of facets turned
away from every light or of emitters, still comes from a table.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.trace.embree_objects import (
    EmbreeObjectScenes,
    ObjectInstance,
    RayIndices,
    intersect_objects,
)
from catoptra_server.render.trace.embree_scene import EmbreeScene, SurfacePoints
from catoptra_server.render.trace.packed_light import Colours, Float32s, Packed, RadianceScale
from catoptra_server.render.trace.ray_shader import ViewTransform, overwrite_visible_hits
from catoptra_server.render.trace.shadow_rays import ShadowRays, make_occlusion_query
from catoptra_server.scene import shading
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import World

# Lights of a table with one row for each set of visible lights: four rows for two lights.
_MAX_TABULATED_LIGHTS = 2


class ShadowedShader:
    """Radiance of a scene with shadows, on a scale; dynamic objects cast and receive them."""

    def __init__(
        self,
        scene: EmbreeScene,
        objects: EmbreeObjectScenes,
        scale: RadianceScale,
        receivers: ShadowReceivers,
    ) -> None:
        """Tabulate the radiance for every set of visible directional lights, if these are few."""
        self.scene = scene
        # Objects get only the light that nothing occludes in their tables; ShadowedObject adds the
        # rest.
        self._object_scenes = objects.with_lights(receivers.hemisphere_lights)
        self._scale = scale
        self._receivers = receivers
        self.channel_dtype = scale.channel_dtype
        self.pixel_dtype = np.dtype(f"V{3 * scale.channel_dtype.itemsize}")
        # Rows by the bit mask of visible lights, columns by triangle.
        self._table = np.stack([scale.pack(radiance) for radiance in receivers.tabulate_radiance()])

    @property
    def memory_bytes(self) -> int:
        """Size of the tables of all triangles."""
        return self._table.nbytes

    def transform_view(self, camera_state: CameraState) -> ViewTransform:
        """Transform and objects of a camera state; objects are lit by hemisphere lights alone."""
        pose = camera_state.world_from_mirror
        return ViewTransform(
            pose.rotation.T.astype(np.float32),
            (pose.translation - self.scene.origin).astype(np.float32),
            self._object_scenes.place_objects(camera_state.objects, pose.translation, self._scale),
        )

    def has_varying_light(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """(n,) whether radiance varies over each triangle; triangle -1 is the background."""
        is_lit = self._receivers.is_lit.take(triangle, mode="wrap")
        return np.asarray(self.scene.is_varying(triangle) | is_lit)

    def shade_rays(
        self, directions: Float32s, transform: ViewTransform, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """(pixels, 3) colours of (pixels * samples, 3) rays; rays off the mirror are black."""
        directions = directions @ transform.rotation
        origins = np.broadcast_to(transform.origin, directions.shape)
        triangle, surface_points = self.scene.closest_hits(origins, directions)
        radiance = self._shade(triangle, surface_points, transform)
        # Objects after the scene: only their hits in front of the scene overwrite its radiance.
        if transform.objects:
            shadowed_objects = [
                ShadowedObject(instance, transform, self._receivers.shadow_rays)
                for instance in transform.objects
            ]
            object_hits = intersect_objects(shadowed_objects, directions, self._scale)
            overwrite_visible_hits(
                radiance, object_hits, directions, scene=self.scene, origin=transform.origin
            )
        radiance[off_mirror] = 0
        return self._encode_pixels(radiance)

    def shade_points(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        transform: ViewTransform,
    ) -> Colours:
        """(pixels, 3) colours of (pixels * samples,) known points on triangles."""
        return self._encode_pixels(self._shade(triangle, surface_points, transform))

    def shade_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """(n, 3) colours of pixels that one triangle, or the background (-1), fills."""
        sums = self._table[0].take(triangle, mode="wrap") * np.uint64(self._scale.samples)
        return self._scale.unpack(sums)

    def _encode_pixels(self, light: Packed) -> Colours:
        """(pixels, 3) colours of (pixels * samples,) packed radiance."""
        return self._scale.unpack(self._scale.sum_pixels(light))

    def _shade(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        transform: ViewTransform,
    ) -> Packed:
        """(n,) packed radiance of points on (n,) triangles; triangle -1 is the background."""
        # Three groups of points: constant radiance from the first row, few directional lights from
        # the row of the visible ones, and all others in float32.
        packed: Packed = self._table[0].take(triangle, mode="wrap")
        is_tabulated = self._receivers.is_tabulated.take(triangle, mode="wrap")
        self._look_up(packed, np.flatnonzero(is_tabulated), triangle, surface_points, transform)
        rays = np.flatnonzero(self.has_varying_light(triangle) & ~is_tabulated)
        triangles = triangle.take(rays)
        radiance: Float32s = self.scene.hemisphere_radiance.take(triangles, axis=1)
        lit = np.flatnonzero(self._receivers.is_lit.take(triangles))
        # Float64 like the shading functions; tabulated facets, of constant irradiance, do without.
        points = surface_points.positions(rays[lit]).astype(np.float64)
        lit_triangles = triangles.take(lit)
        normals = self._receivers.normals.take(lit_triangles, axis=0)
        irradiance = self._receivers.shadow_rays.irradiance(points, normals, transform.objects)
        reflected = self._receivers.albedo.take(lit_triangles, axis=1) * irradiance.T
        radiance[:, lit] += reflected.astype(np.float32)
        self.scene.apply_textures(radiance, rays, triangles, surface_points)
        packed[rays] = self._scale.pack(radiance)
        return packed

    def _look_up(
        self,
        light: Packed,
        rays: npt.NDArray[np.intp],
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        transform: ViewTransform,
    ) -> None:
        """Replace the radiance of rays on tabulated facets, by the visible directional lights."""
        receivers, triangles = self._receivers, triangle.take(rays)
        points = surface_points.positions(rays).astype(np.float32)
        normals = receivers.normals_float32.take(triangles, axis=0)
        visible = receivers.shadow_rays.visible_directional_lights(
            points, normals, receivers.facing_bits.take(triangles), transform.objects
        )
        # Row of the visible set and column of the triangle, in one flat index.
        light[rays] = self._table.reshape(-1).take(visible * self._table.shape[1] + triangles)


class ShadowReceivers:
    """Triangles of a scene whose light a shadow can change.

    Arrays of n + 1 entries end with that of a ray without a hit.

    Attributes:
        hemisphere_lights: Lights that nothing occludes.
        shadow_rays: Occlusion of all other lights.
        normals: (n, 3) unit normals.
        normals_float32: (n, 3) the same in single precision, for tabulated facets.
        albedo: (3, n) reflectance.
        is_lit: (n + 1,) whether some shadow-casting light reaches the triangle.
        is_tabulated: (n + 1,) whether the radiance is one of a few, by the visible lights.
        facing_bits: (n,) bit mask of the directional lights that the triangle is turned to.
    """

    def __init__(self, embree: EmbreeScene, scene: SceneMesh, world: World) -> None:
        """Classify the triangles."""
        self.hemisphere_lights = shading.hemisphere_lights(world.lights)
        self.shadow_rays = ShadowRays(
            make_occlusion_query(embree, scene), embree.origin, world.lights
        )
        self.normals = scene.normals
        self.normals_float32 = scene.normals.astype(np.float32)
        self._hemisphere_radiance = embree.hemisphere_radiance
        self.albedo = np.ascontiguousarray(scene.albedo.T, dtype=np.float32)
        irradiance = shading.facet_irradiance(
            shading.shadow_casting_lights(world.lights), scene.normals
        )
        is_reached = irradiance.any(axis=-1) | bool(shading.point_lights(world.lights))
        reflects_light = ~scene.unlit & scene.albedo.any(axis=-1)
        self.is_lit = np.append(is_reached & reflects_light, False)
        light_directions = np.array(
            [light.direction for light in self.shadow_rays.directional_lights]
        ).reshape(-1, 3)
        facing = scene.normals @ light_directions.T < 0.0
        self._directional_lights = (
            self.shadow_rays.directional_lights if self._can_tabulate(world) else []
        )
        # A facet turned away from a light needs no ray to it, and indexes the table as if it were
        # occluded.
        bits = 1 << np.arange(len(self._directional_lights))
        self.facing_bits = (facing[:, : len(self._directional_lights)] @ bits).astype(np.uint8)
        untextured = np.append(scene.texture_index < 0, False)
        self.is_tabulated = self.is_lit & untextured & bool(self._directional_lights)

    def _can_tabulate(self, world: World) -> bool:
        """Whether all shadow-casting lights are directional and few."""
        # A point light's irradiance varies over a triangle, so no table can hold the sums.
        return len(
            self.shadow_rays.directional_lights
        ) <= _MAX_TABULATED_LIGHTS and not shading.point_lights(world.lights)

    def tabulate_radiance(self) -> Iterator[Float32s]:
        """Yield (3, n + 1) untextured radiance for every set of visible directional lights.

        The set is a bit mask that counts up from zero: first hemisphere lights alone.
        """
        yield self._hemisphere_radiance
        for visible in range(1, 2 ** len(self._directional_lights)):
            lights = [
                light
                for index, light in enumerate(self._directional_lights)
                if visible & (1 << index)
            ]
            reflected = self.albedo * shading.facet_irradiance(lights, self.normals).T
            reflected[:, ~self.is_lit[:-1]] = 0.0
            radiance = self._hemisphere_radiance.copy()
            radiance[:, :-1] += reflected.astype(np.float32)
            yield radiance


@dataclass(frozen=True, slots=True, eq=False)
class ShadowedObject:
    """A dynamic object in one frame whose radiance is computed point by point."""

    instance: ObjectInstance
    """Object at its pose."""
    transform: ViewTransform
    """Viewpoint and all objects of the frame."""
    shadow_rays: ShadowRays
    """Lights and occluders."""

    def closest_hit(
        self, directions: Float32s, max_distance: Float32s
    ) -> tuple[RayIndices, Float32s, RayIndices]:
        """Hits nearer than a limit of each ray: indices of the rays, distances, triangles."""
        return self.instance.closest_hit(directions, max_distance)

    def shade(
        self, triangle: RayIndices, directions: Float32s, distance: Float32s, scale: RadianceScale
    ) -> Packed:
        """(n,) packed radiance of hits on triangles, at distances along directions."""
        mesh, pose = (
            self.instance.dynamic_object.mesh,
            self.instance.dynamic_object.world_from_object,
        )
        points = (self.transform.origin + distance[:, None] * directions).astype(np.float64)
        normals = pose.rotate_directions(mesh.normals[triangle])
        irradiance = self.shadow_rays.irradiance(points, normals, self.transform.objects)
        irradiance[mesh.unlit[triangle]] = 0.0
        radiance = self.instance.radiance[:, triangle] + (mesh.albedo[triangle] * irradiance).T
        return scale.pack(radiance.astype(np.float32))
