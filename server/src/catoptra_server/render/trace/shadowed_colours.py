"""What rays bring back where things cast shadows: `ray_colours` with a ray to each light.

Nothing of it exists before an exposure has shadows. Light that no shadow can change, of facets that
are turned away from every light or shine by themselves, is looked up as ever.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools
from catoptra_server.render import shading
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.trace.embree_scene import EmbreeScene, Places
from catoptra_server.render.trace.moving_bodies import BodyScenes, PlacedBody, Rays, body_hits
from catoptra_server.render.trace.packed_light import Colours, Float32s, Packed, Scale
from catoptra_server.render.trace.ray_colours import Placement, replace_hits
from catoptra_server.render.trace.shadow_rays import ShadowRays, casters
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh

# A table holds the light of each choice of so many suns: four times the triangles.
_MOST_SUNS = 2


class ShadowedColours:
    """A scene's light with shadows, on a scale; bodies cast and receive them."""

    def __init__(
        self, scene: EmbreeScene, bodies: BodyScenes, scale: Scale, lit: LitTriangles
    ) -> None:
        self.scene = scene
        self._bodies = bodies.under(lit.sky)
        self._scale = scale
        self._lit = lit
        self.channel = scale.channel
        self.pixel = np.dtype(f"V{3 * scale.channel.itemsize}")
        # By which suns are seen, a bit each, then by triangle.
        self._table = np.stack([scale.packed(radiance) for radiance in lit.radiance()])

    def placed(self, exposure: Exposure) -> Placement:
        """Return what does not change within an exposure; bodies are lit by the sky alone."""
        pose = exposure.world_from_mirror
        return Placement(
            pose.rotation.T.astype(np.float32),
            (pose.translation - self.scene.origin).astype(np.float32),
            self._bodies.placed(exposure.bodies, pose.translation, self._scale),
        )

    def varies(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """Return (n,) whether light varies over triangles; -1 is the background."""
        lit = self._lit.is_lit.take(triangle, mode="wrap")
        return np.asarray(self.scene.varies(triangle) | lit)

    def of_rays(
        self, directions: Float32s, placement: Placement, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples, 3) rays; those beside are black."""
        directions = directions @ placement.rotation
        origins = np.broadcast_to(placement.origin, directions.shape)
        triangle, places = self.scene.hits(origins, directions)
        light = self._light(triangle, places, placement)
        if placement.bodies:
            bodies = [ShadowedBody(body, placement, self._lit.rays) for body in placement.bodies]
            met = body_hits(bodies, directions, self._scale)
            replace_hits(light, met, directions, scene=self.scene, origin=placement.origin)
        light[off_mirror] = 0
        return self._encoded(light)

    def of_places(
        self, triangle: npt.NDArray[np.int32], places: Places, placement: Placement
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples,) known places on triangles."""
        return self._encoded(self._light(triangle, places, placement))

    def of_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """Return the (n, 3) colours of pixels that triangles, or the background (-1), fill."""
        light = self._table[0].take(triangle, mode="wrap") * np.uint64(self._scale.samples)
        return self._scale.colours(light)

    def _encoded(self, light: Packed) -> Colours:
        return self._scale.colours(self._scale.pixel_sums(light))

    def _light(
        self, triangle: npt.NDArray[np.int32], places: Places, placement: Placement
    ) -> Packed:
        """Return the (n,) packed light of places on (n,) triangles; -1 is the background."""
        light: Packed = self._table[0].take(triangle, mode="wrap")
        by_table = self._lit.is_looked_up.take(triangle, mode="wrap")
        self._look_up(light, np.flatnonzero(by_table), triangle, places, placement)
        rays = np.flatnonzero(self.varies(triangle) & ~by_table)
        of = triangle.take(rays)
        radiance: Float32s = self.scene.sky_radiance.take(of, axis=1)
        lit = np.flatnonzero(self._lit.is_lit.take(of))
        points = places.points(rays[lit]).astype(np.float64)
        facet = of.take(lit)
        normals = self._lit.normals.take(facet, axis=0)
        irradiance = self._lit.rays.irradiance(points, normals, placement.bodies)
        by_lights = self._lit.albedo.take(facet, axis=1) * irradiance.T
        radiance[:, lit] += by_lights.astype(np.float32)
        self.scene.texture(radiance, rays, of, places)
        light[rays] = self._scale.packed(radiance)
        return light

    def _look_up(
        self,
        light: Packed,
        rays: npt.NDArray[np.intp],
        triangle: npt.NDArray[np.int32],
        places: Places,
        placement: Placement,
    ) -> None:
        """Replace the light of rays whose facets have one of a few lights, by the suns they see."""
        lit, of = self._lit, triangle.take(rays)
        points = places.points(rays).astype(np.float32)
        normals = lit.small_normals.take(of, axis=0)
        seen = lit.rays.suns_seen(points, normals, lit.faced.take(of), placement.bodies)
        light[rays] = self._table.reshape(-1).take(seen * self._table.shape[1] + of)


class LitTriangles:
    """Which triangles of a scene lights can reach that something may hide.

    is_lit, is_looked_up: (n + 1,), the last row is that of a ray that meets none; the latter have
    one of a few lights, by the suns that they see. faced: (n,) suns that they are turned to, a bit
    each. normals (n, 3), small_normals the same in float32, albedo (3, n).
    """

    def __init__(self, embree: EmbreeScene, scene: SceneMesh, world: World) -> None:
        self.sky = shading.sky_lights(world.lights)
        self.rays = ShadowRays(casters(embree, scene), embree.origin, world.lights)
        self.normals = scene.normals
        self.small_normals = scene.normals.astype(np.float32)
        self._sky_radiance = embree.sky_radiance
        self.albedo = np.ascontiguousarray(scene.albedo.T, dtype=np.float32)
        by_suns = shading.facet_irradiance(shading.hideable_lights(world.lights), scene.normals)
        reached = by_suns.any(axis=-1) | bool(shading.point_lights(world.lights))
        takes = ~scene.unlit & scene.albedo.any(axis=-1)
        self.is_lit = np.append(reached & takes, False)
        towards = np.array([sun.direction for sun in self.rays.suns]).reshape(-1, 3)
        facing = scene.normals @ towards.T < 0.0
        self._suns = self.rays.suns if self._has_few_suns_alone(world) else []
        bits = 1 << np.arange(len(self._suns))
        self.faced = (facing[:, : len(self._suns)] @ bits).astype(np.uint8)
        untextured = np.append(scene.texture_index < 0, False)
        self.is_looked_up = self.is_lit & untextured & bool(self._suns)

    def _has_few_suns_alone(self, world: World) -> bool:
        return len(self.rays.suns) <= _MOST_SUNS and not shading.point_lights(world.lights)

    def radiance(self) -> Iterator[Float32s]:
        """Yield (3, n + 1) radiance without textures by the sky and each choice of few suns."""
        yield self._sky_radiance
        for seen in range(1, 2 ** len(self._suns)):
            suns = [sun for index, sun in enumerate(self._suns) if seen & (1 << index)]
            by_suns = self.albedo * shading.facet_irradiance(suns, self.normals).T
            by_suns[:, ~self.is_lit[:-1]] = 0.0
            whole = self._sky_radiance.copy()
            whole[:, :-1] += by_suns.astype(np.float32)
            yield whole


@dataclass(frozen=True, slots=True, eq=False)
class ShadowedBody:
    """A body in one exposure whose light is computed place by place."""

    body: PlacedBody
    placement: Placement
    rays: ShadowRays

    def nearer(self, directions: Float32s, distance: Float32s) -> tuple[Rays, Float32s, Rays]:
        """Return the rays that meet it before their distance: which, how far, what triangle."""
        return self.body.nearer(directions, distance)

    def light(
        self, triangle: Rays, directions: Float32s, distance: Float32s, scale: Scale
    ) -> Packed:
        """Return the (n,) packed light of hits: of a triangle, along a direction, how far."""
        mesh, pose = self.body.body.mesh, self.body.body.world_from_body
        points = (self.placement.origin + distance[:, None] * directions).astype(np.float64)
        normals = pose.directions(mesh.normals[triangle])
        irradiance = self.rays.irradiance(points, normals, self.placement.bodies)
        irradiance[mesh.unlit[triangle]] = 0.0
        radiance = self.body.radiance[:, triangle] + (mesh.albedo[triangle] * irradiance).T
        return scale.packed(radiance.astype(np.float32))
