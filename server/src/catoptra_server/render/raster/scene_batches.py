"""Triangles on the device with the attributes and programs of one lighting model.

Static triangles stand in batches, one for each texture. A batch has no more attributes than needed:
no texture coordinates without a texture, no normals where light is constant over each triangle.
Dynamic objects share one vertex buffer, written for every camera state that has any; without
objects there is no buffer, no program and no draw call. Objects share the faces' program, and each
triangle's light is computed at the object's current pose. Where some object has textures, all are
drawn with one, white for triangles without, texture by texture.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.projection.large_triangles import (
    MAX_SIZE_PER_DISTANCE,
    LargeTriangles,
    TrianglePieces,
)
from catoptra_server.render.raster.device import (
    GL_LIBRARY,
    SPLIT_FORMAT,
    Definitions,
    ProgramSpec,
    ShaderPrograms,
    set_sampler,
    set_uniform,
    split_positions,
)
from catoptra_server.world.objects import DynamicObject, ObjectMesh, world_facets
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    OcclusionMap,
    corner_radiance,
    facet_radiance,
    hemisphere_lights,
)
from catoptra_server.world.textures import REPEATED, Texture, TextureSampling, build_levels
from catoptra_server.world.triangles import (
    Indices,
    TriangleClusters,
    make_clusters,
    visible_runs,
)
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Light,
    LightProbes,
    linear_from_srgb,
)

# Definition of programs that interpolate colours between the corners of a triangle.
_COLOURED_CORNERS: Definitions = (("COLOURED_CORNERS", 1),)
# Definition of programs that hide a part of the sky from fragments.
_OCCLUDED: Definitions = (("OCCLUDED", 1),)
# Units 0 to 2 have textures and shadow maps.
_OCCLUSION_UNIT = 3
# By channels: GL_SRGB8, whose texels the sampler turns into linear light and filters then, and
# GL_RGB; the same with alpha.
_FORMATS = {3: (0x8C41, 0x1907), 4: (0x8C43, 0x1908)}
_GL_TEXTURE_2D, _GL_UNSIGNED_BYTE, _GL_UNPACK_ALIGNMENT = 0x0DE1, 0x1401, 0x0CF5
# Their light stays in the cache of a processor.
_TEXELS_AT_ONCE = 2**14
_VertexAttribute = tuple[moderngl.Buffer, str]
"""Buffer and its format."""


@dataclass(frozen=True, slots=True)
class FacetLighting:
    """Lighting of facets in the faces' programs."""

    constant_lights: tuple[Light, ...]
    """Lights whose irradiance depends on the normal alone: each triangle has one radiance."""
    definitions: Definitions = ()
    """Definitions of programs that shade further lights per fragment; empty without such lights."""

    @property
    def bent(self) -> Definitions:
        """Definitions of programs that light some facets by other normals than their own."""
        return (("BENT", 1), ("NUM_SUNS", len(self._suns)))

    @property
    def _suns(self) -> list[DirectionalLight]:
        return [light for light in self.constant_lights if isinstance(light, DirectionalLight)]

    def set_lights(self, program: moderngl.Program) -> None:
        """Set the lights that facets of one normal have in their radiance."""
        skies = (sky.faces for sky in hemisphere_lights(self.constant_lights))
        set_uniform(program, "sky_faces", sum(skies, np.zeros((6, 3))))
        if self._suns:
            towards = np.array([sun.direction for sun in self._suns])
            set_uniform(program, "sun_directions", -towards)
            irradiances = np.array([sun.irradiance for sun in self._suns])
            set_uniform(program, "sun_irradiances", irradiances)


class SceneBatches:
    """Draws a scene's clusters with one lighting model."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneMesh,
        clusters: TriangleClusters,
        *,
        position: moderngl.Buffer,
        lighting: FacetLighting,
        textures: Sequence[ImageTexture],
    ) -> None:
        """Upload the attributes.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            scene: Triangles of the static scene.
            clusters: Order of the triangles in the buffers.
            position: Split positions of the corners, freed by the caller.
            lighting: Lighting model.
            textures: Textures of the scene, freed by the caller.
        """
        self._context = context
        self._programs = programs
        self._textures = textures
        self._clusters = clusters
        self._lighting = lighting
        self._owned = self._upload(scene)
        self._position = position
        self._occlusion = self._atlas = _upload_atlas(context, scene.occlusion)
        self._baked = scene.baked_light
        self._mean_atlas: moderngl.Texture | None = None
        self._pieces: TrianglePieces | None = None
        self._batches = [self._make_batch(scene, int(g)) for g in np.unique(clusters.groups)]
        self._layer_batches: dict[Definitions, list[Batch]] = {}

    @property
    def programs(self) -> set[moderngl.Program]:
        """The programs of all batches that show light."""
        layers = (batch for batches in self._layer_batches.values() for batch in batches)
        return {batch.program for batch in (*self._batches, *layers)}

    def layer_batches(self, definitions: Definitions) -> list[Batch]:
        """Batches of blended facets alone, whose programs have further definitions."""
        if definitions not in self._layer_batches:
            self._layer_batches[definitions] = [
                replace(
                    batch, vertices=self._bind((*batch.definitions, *definitions), batch.attributes)
                )
                for batch in self._batches
            ]
        return self._layer_batches[definitions]

    def _bind(self, definitions: Definitions, attributes: list[Any]) -> moderngl.VertexArray:
        """Attributes of a batch, bound to a program of definitions."""
        program = self._programs.get(ProgramSpec("face", "face", definitions))
        if self._occlusion is not None:
            set_sampler(program, "occlusion_atlas", _OCCLUSION_UNIT)
        return self._context.vertex_array(program, attributes)

    def _upload(self, scene: SceneMesh) -> dict[str, _VertexAttribute]:
        """Buffer and format of each attribute that some batch needs."""
        attributes = {"radiance": _corner_radiance(scene, self._lighting.constant_lights)}
        if scene.textures:
            attributes["uv"] = scene.corner_uv
        if scene.occlusion is not None:
            sky = hemisphere_lights(self._lighting.constant_lights)
            is_hidden = (scene.occlusion.patch_of >= 0)[:, None, None]
            attributes["ambient"] = _corner_radiance(scene, sky) * is_hidden
            attributes["occlusion_at"] = _atlas_positions(scene.occlusion, scene.corners)
        if has_filter(scene):
            attributes["passing"] = facet_filter(scene)
            attributes["normal"] = _repeat_at_corners(scene.normals)
        if scene.emission is not None:
            attributes["emission"] = _repeat_at_corners(scene.emission)
        if scene.bent is not None:
            normals = scene.corner_normals
            attributes["bent_normal"] = (
                _repeat_at_corners(scene.normals) if normals is None else normals
            )
            two_sided = 0 if scene.two_sided is None else scene.two_sided
            attributes["bend"] = _repeat_at_corners((scene.bent * (1.0 + two_sided))[:, None])
        if self._lighting.definitions or scene.bent is not None:
            attributes["normal"] = _repeat_at_corners(scene.normals)
            attributes["lit_albedo"] = _corner_albedo(scene) * ~scene.unlit[:, None, None]
        # In cluster order, so that a cluster is a range of vertices.
        return {
            name: (
                upload_values(self._context, values[self._clusters.order]),
                f"{values.shape[-1]}f",
            )
            for name, values in attributes.items()
        }

    def _make_batch(self, scene: SceneMesh, index: int) -> Batch:
        """Batch at an index: 0 for triangles without a texture, then one for each texture."""
        names = ["radiance"]
        definitions = _COLOURED_CORNERS if scene.corner_albedo is not None else ()
        if scene.occlusion is not None:
            names, definitions = [*names, "ambient", "occlusion_at"], (*definitions, *_OCCLUDED)
        if index > 0:
            names, definitions = [*names, "uv"], (*definitions, ("TEXTURED", 1))
        if has_filter(scene):
            names, definitions = [*names, "passing", "normal"], (*definitions, *FILTERED)
        if scene.emission is not None:
            names, definitions = [*names, "emission"], (*definitions, ("EMISSIVE", 1))
        opaque: Definitions = () if scene.blended is None else (("OPAQUE", 1),)
        if scene.bent is not None:
            names = [*names, "bent_normal", "bend"]
            definitions = (*definitions, *self._lighting.bent)
        if self._lighting.definitions or scene.bent is not None:
            names = [*dict.fromkeys((*names, "normal")), "lit_albedo"]
            definitions = (*definitions, *self._lighting.definitions)
        positions = (self._position, SPLIT_FORMAT, "position", "position_rest")
        attributes = [positions, *((*self._owned[name], name) for name in names)]
        # Clusters are sorted by group, so a slice names the batch's.
        members = np.flatnonzero(self._clusters.groups == index)
        return Batch(
            clusters=slice(int(members[0]), int(members[-1]) + 1),
            definitions=definitions,
            attributes=attributes,
            vertices=self._bind((*definitions, *opaque), attributes),
            texture=None if index == 0 else self._textures[index - 1],
        )

    @cached_property
    def range_batches(self) -> list[Batch]:
        """Batches whose programs write ranges, except in holes; for scenes that have any."""
        return [self._make_range_batch(batch) for batch in self._batches]

    def _make_range_batch(self, batch: Batch) -> Batch:
        names, definitions = ["passing", "normal"], FILTERED
        if batch.texture is not None:
            names, definitions = [*names, "uv"], (*definitions, ("TEXTURED", 1))
        program = self._programs.get(ProgramSpec("face", "range", definitions))
        positions = (self._position, SPLIT_FORMAT, "position", "position_rest")
        attributes = [positions, *((*self._owned[name], name) for name in names)]
        return replace(batch, vertices=self._context.vertex_array(program, attributes))

    def draw(
        self,
        clip_from_scene: Floats,
        visible: Bools,
        pieces: TrianglePieces,
        batches: list[Batch] | None = None,
    ) -> tuple[int, int]:
        """Draw the visible clusters through a (3, 3) map to clip x, y, w.

        Args:
            clip_from_scene: Map of offsets from the viewpoint.
            visible: (m,) clusters.
            pieces: What is drawn in place of large triangles; their corners have been uploaded.
            batches: `range_batches` or `layer_batches`; None for what is opaque.

        Returns:
            Draw calls and triangles sent.
        """
        if pieces is not self._pieces:
            self._upload_pieces(pieces)
        calls = triangles = 0
        if self._atlas is not None:
            self._atlas.use(_OCCLUSION_UNIT)
        for batch in self._batches if batches is None else batches:
            offsets = self._clusters.offsets[batch.clusters.start : batch.clusters.stop + 1]
            runs = pieces.runs(visible[batch.clusters], offsets, len(self._clusters.order))
            if not runs:
                continue
            set_uniform(batch.program, "clip_from_scene", clip_from_scene.T)
            if batch.program.get("sky_faces", None) is not None:
                self._lighting.set_lights(batch.program)
            if batch.texture is not None:
                batch.texture.use_in(batch.program)
            for first, count in runs:
                batch.vertices.render(vertices=3 * count, first=3 * first)
            calls += len(runs)
            triangles += sum(count for _, count in runs)
        return calls, triangles

    def set_light(self, *, has_bake: bool) -> None:
        """Choose between baked light by nodes, and the mean of each grid."""
        self._atlas = self._occlusion
        if not has_bake and self._baked is not None:
            if self._mean_atlas is None:
                self._mean_atlas = _upload_atlas(self._context, self._baked.average())
            self._atlas = self._mean_atlas

    def _upload_pieces(self, pieces: TrianglePieces) -> None:
        """Write the attributes of pieces behind those of all triangles."""
        self._pieces = pieces
        rows = pieces.replaced.tolist()
        members = np.searchsorted(pieces.replaced, pieces.parents)
        for buffer, layout in self._owned.values() if rows else ():
            size = 4 * 3 * int(layout[:-1])  # of a triangle, bytes
            triangles = b"".join(buffer.read(size, offset=size * row) for row in rows)
            values = np.frombuffer(triangles, dtype=np.float32).reshape(len(rows), 3, -1)
            append_values(buffer, len(self._clusters.order), pieces.weights @ values[members])

    def close(self) -> None:
        """Free the buffers, vertex arrays and atlas; programs belong to the context."""
        for atlas in (self._occlusion, self._mean_atlas):
            if atlas is not None:
                atlas.release()
        layers = (batch for batches in self._layer_batches.values() for batch in batches)
        for batch in (*self.__dict__.get("range_batches", ()), *layers):
            batch.vertices.release()
        for batch in self._batches:
            batch.vertices.release()
        for buffer, _ in self._owned.values():
            buffer.release()


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """The triangles of one texture."""

    clusters: slice
    """Clusters of the batch, consecutive in the cluster table."""
    definitions: Definitions
    """Of programs that show its light."""
    attributes: list[Any]
    """Attributes of all triangles, for vertex arrays."""
    vertices: moderngl.VertexArray
    """The attributes, bound to the program that draws the batch."""
    texture: ImageTexture | None
    """Albedo texture, None without one."""

    @property
    def program(self) -> moderngl.Program:
        """Program that draws the batch."""
        return self.vertices.program


FILTERED: Definitions = (("FILTERED", 1),)
"""Definition of programs that see through holes, and through backs of one-sided facets."""


def has_filter(scene: SceneMesh) -> bool:
    """Whether rays pass some facets of a scene."""
    return scene.coverage is not None or scene.single_sided is not None


def facet_filter(scene: SceneMesh) -> Floats:
    """(n, 3, 2) coverage at corners, as `SceneMesh.coverage`; 1 without a back, 2 if blended."""
    values = np.zeros((len(scene), 3, 2))
    # A number that no opacity reaches, for facets without holes: OpenGL may know no infinity.
    values[..., 0] = 1e9 if scene.coverage is None else np.minimum(scene.coverage, 1e9)
    if scene.single_sided is not None:
        values[..., 1] = scene.single_sided[:, None]
    if scene.blended is not None:
        values[..., 1] += 2 * scene.blended[:, None]
    return values


def upload_values(
    context: moderngl.Context, values: Floats | npt.NDArray[np.float32]
) -> moderngl.Buffer:
    """Buffer of (n, 3, k) values at corners."""
    data = values.astype(np.float32).tobytes()
    # A world without surfaces is valid, an empty buffer is not.
    return context.buffer(data) if data else context.buffer(reserve=4)


def append_values(
    buffer: moderngl.Buffer, first: int, values: Floats | npt.NDArray[np.float32]
) -> None:
    """Write (m, 3, k) values at corners behind the first triangles; the buffer grows if it must."""
    data = values.astype(np.float32).tobytes()
    if not data:
        return
    start = 4 * first * values[0].size
    if buffer.size < start + len(data):
        kept = buffer.read(start)
        # The same buffer with another store: vertex arrays stay valid.
        buffer.orphan(start + 2 * len(data))
        buffer.write(kept)
    buffer.write(data, offset=start)


class ImageTexture:
    """An image on the device, continued and filtered as `world/textures.py:sample_levels` does.

    Row 0 of the image is row 0 of the texture, so (0, 0) is the image's top left corner.
    """

    def __init__(
        self, context: moderngl.Context, image: Texture, sampling: TextureSampling = REPEATED
    ) -> None:
        """Make a texture without any level.

        Args:
            context: OpenGL context.
            image: Bytes of sRGB.
            sampling: How it is continued and filtered.
        """
        self.image = image
        self._format = _FORMATS[image.shape[-1]]
        # Of one texel: a whole image would be allocated without its levels, then once more.
        self._texture = context.texture((1, 1), image.shape[-1], internal_format=self._format[0])
        nearest = moderngl.LINEAR if sampling.has_filter else moderngl.NEAREST
        self._texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, nearest)
        self._texture.repeat_x, self._texture.repeat_y = (
            not sampling.clamps_u,
            not sampling.clamps_v,
        )
        self._missing = (0.0, 1.0)

    def write(self, levels: Sequence[npt.NDArray[np.uint8]], first: int = 0) -> None:
        """Write the levels from one on, which take the place of all that there were."""
        self.use()
        # moderngl writes level by level only what the driver has computed already: 13 ms an image.
        library = ctypes.CDLL(GL_LIBRARY)
        library.glPixelStorei(_GL_UNPACK_ALIGNMENT, 1)
        for number, level in enumerate(levels):
            size = level.shape[1::-1]
            library.glTexImage2D(
                *(_GL_TEXTURE_2D, number, self._format[0], *size, 0, self._format[1]),
                *(_GL_UNSIGNED_BYTE, level.ctypes.data_as(ctypes.c_void_p)),
            )
        self._missing = (float(first), 2.0**first)

    def use(self, unit: int = 0) -> None:
        """Bind the texture to a unit."""
        self._texture.use(unit)

    def use_in(self, program: moderngl.Program) -> None:
        """Bind the texture to unit 0 for a program."""
        self.use()
        if program.get("missing_levels", None) is not None:
            set_uniform(program, "missing_levels", self._missing)

    def release(self) -> None:
        """Free the texture."""
        self._texture.release()


def upload_texture(
    context: moderngl.Context, image: Texture, sampling: TextureSampling = REPEATED
) -> ImageTexture:
    """Texture of all levels of an image."""
    texture = ImageTexture(context, image, sampling)
    texture.write(encode_levels(image))
    return texture


def encode_levels(image: Texture, first: int = 0) -> list[npt.NDArray[np.uint8]]:
    """sRGB of an image's levels, from one on; by any thread, since OpenGL has no part in it."""
    levels = [np.ascontiguousarray(image)]
    for level in build_levels(image)[max(first, 1) :]:
        encoded = np.zeros(level.shape, dtype=np.uint8)
        step = max(1, _TEXELS_AT_ONCE // level.shape[1])
        for start in range(0, len(level), step):
            encoded[start : start + step] = _encode_srgb(level[start : start + step])
        encoded[..., 3:] = np.rint(255.0 * level[..., 3:])
        levels.append(encoded)
    return levels[first > 0 :]


def _encode_srgb(light: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """sRGB bytes of light from 0 to 1, rounded as of `srgb_from_linear`, in a twentieth of its
    time."""
    below, thresholds = _find_thresholds()
    byte = below.take((light * np.float32(len(below) - 1)).astype(np.intp))
    return (byte + (light >= thresholds.take(byte))).astype(np.uint8)


@cache
def _find_thresholds() -> tuple[Indices, npt.NDArray[np.float32]]:
    """(65536,) bytes of evenly spaced light, and for each byte the least light of the next.

    Steps of light are a twentieth of the least difference between two bytes.
    """
    exact = linear_from_srgb(np.arange(0.5, 255.0, dtype=np.float64) / 255.0)
    nearest = exact.astype(np.float32)
    least = np.where(nearest < exact, np.nextafter(nearest, np.float32(2.0)), nearest)
    below = np.searchsorted(exact, np.linspace(0.0, 1.0, 2**16), side="right")
    return below, np.append(least, np.float32(np.inf))


def _upload_atlas(
    context: moderngl.Context, occlusion: OcclusionMap | None
) -> moderngl.Texture | None:
    """Texture of an occlusion map's factors, filtered as `OcclusionMap.factors` does."""
    if occlusion is None:
        return None
    channels, height, width = occlusion.planes.shape
    data = np.ascontiguousarray(np.moveaxis(occlusion.planes, 0, -1)).tobytes()
    # Rows of four: OpenGL's alignment, which the map has anyway.
    kind = "f1" if channels == 1 else "nu2"
    atlas = context.texture((width, height), channels, data, alignment=4, dtype=kind)
    atlas.swizzle = "RRR1" if channels == 1 else "RGB1"
    atlas.filter = (moderngl.LINEAR, moderngl.LINEAR)
    atlas.repeat_x = atlas.repeat_y = False
    return atlas


def _atlas_positions(occlusion: OcclusionMap, corners: Floats) -> Floats:
    """(n, 3, 2) columns and rows of the atlas at corners; 0 where nothing is hidden."""
    positions = np.zeros((*corners.shape[:2], 2))
    hidden = np.flatnonzero(occlusion.patch_of >= 0)
    triangles = np.repeat(hidden, 3)
    found = occlusion.atlas_positions(triangles, corners[hidden].reshape(-1, 3))
    positions[hidden] = found.reshape(-1, 3, 2)
    return positions


def _corner_radiance(scene: SceneMesh, lights: tuple[Light, ...]) -> Floats:
    """(n, 3, 3) radiance at the corners of each triangle by lights that are constant there."""
    if scene.corner_albedo is None:
        return _repeat_at_corners(facet_radiance(scene, lights))
    return corner_radiance(scene, scene.corner_albedo, lights)


def _corner_albedo(scene: SceneMesh) -> Floats:
    """(n, 3, 3) albedos at the corners of each triangle."""
    return _repeat_at_corners(scene.albedo) if scene.corner_albedo is None else scene.corner_albedo


def _repeat_at_corners(values: Floats) -> Floats:
    """(n, 3, k) copies of each triangle's (n, k) values at its three corners."""
    return np.repeat(values[:, None], 3, axis=1)


def _bent_normals(dynamic_object: DynamicObject) -> Floats:
    """(n, 3, 4) normals at corners, world frame, and 1 for triangles that are lit by these."""
    mesh = dynamic_object.mesh
    values = np.zeros((len(mesh), 3, 4))
    if mesh.corner_normals is not None and mesh.bent is not None:
        turned = dynamic_object.world_from_object.rotate_directions(mesh.corner_normals)
        values[..., :3], values[..., 3] = turned, mesh.bent[:, None]
    return values


class DynamicObjectBuffer:
    """The dynamic objects of one world, on the device."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        lighting: FacetLighting,
        origin: Floats,
        probes: LightProbes | None,
    ) -> None:
        """Keep the resources; nothing is allocated yet.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            lighting: Lighting model of facets.
            origin: (3,) origin of the scene's frame in the world.
            probes: Light by place, instead of that of hemisphere lights; None without.
        """
        self._probes = probes
        self._context = context
        self._programs = programs
        self._lighting = lighting
        self._origin = origin
        self._buffer: moderngl.Buffer | None = None
        self._vertices: moderngl.VertexArray | None = None
        self._spheres: _BoundingSpheres | None = None
        # Of the frame: some object has smooth facets.
        self._is_bent = False
        # Likewise: some object has textures.
        self._is_textured = False
        self._textures: dict[ObjectMesh | None, list[ImageTexture]] = {}
        self._large_triangles: dict[ObjectMesh, LargeTriangles] = {}

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

    @property
    def _definitions(self) -> Definitions:
        """Definitions of the program that draws this frame's objects."""
        bent = self._lighting.bent if self._is_bent else ()
        textured: Definitions = (("TEXTURED", 1),) if self._is_textured else ()
        return (*bent, *textured, *self._lighting.definitions)

    @property
    def _has_normals(self) -> bool:
        return self._is_bent or bool(self._lighting.definitions)

    def upload(self, objects: tuple[DynamicObject, ...], viewpoint: Floats) -> None:
        """Upload the objects of a camera state at their current poses.

        Args:
            objects: Objects in view.
            viewpoint: (3,) position in the world.
        """
        if not objects:
            self._spheres = None
            return
        is_bent = any(dynamic_object.mesh.bent is not None for dynamic_object in objects)
        is_textured = any(dynamic_object.mesh.textures for dynamic_object in objects)
        if (is_bent, is_textured) != (self._is_bent, self._is_textured):
            self._free_buffer()  # the layout changes
            self._is_bent, self._is_textured = is_bent, is_textured
        data: list[Floats] = []
        owners: list[DynamicObject] = []
        textures: list[ImageTexture | None] = []
        for dynamic_object in objects:
            for texture, values in self._vertex_data(dynamic_object, viewpoint):
                data.append(values)
                owners.append(dynamic_object)
                textures.append(texture)
        self._spheres = _BoundingSpheres(
            centres=np.array([dynamic_object.centre - self._origin for dynamic_object in owners]),
            radii=np.array([dynamic_object.mesh.radius_m for dynamic_object in owners]),
            offsets=np.cumsum([0, *(len(values) // 3 for values in data)]),
            textures=textures,
            lightings=[self._light(dynamic_object) for dynamic_object in owners],
        )
        self._write_vertices(np.concatenate(data))

    def _light(self, dynamic_object: DynamicObject) -> FacetLighting:
        """Lighting of an object at its place."""
        if self._probes is None:
            return self._lighting
        sky = self._probes.find_light(dynamic_object.centre)
        lights = self._lighting.constant_lights
        others = (light for light in lights if not isinstance(light, HemisphereLight))
        return replace(self._lighting, constant_lights=(sky, *others))

    def _find_textures(self, mesh: ObjectMesh | None) -> list[ImageTexture]:
        """Textures of a mesh; one white texture for None."""
        if mesh not in self._textures:
            white = np.full((1, 1, 3), 255, dtype=np.uint8)
            looks = [(white, REPEATED)]
            if mesh is not None:
                looks = list(zip(mesh.textures, mesh.samplings, strict=True))
            self._textures[mesh] = [upload_texture(self._context, *look) for look in looks]
        return self._textures[mesh]

    def _vertex_data(
        self, dynamic_object: DynamicObject, viewpoint: Floats
    ) -> Iterator[tuple[ImageTexture | None, Floats]]:
        """Yield textures, and (3 n, k) attributes of their corners, split positions first."""
        world_facets_of = world_facets(dynamic_object)
        lights = self._light(dynamic_object).constant_lights
        attributes = [facet_radiance(world_facets_of, lights)]
        if self._has_normals:
            # An albedo of zero for unlit materials spares the shader a branch.
            attributes += [
                world_facets_of.normals,
                world_facets_of.albedo * ~world_facets_of.unlit[:, None],
            ]
        corners, triangles, weights = self._split(dynamic_object, viewpoint)
        positions = dynamic_object.world_from_object.transform_points(corners) - self._origin
        per_triangle = np.concatenate(attributes, axis=-1)[triangles]
        # OpenGL 3.3 has no attributes per triangle: each corner carries a copy.
        per_corner = np.broadcast_to(
            per_triangle[:, None], (*positions.shape[:2], per_triangle.shape[1])
        )
        vertices: Floats = np.concatenate((split_positions(positions), per_corner), axis=-1)
        if self._is_bent:
            bent = _bent_normals(dynamic_object)[triangles]
            bent = bent if weights is None else weights @ bent
            vertices = np.concatenate((vertices, bent), axis=-1)
        if not self._is_textured:
            yield None, vertices.reshape(-1, vertices.shape[-1])
            return
        mesh = dynamic_object.mesh
        uv, index = np.zeros((len(mesh), 3, 2)), np.full(len(mesh), -1)
        if mesh.textures:
            uv, index = mesh.uv, mesh.texture_index
        uv, index = uv[triangles], index[triangles]
        vertices = np.concatenate((vertices, uv if weights is None else weights @ uv), axis=-1)
        for number in np.unique(index).tolist():
            of_mesh = self._find_textures(mesh if number >= 0 else None)
            rows = vertices[index == number]
            yield of_mesh[max(number, 0)], rows.reshape(-1, rows.shape[-1])

    def _split(
        self, dynamic_object: DynamicObject, viewpoint: Floats
    ) -> tuple[Floats, Indices | slice, Floats | None]:
        """As `LargeTriangles.replace`, in the object's frame; weights None: none is split."""
        mesh, pose = dynamic_object.mesh, dynamic_object.world_from_object
        # Most objects are far, and their sphere is small for its distance.
        near_m = math.dist(dynamic_object.centre, viewpoint) - mesh.radius_m
        if 2.0 * mesh.radius_m <= MAX_SIZE_PER_DISTANCE * near_m:
            return mesh.corners, slice(None), None
        if mesh not in self._large_triangles:
            clusters = make_clusters(mesh.corners, np.zeros(len(mesh), dtype=np.intp))
            self._large_triangles[mesh] = LargeTriangles(clusters, mesh.corners)
        return self._large_triangles[mesh].replace((viewpoint - pose.translation) @ pose.rotation)

    def _write_vertices(self, values: Floats) -> None:
        """Write the vertices; the buffer grows when necessary and never shrinks."""
        data = values.astype(np.float32).tobytes()
        if self._buffer is None or self._buffer.size < len(data):
            self._free_buffer()
            self._buffer = self._context.buffer(reserve=len(data), dynamic=True)
            self._vertices = self._vertex_array(self._buffer)
        # A new store instead of waiting until the last frame has been drawn from the old one.
        self._buffer.orphan()
        self._buffer.write(data)

    def _vertex_array(self, buffer: moderngl.Buffer) -> moderngl.VertexArray:
        """Vertex array with the attributes of the lighting."""
        names, layout = ["position", "position_rest", "radiance"], f"{SPLIT_FORMAT} 3f"
        if self._has_normals:
            names, layout = [*names, "normal", "lit_albedo"], f"{layout} 3f 3f"
        if self._is_bent:
            names, layout = [*names, "bent_normal", "bend"], f"{layout} 3f 1f"
        if self._is_textured:
            names, layout = [*names, "uv"], f"{layout} 2f"
        program = self._programs.get(ProgramSpec("face", "face", self._definitions))
        return self._context.vertex_array(program, [(buffer, layout, *names)])

    def draw(self, clip_from_scene: Floats, planes: Floats, viewpoint: Floats) -> tuple[int, int]:
        """Draw the objects in front of (p, 3) planes; return the draw calls and triangles sent."""
        spheres = self._spheres
        if self._vertices is None or spheres is None:
            return 0, 0
        # A sphere is outside once its centre is more than a radius behind a plane; the normals are
        # not unit, so the radius is scaled by their lengths.
        radii = np.outer(spheres.radii, np.linalg.norm(planes, axis=-1))
        visible = np.asarray(((spheres.centres - viewpoint) @ planes.T >= -radii).all(axis=-1))
        if visible.any():
            set_uniform(self._vertices.program, "clip_from_scene", clip_from_scene.T)
        calls = triangles = 0
        # Of smooth objects under probes each has uniforms of its own.
        keys = [*zip(spheres.textures, spheres.lightings, strict=True)]
        for key in dict.fromkeys(keys):
            texture, lighting = key
            is_chosen = np.array([one == key for one in keys])
            if texture is not None:
                texture.use_in(self._vertices.program)
            if visible.any() and self._is_bent:
                lighting.set_lights(self._vertices.program)
            for first, count in visible_runs(visible & is_chosen, spheres.offsets):
                self._vertices.render(vertices=3 * count, first=3 * first)
                calls, triangles = calls + 1, triangles + count
        return calls, triangles

    def draw_positions(self, program: moderngl.Program) -> None:
        """Draw all objects by a program that reads nothing but split positions."""
        if self._buffer is None or self._spheres is None:
            return
        rest = 36 if self._has_normals else 12
        rest += 16 * self._is_bent + 8 * self._is_textured
        attributes = (self._buffer, f"{SPLIT_FORMAT} {rest}x", "position", "position_rest")
        vertices = self._context.vertex_array(program, [attributes])
        vertices.render(vertices=3 * int(self._spheres.offsets[-1]))
        vertices.release()

    def close(self) -> None:
        """Free buffer and textures, if any; the program belongs to the context."""
        self._free_buffer()
        for texture in (one for of_mesh in self._textures.values() for one in of_mesh):
            texture.release()
        self._textures = {}

    def _free_buffer(self) -> None:
        if self._vertices is not None:
            self._vertices.release()
        if self._buffer is not None:
            self._buffer.release()
        self._vertices = self._buffer = None


@dataclass(frozen=True, slots=True, eq=False)
class _BoundingSpheres:
    """Bounding spheres of one frame's objects, and their ranges of triangles in the buffer."""

    centres: Floats
    """(n, 3) centres, scene frame."""
    radii: Floats
    """(n,) radii, metres."""
    offsets: Indices
    """(n + 1,) first triangle of each object, and the number of all."""
    textures: list[ImageTexture | None]
    """Texture of each; objects with several are listed once for each."""
    lightings: list[FacetLighting]
    """Lighting of each at its place."""
