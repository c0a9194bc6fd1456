"""A static scene on the device: uploaded once, drawn for any face.

Triangles are grouped by texture and cut into clusters. Pieces of triangles that are large for their
distance stand behind them in the same buffers, and are written anew where the viewpoint needs
others. Shadows use a second set of attributes and shadow maps; neither exists before the first
camera state with shadows. Facets then carry the light of hemisphere lights alone, and each fragment
adds the unshadowed part of the other lights.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.projection.large_triangles import LargeTriangles, TrianglePieces
from catoptra_server.render.raster.device import (
    SPLIT_FORMAT,
    FrameUniforms,
    SampleSpacing,
    ShaderPrograms,
    set_fog,
    set_spacing,
    split_positions,
)
from catoptra_server.render.raster.scene_batches import (
    DynamicObjectBuffer,
    FacetLighting,
    ImageTexture,
    SceneBatches,
    append_values,
    encode_levels,
    has_filter,
    upload_values,
)
from catoptra_server.render.raster.shadow_maps import ShadowMaps
from catoptra_server.runtime.memory import (
    MAX_LIGHT_TEXELS,
    count_processors,
    release_freed_memory,
)
from catoptra_server.world.objects import CameraState, FogMedium
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    hemisphere_lights,
    object_lights,
    point_lights,
    shadow_casting_lights,
)
from catoptra_server.world.textures import Texture
from catoptra_server.world.triangles import TriangleClusters, make_clusters
from catoptra_server.world.world_description import Light, PointLight, World

# Two vec3 a light, each as large as a vec4, in the 1024 uniform components that OpenGL 3.3
# guarantees; the rest is for matrices.
_MAX_POINT_LIGHTS = 100


class LitScene:
    """A scene and its dynamic objects under one lighting."""

    def __init__(
        self,
        batches: SceneBatches,
        dynamic_objects: DynamicObjectBuffer,
        origin: Floats,
        *,
        point_lights: tuple[PointLight, ...] = (),
        object_point_lights: tuple[PointLight, ...] = (),
        maps: ShadowMaps | None = None,
    ) -> None:
        """Take over batches, objects and maps.

        Args:
            batches: Static triangles.
            dynamic_objects: Objects.
            origin: (3,) origin of the scene's frame in the world.
            point_lights: Lights of the batches' uniforms.
            object_point_lights: Lights of the objects' uniforms: objects receive the culled lights
                too, so their program may have more lights than the scene's.
            maps: Shadow maps; their programs have the maps' uniforms instead of point lights.
        """
        self.batches = batches
        self.dynamic_objects = dynamic_objects
        self.maps = maps
        self._origin = origin
        self._point_lights = point_lights
        self._object_point_lights = object_point_lights

    def set_frame(self, viewpoint: Floats) -> None:
        """Write the uniforms of a frame from a (3,) viewpoint in the scene's frame, metres."""
        lights_of = dict.fromkeys(self.batches.programs, self._point_lights)
        lights_of |= dict.fromkeys(self.dynamic_objects.programs, self._object_point_lights)
        for program, lights in lights_of.items():
            uniforms = FrameUniforms.from_viewpoint(viewpoint, lights=lights, origin=self._origin)
            uniforms.apply_to(program)
            if self.maps is not None:
                self.maps.apply_to(program, viewpoint)
        if self.maps is not None:
            self.maps.bind()

    def set_fog(self, fog: FogMedium | None) -> None:
        """Write the fog of a frame; None for clear air."""
        for program in self.batches.programs | self.dynamic_objects.programs:
            set_fog(program, fog)

    def set_spacing(self, spacing: SampleSpacing | None, axis: Floats) -> None:
        """Choose the levels of textures for samples around a (3,) axis; None for fragments'."""
        for program in self.batches.programs | self.dynamic_objects.programs:
            set_spacing(program, spacing, axis)

    def close(self) -> None:
        """Free all resources but the corners, which belong to the scene."""
        self.dynamic_objects.close()
        self.batches.close()
        if self.maps is not None:
            self.maps.close()


class SceneTextures:
    """Images of a static scene on the device.

    Levels of a large scene's images are there once a frame reads them: most of a house's walls are
    too far away for the image itself, three quarters of all texels. A sample's footprint, in
    texels, is at least the angle between samples times the distance over the size of a texel: a
    surface that is turned away has larger steps, and of these the shorter counts at least once.
    """

    def __init__(
        self, context: moderngl.Context, scene: SceneMesh, clusters: TriangleClusters
    ) -> None:
        """Upload the images, but of a large scene only what has an opacity, which holes look up.

        Args:
            context: OpenGL context.
            scene: Triangles and images.
            clusters: The triangles, grouped by image, after a group without any.
        """
        looks = zip(scene.textures, scene.samplings, strict=True)
        self.images = [ImageTexture(context, *look) for look in looks]
        """In the order of the scene's."""
        self._clusters = clusters
        is_large = sum(math.prod(image.shape[:2]) for image in scene.textures) > MAX_LIGHT_TEXELS
        coarsest = [_count_halvings(image) * is_large for image in scene.textures]
        self._coarsest = np.array(coarsest, dtype=np.intp)
        self._first = np.where(self._coarsest > 0, self._coarsest + 1, 0)
        self._write(np.flatnonzero(self._coarsest == 0))
        if self._coarsest.any():
            sizes = _texel_sizes(scene)[clusters.order]
            self._texel_m = np.maximum.reduceat(sizes, clusters.offsets[:-1])

    def refine(self, viewpoint: Floats, least_rad: float) -> None:
        """Upload the levels that a frame may read and that are not there.

        Args:
            viewpoint: (3,) position in the scene's frame.
            least_rad: Smallest angle between two samples of the image, rad; 0: unknown.
        """
        if not self._first.any():
            return
        footprints = least_rad * self._clusters.distances(viewpoint) / self._texel_m
        by_group = np.full(len(self.images) + 1, np.inf)
        np.minimum.at(by_group, self._clusters.groups, footprints)
        # A fifth is for the polynomials' error, the fragments' derivatives and the next frames.
        levels = np.log2(np.clip(0.8 * by_group[1:], 1.0, 2.0**20)).astype(np.intp)
        first = np.minimum(np.minimum(levels, self._coarsest), self._first)
        stale = np.flatnonzero(first < self._first)
        self._first = first
        self._write(stale)

    def _write(self, numbers: npt.NDArray[np.intp]) -> None:
        """Upload images from their first levels on."""
        first = self._first.tolist()
        with ThreadPoolExecutor(count_processors()) as pool:
            chosen = [(self.images[number], first[number]) for number in numbers]
            encoded = pool.map(lambda one: encode_levels(one[0].image, one[1]), chosen)
            for (image, level), levels in zip(chosen, encoded, strict=True):
                image.write(levels, level)
        if self._coarsest.any() and len(chosen):
            release_freed_memory()


def _count_halvings(image: Texture) -> int:
    """How often both sides have a half; 0 with opacity."""
    height, width, channels = image.shape
    sides = height | width
    return (sides & -sides).bit_length() - 1 if channels == 3 else 0


def _texel_sizes(scene: SceneMesh) -> Floats:
    """(n,) upper bounds of the sides of a texel on each triangle, m; inf where it is a line."""
    sides = np.array([(1.0, 1.0), *(image.shape[1::-1] for image in scene.textures)])
    edges, uv = scene.corners[:, 1:] - scene.corners[:, :1], scene.corner_uv
    texels = (uv[:, 1:] - uv[:, :1]) * sides[scene.texture_index + 1][:, None]
    (a, b), (c, d) = texels.transpose(1, 2, 0)
    first, second = edges.transpose(1, 2, 0)
    area = np.abs(a * d - b * c)
    # The longest vector that a step of one texel in any direction becomes.
    steps = np.square(d * first - b * second) + np.square(a * second - c * first)
    length = np.sqrt(steps.sum(axis=0))
    sizes = np.where(area > 0.0, length / np.where(area > 0.0, area, 1.0), np.inf)
    # A line, or what has no texture, is as good as none.
    return np.where(scene.texture_index < 0, 0.0, sizes).clip(min=1e-9)


class SceneBuffers:
    """Vertex buffers, textures and programs of one world."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneMesh,
        world: World,
        *,
        scene_lights: tuple[Light, ...] | None = None,
    ) -> None:
        """Upload a scene.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            scene: Triangles of the static scene.
            world: Lights and background.
            scene_lights: Lights that change the static scene visibly; None for all of the world.

        Raises:
            DomainError: More point lights than uniforms hold.
        """
        self._context = context
        self.programs = programs
        """Shader programs of the context."""
        self._scene = scene
        self._world = world
        lights = world.lights if scene_lights is None else scene_lights
        # Two lightings: objects move towards lights that are too weak for the static scene.
        lighting = _make_facet_lighting(lights)
        object_lighting = _make_facet_lighting(object_lights(world))
        self.background = world.background
        self.sky: moderngl.Texture | None = None
        """Radiance by direction, where it is not that of the background."""
        if world.sky is not None:
            # Half floats hold mantissas of 9 bits with these exponents exactly.
            texels = world.sky.decode().astype(np.float16)
            size = texels.shape[1], texels.shape[0]
            self.sky = context.texture(size, 3, texels.tobytes(), alignment=1, dtype="f2")
            self.sky.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.has_filter = has_filter(scene)
        """Whether rays pass some facets."""
        self.report_dropped_layers = scene.report_dropped_layers
        self.origin = scene.centre
        corners = scene.corners - self.origin
        # Grouped by texture first: a batch's clusters are consecutive, and group 0 has no texture.
        self.clusters = make_clusters(corners, (scene.texture_index + 1).astype(np.intp))
        self.blended: Bools = np.zeros(len(self.clusters.groups), dtype=bool)
        """(m,) clusters with facets that blend."""
        if scene.blended is not None:
            order, offsets = self.clusters.order, self.clusters.offsets
            self.blended = np.logical_or.reduceat(scene.blended[order], offsets[:-1])
        self._large_triangles = LargeTriangles(self.clusters, corners)
        self._pieces: TrianglePieces | None = None
        self._position = upload_values(context, split_positions(corners[self.clusters.order]))
        # Held once, for the batches of both lightings and for shadow maps.
        self.textures = SceneTextures(context, scene, self.clusters)
        self.plain = LitScene(
            self._make_batches(lighting),
            DynamicObjectBuffer(context, programs, object_lighting, self.origin, world.probes),
            self.origin,
            point_lights=point_lights(lights),
            object_point_lights=point_lights(world.lights),
        )
        """The scene without shadows."""
        self._shadowed: LitScene | None = None

    def _make_batches(self, lighting: FacetLighting) -> SceneBatches:
        return SceneBatches(
            self._context,
            self.programs,
            self._scene,
            self.clusters,
            position=self._position,
            lighting=lighting,
            textures=self.textures.images,
        )

    def split_large_triangles(self, viewpoint: Floats) -> TrianglePieces:
        """Pieces for a (3,) viewpoint in the scene's frame, their corners uploaded."""
        pieces = self._large_triangles.split(viewpoint)
        if pieces is not self._pieces:
            self._pieces = pieces
            append_values(self._position, len(self._scene), split_positions(pieces.corners))
        return pieces

    def make_position_array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Vertex array of all corners, cluster by cluster, without other attributes.

        The caller frees the array, not the buffer.
        """
        attributes = [(self._position, SPLIT_FORMAT, "position", "position_rest")]
        return self._context.vertex_array(program, attributes)

    def with_lighting(self, camera_state: CameraState) -> LitScene:
        """Scene under the lighting of a camera state: with shadows where some light casts any."""
        if not camera_state.has_shadows or not shadow_casting_lights(self._world.lights):
            return self.plain
        # Built at the first frame with shadows: maps of up to 128 MiB that most worlds never need.
        if self._shadowed is None:
            self._shadowed = self._add_shadows()
        assert self._shadowed.maps is not None
        # The static scene's maps were drawn once.
        self._shadowed.maps.draw_objects(camera_state.objects)
        return self._shadowed

    def _add_shadows(self) -> LitScene:
        """Upload attributes, and draw the shadow maps of the static scene."""
        context, programs, lights = self._context, self.programs, self._world.lights
        maps = ShadowMaps(
            context,
            programs,
            self._scene,
            shadow_casting_lights(lights),
            origin=self.origin,
            textures=self.textures.images,
        )
        lighting = FacetLighting(hemisphere_lights(lights), maps.definitions)
        sky = hemisphere_lights(object_lights(self._world))
        object_lighting = FacetLighting(sky, maps.definitions)
        probes = self._world.probes
        objects = DynamicObjectBuffer(context, programs, object_lighting, self.origin, probes)
        return LitScene(self._make_batches(lighting), objects, self.origin, maps=maps)

    def close(self) -> None:
        """Free the buffers, vertex arrays and textures; programs belong to the context."""
        self.plain.close()
        if self._shadowed is not None:
            self._shadowed.close()
        self._position.release()
        for texture in (*self.textures.images, *((self.sky,) if self.sky else ())):
            texture.release()


def _make_facet_lighting(lights: tuple[Light, ...]) -> FacetLighting:
    """Lighting of facets without shadows."""
    count = len(point_lights(lights))
    if count > _MAX_POINT_LIGHTS:
        raise DomainError(f"raster draws at most {_MAX_POINT_LIGHTS} point lights, not {count}")
    return FacetLighting(lights, (("NUM_POINT_LIGHTS", count),) if count else ())
