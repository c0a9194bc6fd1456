"""Bodies on the device: one buffer of vertices, written for every exposure that has any.

Without bodies there is no buffer, no program and no draw. They share the faces' program, whose
light is that of each triangle where the body stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.projection.depth_range import min_distance_bound
from catoptra_server.render.raster.frame_uniforms import FrameUniforms
from catoptra_server.render.raster.scene_batches import FacetLighting
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms, set_uniform
from catoptra_server.scene import shading
from catoptra_server.scene.dynamic_object import DynamicObject, world_facets
from catoptra_server.scene.triangle_clusters import Indices, visible_runs


@dataclass(frozen=True, slots=True, eq=False)
class _BoundingSpheres:
    """The bodies of one exposure: spheres around them, scene frame, and where they lie."""

    centres: Floats
    radii: Floats
    offsets: Indices


class DynamicObjectBuffer:
    """What moves in one world. `origin`: (3,), of the scene's frame in the world."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        lighting: FacetLighting,
        origin: Floats,
    ) -> None:
        self._context = context
        self._programs = programs
        self._lighting = lighting
        self._origin = origin
        self._buffer: moderngl.Buffer | None = None
        self._vertices: moderngl.VertexArray | None = None
        self._spheres: _BoundingSpheres | None = None

    @property
    def buffer_bytes(self) -> int:
        """Return the size of the vertex buffer: 0 as long as no body was seen."""
        return 0 if self._buffer is None else int(self._buffer.size)

    @property
    def programs(self) -> set[moderngl.Program]:
        """Return the program that draws what moves in this exposure, if anything does."""
        if self._vertices is None or self._spheres is None:
            return set()
        return {self._vertices.program}

    def upload(self, objects: tuple[DynamicObject, ...]) -> None:
        """Take over the bodies of an exposure and where they are."""
        if not objects:
            self._spheres = None
            return
        self._spheres = _BoundingSpheres(
            centres=np.array([body.centre - self._origin for body in objects]),
            radii=np.array([body.mesh.radius_m for body in objects]),
            offsets=np.cumsum([0, *(len(body.mesh) for body in objects)]),
        )
        self._write_vertices(np.concatenate([self._vertex_data(body) for body in objects]))

    def _vertex_data(self, dynamic_object: DynamicObject) -> Floats:
        """Return the (3 n, 6) or (3 n, 12) attributes of a body's corners."""
        lit = world_facets(dynamic_object)
        look = [shading.facet_radiance(lit, self._lighting.constant_lights)]
        if self._lighting.definitions:
            look += [lit.normals, lit.albedo * ~lit.unlit[:, None]]
        places = (
            dynamic_object.world_from_object.transform_points(dynamic_object.mesh.corners)
            - self._origin
        )
        of_triangles = np.concatenate(look, axis=-1)
        shared = np.broadcast_to(of_triangles[:, None], (*places.shape[:2], of_triangles.shape[1]))
        return np.concatenate((places, shared), axis=-1).reshape(-1, 3 + of_triangles.shape[1])

    def _write_vertices(self, values: Floats) -> None:
        """Write the vertices; the buffer grows when it must and never shrinks."""
        data = values.astype(np.float32).tobytes()
        if self._buffer is None or self._buffer.size < len(data):
            self.close()
            self._buffer = self._context.buffer(reserve=len(data), dynamic=True)
            self._vertices = self._vertex_array(self._buffer)
        # A new store instead of waiting until the last frame has been drawn from the old one.
        self._buffer.orphan()
        self._buffer.write(data)

    def _vertex_array(self, buffer: moderngl.Buffer) -> moderngl.VertexArray:
        names, layout = ["position", "radiance"], "3f 3f"
        if self._lighting.definitions:
            names, layout = [*names, "normal", "lit_albedo"], "3f 3f 3f 3f"
        program = self._programs.get(ProgramSpec("face", "face", self._lighting.definitions))
        return self._context.vertex_array(program, [(buffer, layout, *names)])

    def set_frame(self, frame: FrameUniforms) -> None:
        """Set the uniforms of a frame, if there is anything to draw in it."""
        for program in self.programs:
            frame.apply_to(program)

    def draw(self, clip_from_scene: Floats, planes: Floats, viewpoint: Floats) -> tuple[int, int]:
        """Draw what is in front of (p, 3) planes; return the draw calls and triangles sent."""
        at = self._spheres
        if self._vertices is None or at is None:
            return 0, 0
        reach = np.outer(at.radii, np.linalg.norm(planes, axis=-1))
        visible = np.asarray(((at.centres - viewpoint) @ planes.T >= -reach).all(axis=-1))
        parts = visible_runs(visible, at.offsets)
        if parts:
            set_uniform(self._vertices.program, "clip_from_scene", clip_from_scene.T)
        for first, count in parts:
            self._vertices.render(vertices=3 * count, first=3 * first)
        return len(parts), sum(count for _, count in parts)

    def close(self) -> None:
        """Free the buffer, if there is one; the program belongs to the context."""
        if self._vertices is not None:
            self._vertices.release()
        if self._buffer is not None:
            self._buffer.release()
        self._vertices = self._buffer = None


def object_distance_range(
    objects: tuple[DynamicObject, ...], viewpoint: Floats, cutoff_m: float
) -> tuple[float, float]:
    """Return distances from a (3,) point, world frame, between which all of the bodies is.

    The nearer one is exact only below `enough` metres; without bodies it is infinite, the other 0.
    """
    nearest, farthest = np.inf, 0.0
    for body in objects:
        middle = float(np.linalg.norm(body.centre - viewpoint))
        bound = middle - body.mesh.radius_m
        if bound < cutoff_m:
            bound = _nearest_triangle(body, viewpoint)
        nearest, farthest = min(nearest, bound), max(farthest, middle + body.mesh.radius_m)
    return nearest, farthest


def _nearest_triangle(dynamic_object: DynamicObject, viewpoint: Floats) -> float:
    corners, normals = dynamic_object.mesh.corners, dynamic_object.mesh.normals
    return min_distance_bound(
        corners.min(axis=1),
        corners.max(axis=1),
        normals,
        np.einsum("ni,ni->n", normals, corners[:, 0]),
        point=dynamic_object.world_from_object.inverse().transform_points(viewpoint),
    )
