"""Dynamic objects on the device: one vertex buffer, written for every camera state that has any.

Without objects there is no buffer, no program and no draw call. Objects share the faces' program;
each triangle's light is computed at the object's current pose.
"""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.projection.depth_range import min_distance_bound
from catoptra_server.render.raster.frame_uniforms import FrameUniforms
from catoptra_server.render.raster.scene_batches import FacetLighting
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms, set_uniform
from catoptra_server.render.raster.split_positions import SPLIT_FORMAT, split_positions
from catoptra_server.world import shading
from catoptra_server.world.objects import DynamicObject, world_facets
from catoptra_server.world.triangles import Indices, visible_runs


@dataclass(frozen=True, slots=True, eq=False)
class _BoundingSpheres:
    """Bounding spheres of one frame's objects, and their ranges of triangles in the buffer."""

    centres: Floats
    """(n, 3) centres, scene frame."""
    radii: Floats
    """(n,) radii, metres."""
    offsets: Indices
    """(n + 1,) first triangle of each object, and the number of all."""


class DynamicObjectBuffer:
    """The dynamic objects of one world, on the device."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        lighting: FacetLighting,
        origin: Floats,
    ) -> None:
        """Keep the resources; nothing is allocated yet.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            lighting: Lighting model of facets.
            origin: (3,) origin of the scene's frame in the world.
        """
        self._context = context
        self._programs = programs
        self._lighting = lighting
        self._origin = origin
        self._buffer: moderngl.Buffer | None = None
        self._vertices: moderngl.VertexArray | None = None
        self._spheres: _BoundingSpheres | None = None

    @property
    def buffer_bytes(self) -> int:
        """Size of the vertex buffer: 0 until the first object."""
        return 0 if self._buffer is None else int(self._buffer.size)

    @property
    def programs(self) -> set[moderngl.Program]:
        """The program that draws this frame's objects, empty if there are none."""
        if self._vertices is None or self._spheres is None:
            return set()
        return {self._vertices.program}

    def upload(self, objects: tuple[DynamicObject, ...]) -> None:
        """Upload the objects of a camera state at their current poses."""
        if not objects:
            self._spheres = None
            return
        self._spheres = _BoundingSpheres(
            centres=np.array([dynamic_object.centre - self._origin for dynamic_object in objects]),
            radii=np.array([dynamic_object.mesh.radius_m for dynamic_object in objects]),
            offsets=np.cumsum([0, *(len(dynamic_object.mesh) for dynamic_object in objects)]),
        )
        self._write_vertices(
            np.concatenate([self._vertex_data(dynamic_object) for dynamic_object in objects])
        )

    def _vertex_data(self, dynamic_object: DynamicObject) -> Floats:
        """(3 n, 9) or (3 n, 15) attributes of an object's corners, split positions first."""
        world_facets_of = world_facets(dynamic_object)
        attributes = [shading.facet_radiance(world_facets_of, self._lighting.constant_lights)]
        if self._lighting.definitions:
            # An albedo of zero for unlit materials spares the shader a branch.
            attributes += [
                world_facets_of.normals,
                world_facets_of.albedo * ~world_facets_of.unlit[:, None],
            ]
        positions = (
            dynamic_object.world_from_object.transform_points(dynamic_object.mesh.corners)
            - self._origin
        )
        per_triangle = np.concatenate(attributes, axis=-1)
        # OpenGL 3.3 has no attributes per triangle: each corner carries a copy.
        per_corner = np.broadcast_to(
            per_triangle[:, None], (*positions.shape[:2], per_triangle.shape[1])
        )
        vertices: Floats = np.concatenate((split_positions(positions), per_corner), axis=-1)
        return vertices.reshape(-1, 6 + per_triangle.shape[1])

    def _write_vertices(self, values: Floats) -> None:
        """Write the vertices; the buffer grows when necessary and never shrinks."""
        data = values.astype(np.float32).tobytes()
        if self._buffer is None or self._buffer.size < len(data):
            self.close()
            self._buffer = self._context.buffer(reserve=len(data), dynamic=True)
            self._vertices = self._vertex_array(self._buffer)
        # A new store instead of waiting until the last frame has been drawn from the old one.
        self._buffer.orphan()
        self._buffer.write(data)

    def _vertex_array(self, buffer: moderngl.Buffer) -> moderngl.VertexArray:
        """Vertex array with the attributes of the lighting."""
        names, layout = ["position", "position_rest", "radiance"], f"{SPLIT_FORMAT} 3f"
        if self._lighting.definitions:
            names, layout = [*names, "normal", "lit_albedo"], f"{layout} 3f 3f"
        program = self._programs.get(ProgramSpec("face", "face", self._lighting.definitions))
        return self._context.vertex_array(program, [(buffer, layout, *names)])

    def set_frame(self, frame: FrameUniforms) -> None:
        """Write the uniforms of a frame, if any object is drawn in it."""
        for program in self.programs:
            frame.apply_to(program)

    def draw(self, clip_from_scene: Floats, planes: Floats, viewpoint: Floats) -> tuple[int, int]:
        """Draw the objects in front of (p, 3) planes; return the draw calls and triangles sent."""
        spheres = self._spheres
        if self._vertices is None or spheres is None:
            return 0, 0
        # A sphere is outside once its centre is more than a radius behind a plane; the normals are
        # not unit, so the radius is scaled by their lengths.
        radii = np.outer(spheres.radii, np.linalg.norm(planes, axis=-1))
        visible = np.asarray(((spheres.centres - viewpoint) @ planes.T >= -radii).all(axis=-1))
        runs = visible_runs(visible, spheres.offsets)
        if runs:
            set_uniform(self._vertices.program, "clip_from_scene", clip_from_scene.T)
        for first, count in runs:
            self._vertices.render(vertices=3 * count, first=3 * first)
        return len(runs), sum(count for _, count in runs)

    def close(self) -> None:
        """Free the buffer, if any; the program belongs to the context."""
        if self._vertices is not None:
            self._vertices.release()
        if self._buffer is not None:
            self._buffer.release()
        self._vertices = self._buffer = None


def object_distance_range(
    objects: tuple[DynamicObject, ...], viewpoint: Floats, cutoff_m: float
) -> tuple[float, float]:
    """Least and greatest distance of dynamic objects from a viewpoint.

    Args:
        objects: Objects at their current poses.
        viewpoint: (3,) position, world frame, metres.
        cutoff_m: Above this distance the least one is only bounded by a sphere.

    Returns:
        Lower bound of the least distance, inf without objects; upper bound of the greatest, else 0.
    """
    nearest, farthest = np.inf, 0.0
    for dynamic_object in objects:
        centre_distance = float(np.linalg.norm(dynamic_object.centre - viewpoint))
        bound = centre_distance - dynamic_object.mesh.radius_m
        # The sphere decides for far objects: the near plane does not depend on distances above the
        # cutoff.
        if bound < cutoff_m:
            bound = _nearest_triangle(dynamic_object, viewpoint)
        nearest, farthest = (
            min(nearest, bound),
            max(farthest, centre_distance + dynamic_object.mesh.radius_m),
        )
    return nearest, farthest


def _nearest_triangle(dynamic_object: DynamicObject, viewpoint: Floats) -> float:
    """Lower bound on the distance to an object's nearest triangle."""
    corners, normals = dynamic_object.mesh.corners, dynamic_object.mesh.normals
    # In the object's own frame: its boxes and planes were never transformed.
    return min_distance_bound(
        corners.min(axis=1),
        corners.max(axis=1),
        normals,
        np.einsum("ni,ni->n", normals, corners[:, 0]),
        point=dynamic_object.world_from_object.inverse().transform_points(viewpoint),
    )
