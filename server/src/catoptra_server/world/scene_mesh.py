"""Triangles of a whole static world, the input of both renderers.

A triangle soup in the world frame: each triangle has one normal, one material and three texture
coordinates. Colours belong to materials; only a mesh file with colours at its vertices has colours
that vary over a triangle. Shapes, mesh files and textures are loaded within one memory budget.

Placements of a mesh file are copies in the scene: which surface fills a part of an image, and which
light is free of shadows, is proved over one hierarchy of all triangles, in which instances would be
closed boxes. A copied triangle costs as much of the budget as any (`runtime/memory.py`); its file,
material and textures are read and held once.

Large meshes are moved in place, in blocks of rows: half of a start with a million triangles was the
system's time for new pages, of 507 MB then and 355 now.

A landmark, beacon or goal, is built from one row of the landmark file
(`catoptra_protocol.landmarks`), from which clients localize: rendered shapes and promised positions
have one source.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field, fields, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.memory import BYTES_PER_TRIANGLE, MemoryBudget
from catoptra_server.world.shading import MAX_LAYERS, OcclusionMap
from catoptra_server.world.shapes import (
    bounding_box,
    build_shape,
    facet_normals,
    max_triangles,
    project_tiles,
)
from catoptra_server.world.textures import (
    MeshAppearance,
    Texture,
    TextureReader,
    TextureSampling,
    no_texture_coordinates,
)
from catoptra_server.world.triangles import TriangleHierarchy, row_blocks, tile_over_block
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Facets,
    Item,
    Material,
    MeshFile,
    Primitive,
    Rgb,
    SceneObject,
    Vector3,
    World,
)

log = logging.getLogger(__name__)
# Normals turned in the world differ by rounding from those of their facets. Half of what the
# laboratory shows was lit ray by ray for it.
_MAX_FLAT_TURN = 1e-9
_DROPPED_LAYERS = (
    f"more than {MAX_LAYERS} surfaces that blend lie behind one another: the nearest {MAX_LAYERS} "
    "are drawn over what is opaque, the others are not"
)
if TYPE_CHECKING:
    from catoptra_server.world.mesh_files import MeshFileLoader

MAX_FLOAT_REACH_M = 64.0
"""Coordinates up to it are precise enough as float32, beside a camera: steps of 4 micrometres."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneMesh:
    """Triangles of a world."""

    corners: Floats
    """(n, 3, 3) metres, world frame."""
    normals: Floats
    """(n, 3) unit, from the winding; 0 for a triangle without area."""
    uv: Floats
    """(k, 3, 2) texture coordinates; zeros that take no memory in a scene without textures."""
    albedo: Floats
    """(n, 3) linear; the mean of the corners where these differ."""
    unlit: Bools
    """(n,) whether the triangle is shown at its albedo, whatever the lights."""
    texture_index: npt.NDArray[np.int32]
    """(n,) index into `textures`; -1 for none."""
    textures: tuple[Texture, ...]
    """(h, w, 3) uint8 sRGB each."""
    samplings: tuple[TextureSampling, ...]
    """How each texture is sampled."""
    item_index: npt.NDArray[np.int32]
    """(n,) index into `item_names`."""
    item_names: tuple[str, ...]
    """Names of the world's items, landmarks' last."""
    casts_shadows: Bools
    """(n,) whether the triangle occludes lights."""
    object_index: npt.NDArray[np.int32]
    """(n,) index into `objects`."""
    objects: tuple[SceneObject, ...]
    """Objects in the order of their first items, landmarks last."""
    item_rotations: Floats | None = None
    """(k, 3, 3) world from each item's own axes; None: those of the world."""
    uv_rows: npt.NDArray[np.int32] | None = None
    """(n,) row of `uv` of each triangle, which placements of a file share; None: its own, k = n."""
    corner_albedo: Floats | None = None
    """(n, 3, 3) linear albedos at the corners, interpolated linearly over each triangle; None in a
    scene whose triangles have one albedo each."""
    emission: Floats | None = None
    """(n, 3) linear radiance of their own; None in a scene whose triangles only reflect."""
    gloss: Floats | None = None
    """(n, 2) reflectance along the normal, 0 for a matt triangle, and roughness; None: all are."""
    corner_normals: Floats | None = None
    """(n, 3, 3) unit normals at corners, by which light is reflected between, geometry left as it
    is; None in a scene of flat triangles."""
    two_sided: Bools | None = None
    """(n,) triangles whose backs are lit by the opposite normal; None: all by that of the front."""
    single_sided: Bools | None = None
    """(n,) triangles whose backs no camera sees; None: no triangle."""
    coverage: Floats | None = None
    """(n, 3) opacity at corners over that of the emptiest point which is a surface, inf for
    triangles without holes; times the texture's. None in a scene without holes."""
    blended: Bools | None = None
    """(n,) triangles behind which more is seen, by an opacity of half the coverage: surfaces for
    all but pictures where it is at least one half; None: no triangle."""
    occlusion: OcclusionMap | None = None
    """How much of the sky's light reaches each point; None: all of it, everywhere."""
    is_smooth: Bools = field(init=False)
    """(n,) triangles with other normals at their corners than their own; empty for flat scenes."""
    bent: Bools | None = field(init=False)
    """(n,) lit triangles that may be lit by other normals than their own; None: no triangle."""
    box_min: Floats = field(init=False)
    """(3,) smallest coordinates; inf in a scene without triangles."""
    box_max: Floats = field(init=False)
    """(3,) largest coordinates; -inf in a scene without triangles."""
    centre: Floats = field(init=False)
    """(3,) centre of the box, the world's origin for a scene without triangles. Origin of the
    renderers' float32 coordinates: precise in a world far from its origin."""
    is_large: bool = field(init=False)
    """Whether float32 relative to the centre is too coarse for what is near a camera."""
    hierarchy: Callable[[], TriangleHierarchy] = field(init=False)
    """Triangles in groups of neighbours; made at the first call."""
    report_dropped_layers: Callable[[], None] = field(init=False)
    """Log, once, that a ray meets more blended surfaces than it shows."""

    def __post_init__(self) -> None:
        """Find the box around all triangles, which renderers and bounds need in several places."""
        self._find_bent()
        low, high = bounding_box(self.corners)
        object.__setattr__(self, "box_min", low)
        object.__setattr__(self, "box_max", high)
        centre = 0.5 * (low + high) if len(self) else np.zeros(3)
        object.__setattr__(self, "centre", centre)
        is_large = bool(len(self)) and float((high - low).max()) > 2.0 * MAX_FLOAT_REACH_M
        object.__setattr__(self, "is_large", is_large)
        object.__setattr__(self, "hierarchy", cache(partial(TriangleHierarchy, self.corners)))
        report = partial(log.warning, "%s", _DROPPED_LAYERS)
        object.__setattr__(self, "report_dropped_layers", cache(report))
        for array in (self.corners, self.normals, self.uv, self.albedo, self.unlit):
            array.setflags(write=False)
        for array in (low, high, centre):
            array.setflags(write=False)

    def _find_bent(self) -> None:
        smooth: Bools = np.zeros(0, dtype=bool)
        bent = self.two_sided
        if self.corner_normals is not None:
            turned = np.abs(self.corner_normals - self.normals[:, None]).max(axis=(1, 2))
            smooth = np.asarray(turned > _MAX_FLAT_TURN)
            bent = smooth if bent is None else np.asarray(smooth | bent)
        object.__setattr__(self, "is_smooth", smooth)
        object.__setattr__(self, "bent", None if bent is None else bent & ~self.unlit)

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.corners)

    def repaint(self, **looks: Any) -> SceneMesh:
        """The same triangles with other looks: albedo, corner_albedo, gloss, uv, texture_index."""
        # Nothing that follows from corners and normals is found again: 40 ms of 50 000 triangles.
        other = object.__new__(SceneMesh)
        for one in fields(SceneMesh):
            object.__setattr__(other, one.name, looks.get(one.name, getattr(self, one.name)))
        return other

    @property
    def corner_uv(self) -> Floats:
        """(n, 3, 2) texture coordinates of each triangle, which take memory of their own."""
        return self.uv if self.uv_rows is None else self.uv[self.uv_rows]

    def is_far(self, point: Floats) -> bool:
        """Whether float32 relative to the centre is too coarse for what is near a (3,) point."""
        # Plain floats: for each frame, in a fifth of the time of arrays.
        pairs = zip(point.tolist(), self.centre.tolist(), strict=True)
        return any(abs(at - middle) > MAX_FLOAT_REACH_M for at, middle in pairs)

    @property
    def max_fresnel(self) -> float:
        """Largest part of light that any triangle mirrors, at a grazing angle; 0 without gloss."""
        if self.gloss is None:
            return 0.0
        reflectance, roughness = self.gloss[self.gloss[:, 0] > 0.0].T
        return float(np.maximum(reflectance, 1.0 - roughness).max(initial=0.0))

    @property
    def baked_light(self) -> OcclusionMap | None:
        """Map of baked light; None without, or where all is ambient occlusion."""
        has_light = self.occlusion is not None and self.occlusion.ranges is not None
        return self.occlusion if has_light else None

    def max_albedo(self, triangles: slice | npt.NDArray[np.intp]) -> Floats:
        """(m, 3) largest albedo of each of some triangles, in each colour channel."""
        if self.corner_albedo is None:
            return self.albedo[triangles]
        first, second, third = np.moveaxis(self.corner_albedo[triangles], 1, 0)
        largest: Floats = np.maximum(np.maximum(first, second), third)
        return largest

    def smallest_sky_factors(self, triangles: slice | npt.NDArray[np.intp]) -> Floats:
        """(m, 1) or (m, 3) smallest factors of hemisphere light on each of some triangles."""
        if self.occlusion is None:
            return np.ones((len(self.corners[triangles]), 1))
        return self.occlusion.smallest_factors(triangles)

    def has_varying_albedo(self, triangles: slice | npt.NDArray[np.intp]) -> Bools:
        """(m,) triangles of which some points may be darker than `max_albedo`, by any factor."""
        index = self.texture_index[triangles]
        return index >= 0 if self.corner_albedo is None else np.ones(len(index), dtype=bool)


def build_scene(
    world: World, memory: MemoryBudget | None = None, *, has_texels: bool = True
) -> SceneMesh:
    """Build the triangles of a world, landmarks included.

    Args:
        world: the description.
        memory: budget of all triangles and textures; None for the default.
        has_texels: whether images are decoded; else textures are white, for shapes alone.

    Raises:
        ConfigError: A mesh or texture file is missing or unusable, or the budget is exceeded.
    """
    landmark_items = [
        item
        for landmark in world.landmarks
        for item in _items_from_landmark(landmark, world.landmark_albedos)
    ]
    items = (*world.items, *landmark_items)
    with TextureReader(memory, has_texels=has_texels) as textures:
        loader = _ItemLoader(world.name, items, textures)
        parts = [part for number in range(len(items)) for part in loader.load_parts(number)]
        for part in parts:
            with _locate_errors(items[part.item]):
                textures.wait(part.appearance.texture)
    return _concatenate_parts(parts, items)


@contextmanager
def _locate_errors(item: Item) -> Iterator[None]:
    """Say in errors of an item's files which line of the world names them."""
    try:
        yield
    except ConfigError as error:
        if item.where is None:
            raise
        # A mesh may be one of fifty, and refer to others.
        source = str(error.location)
        expected = error.expected if source == error.value else f"{error.expected}; {source}"
        key = f"{item.name}.{error.key}"
        raise ConfigError(item.where, key=key, value=error.value, expected=expected) from error


@dataclass(frozen=True, slots=True, eq=False)
class MeshPart:
    """Triangles of a file or an item that share an appearance."""

    corners: Floats
    """(n, 3, 3) metres, SAE; in the world frame for an item."""
    normals: Floats
    """(n, 3) unit, by the winding; 0 for a triangle without area."""
    appearance: MeshAppearance
    node: str = ""
    """Node of a glTF file; empty for all else."""
    item: int = -1
    """Index of the item in its world; -1 in no world."""


def _concatenate_parts(parts: list[MeshPart], items: tuple[Item, ...]) -> SceneMesh:
    # An empty world is valid: concatenation needs at least one array of the right shape.
    parts = parts or [_make_empty_part()]
    looks = [part.appearance for part in parts]
    counts = [len(part.corners) for part in parts]
    owners = [
        SceneObject.from_item(items[part.item], part.node) for part in parts if part.item >= 0
    ]
    objects = tuple(dict.fromkeys(owners))
    numbers = {one: index for index, one in enumerate(objects)}
    # By identity: `TextureReader` holds equal files once.
    distinct = {_texture_key(look): (look.texture, look.sampling) for look in looks}
    textures = [(image, way) for image, way in distinct.values() if image is not None]
    numbers_of_textures = {(id(image), way): n for n, (image, way) in enumerate(textures)}
    numbers_of_textures |= {key: -1 for key, (image, _) in distinct.items() if image is None}
    uv, uv_rows = _share_uv(looks) if textures else (no_texture_coordinates(sum(counts)), None)
    casts_shadows = [part.item >= 0 and items[part.item].casts_shadows for part in parts]
    return SceneMesh(
        corners=_concatenate([part.corners for part in parts]),
        normals=_concatenate([part.normals for part in parts]),
        uv=uv,
        uv_rows=uv_rows,
        albedo=_concatenate_albedos([look.albedo for look in looks]),
        corner_albedo=_concatenate_corner_albedos(looks),
        emission=_repeat_rows([look.emission for look in looks], counts),
        gloss=_repeat_rows([look.gloss for look in looks], counts),
        corner_normals=_concatenate_corner_normals(parts),
        two_sided=_repeat_flags([look.two_sided for look in looks], counts),
        single_sided=_repeat_flags([look.single_sided for look in looks], counts),
        coverage=_concatenate_coverage(looks, counts),
        blended=_repeat_flags([look.blends for look in looks], counts),
        unlit=np.repeat(np.array([look.unlit for look in looks]), counts),
        texture_index=_repeat([numbers_of_textures[_texture_key(look)] for look in looks], counts),
        textures=tuple(texture for texture, _ in textures),
        samplings=tuple(sampling for _, sampling in textures),
        item_index=_repeat([part.item for part in parts], counts),
        item_names=tuple(item.name for item in items),
        item_rotations=np.array([item.world_from_item.rotation for item in items]).reshape(
            -1, 3, 3
        ),
        casts_shadows=np.repeat(np.array(casts_shadows), counts),
        object_index=_repeat([numbers[owner] for owner in owners] or [-1], counts),
        objects=objects,
    )


def _texture_key(look: MeshAppearance) -> tuple[int, TextureSampling]:
    return id(look.texture), look.sampling


def _repeat(values: list[int], counts: Sequence[int]) -> npt.NDArray[np.int32]:
    return np.repeat(np.array(values, dtype=np.int32), counts)


def _concatenate(arrays: list[Floats]) -> Floats:
    """All rows; the array itself where there is one, so that a large mesh is not copied."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def _share_uv(looks: list[MeshAppearance]) -> tuple[Floats, npt.NDArray[np.int32] | None]:
    """Texture coordinates of parts, those in the same memory once, and their rows, if that saves
    memory."""
    distinct: dict[tuple[object, ...], tuple[int, Floats]] = {}
    starts, num_rows = [], 0
    for look in looks:
        key = look.uv.__array_interface__["data"], look.uv.shape, look.uv.strides
        if key not in distinct:
            distinct[key] = num_rows, look.uv
            num_rows += len(look.uv)
        starts.append(distinct[key][0])
    # Rows cost a frame of small triangles a twentieth: not for less than half of the memory.
    if 2 * num_rows > sum(len(look.uv) for look in looks):
        return _concatenate([look.uv for look in looks]), None
    rows = [
        np.arange(at, at + len(look.uv), dtype=np.int32)
        for at, look in zip(starts, looks, strict=True)
    ]
    return _concatenate([uv for _, uv in distinct.values()]), np.concatenate(rows)


def _concatenate_albedos(albedos: list[Floats]) -> Floats:
    """All rows; one row, repeated without memory, where textures alone have colours."""
    rows = [albedo[:1] for albedo in albedos if len(albedo)]
    is_one = all(len(albedo) == 1 or albedo.strides[0] == 0 for albedo in albedos if len(albedo))
    if not rows or not is_one or not all(np.array_equal(row, rows[0]) for row in rows):
        return _concatenate(albedos)
    return np.broadcast_to(rows[0], (sum(map(len, albedos)), 3))


def _concatenate_corner_albedos(looks: list[MeshAppearance]) -> Floats | None:
    """(n, 3, 3) albedos at the corners; None where all triangles have one albedo each."""
    if all(look.corner_albedo is None for look in looks):
        return None
    return _concatenate([_albedos_at_corners(look) for look in looks])


def _albedos_at_corners(look: MeshAppearance) -> Floats:
    if look.corner_albedo is not None:
        return look.corner_albedo
    return np.broadcast_to(look.albedo[:, None], (len(look.albedo), 3, 3))


def _repeat_rows(rows: Sequence[tuple[float, ...]], counts: Sequence[int]) -> Floats | None:
    """(n, k) rows by the number of each; None where all are zero."""
    return np.repeat(np.array(rows), counts, axis=0) if any(map(any, rows)) else None


def _repeat_flags(flags: list[bool], counts: Sequence[int]) -> Bools | None:
    """(n,) flags by the number of each; None where none is set."""
    return np.repeat(np.array(flags), counts) if any(flags) else None


def _concatenate_coverage(looks: list[MeshAppearance], counts: Sequence[int]) -> Floats | None:
    """(n, 3) coverage at corners; None where no triangle has holes."""
    if all(look.coverage is None for look in looks):
        return None
    whole = (np.broadcast_to(np.inf, (count, 3)) for count in counts)
    parts = zip(looks, whole, strict=True)
    return np.concatenate(
        [full if look.coverage is None else look.coverage for look, full in parts]
    )


def _concatenate_corner_normals(parts: list[MeshPart]) -> Floats | None:
    """(n, 3, 3) normals at the corners; None where all triangles are flat."""
    normals = [(part.appearance.corner_normals, part.normals) for part in parts]
    if all(at_corners is None for at_corners, _ in normals):
        return None
    return _concatenate(
        [
            np.broadcast_to(flat[:, None], (len(flat), 3, 3)) if at_corners is None else at_corners
            for at_corners, flat in normals
        ]
    )


def _make_empty_part() -> MeshPart:
    """Part without a triangle."""
    no_vectors = np.zeros((0, 3))
    appearance = MeshAppearance(no_texture_coordinates(0), no_vectors, None, None, unlit=False)
    return MeshPart(np.zeros((0, 3, 3)), no_vectors, appearance)


class _ItemLoader:
    """Loader of the items of one scene."""

    def __init__(self, world_name: str, items: Sequence[Item], textures: TextureReader) -> None:
        """Load nothing yet.

        Args:
            world_name: named in errors.
            items: all items.
            textures: reader of all textures, with the budget of triangles, too.
        """
        self._where = SourceLocation(world_name)
        self._items = items
        self._textures = textures
        self._memory = textures.memory
        shapes = (item.shape for item in items)
        self._num_places = Counter(shape for shape in shapes if isinstance(shape, MeshFile))
        self._meshes: dict[MeshFile, list[MeshPart]] = {}

    def load_parts(self, index: int) -> Iterator[MeshPart]:
        """Yield the parts of an item.

        Raises:
            ConfigError: A mesh or texture file is missing or unusable, or the budget is exceeded.
        """
        with _locate_errors(item := self._items[index]):
            if isinstance(item.shape, MeshFile):
                yield from self._place_mesh_file(index, item, item.shape)
            else:
                yield self._build_shape(index, item, item.shape)

    def _build_shape(self, index: int, item: Item, shape: Primitive) -> MeshPart:
        assert item.material is not None, "only mesh files bring materials of their own"
        num_triangles = max_triangles(shape)
        self._memory.reserve(
            BYTES_PER_TRIANGLE * num_triangles,
            where=self._where,
            key=item.name,
            value=f"{num_triangles} triangles",
            remedy="fewer items, Sectors or Rings",
        )
        patch = build_shape(shape, item.material.tile_m)
        look = self._apply_material(patch.uv, item.material)
        corners, look = _stretch(patch.corners, look, item.scale)
        corners = item.world_from_item.transform_points(corners)
        # The winding alone gives the normal.
        normals, _ = facet_normals(corners)
        if isinstance(shape, Facets):
            turned = item.world_from_item.rotate_directions(shape.normals.reshape(-1, 3))
            look = replace(look, corner_normals=turned.reshape(-1, 3, 3))
        return MeshPart(corners, normals, look, item=index)

    @cached_property
    def _mesh_files(self) -> MeshFileLoader:
        from catoptra_server.world.mesh_files import MeshFileLoader

        return MeshFileLoader(self._num_places, self._textures)

    def _load_mesh_file(self, shape: MeshFile) -> list[MeshPart]:
        """Meshes of a file; those of all its places but the last are the same objects."""
        # Imported on demand: many worlds have no mesh file.
        from catoptra_server.world.mesh_files import reserve_triangles

        self._num_places[shape] -= 1
        if shape not in self._meshes:
            meshes = self._mesh_files.load(shape)
        else:
            meshes = self._meshes.pop(shape)
            for mesh in meshes:
                is_smooth = mesh.appearance.corner_normals is not None
                count, memory = len(mesh.corners), self._memory
                reserve_triangles(count, memory, shape.path, mesh.node, is_smooth=is_smooth)
        if self._num_places[shape]:
            self._meshes[shape] = meshes
        return meshes

    def _place_mesh_file(self, index: int, item: Item, shape: MeshFile) -> Iterator[MeshPart]:
        for mesh in self._load_mesh_file(shape):
            appearance = mesh.appearance
            if item.material is not None:
                tile_m = item.material.tile_m
                uv = project_tiles(mesh.corners, tile_m) if tile_m else appearance.uv
                appearance = self._apply_material(uv, item.material)
            if item.unlit is not None:
                appearance = replace(appearance, unlit=item.unlit)
            corners, normals = mesh.corners, mesh.normals
            if item.scale != (1.0, 1.0, 1.0):
                corners, appearance = _stretch(corners, appearance, item.scale)
                normals, _ = facet_normals(corners)
            elif shape in self._meshes:
                corners, normals = corners.copy(), normals.copy()
            _transform_to_world(corners, normals, item.world_from_item)
            if appearance.corner_normals is not None:
                turned = item.world_from_item.rotate_directions(
                    appearance.corner_normals.reshape(-1, 3)
                )
                appearance = replace(appearance, corner_normals=turned.reshape(-1, 3, 3))
            yield replace(mesh, corners=corners, normals=normals, appearance=appearance, item=index)

    def _apply_material(self, uv: Floats, material: Material) -> MeshAppearance:
        """Appearance of n triangles of a material, with (n, 3, 2) texture coordinates."""
        albedo = np.broadcast_to(np.array(material.albedo), (len(uv), 3))
        texture = None
        if isinstance(material.texture, Path):
            texture = self._textures.load(material.texture)
        elif material.texture is not None:
            texture = self._textures.load_by_name(material.texture)
        gloss = material.gloss
        return MeshAppearance(
            uv,
            albedo,
            None,
            texture,
            unlit=material.unlit,
            emission=material.emission,
            gloss=(0.0, 0.0) if gloss is None else (gloss.reflectance, gloss.roughness),
        )


def _stretch(
    corners: Floats, look: MeshAppearance, scale: Vector3
) -> tuple[Floats, MeshAppearance]:
    """(n, 3, 3) corners scaled along their axes, with their appearance."""
    normals = look.corner_normals
    if normals is not None:
        normals = normals / scale
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        look = replace(look, corner_normals=normals / np.where(length == 0.0, 1.0, length))
    corners = corners * scale
    if math.prod(scale) > 0.0:
        return corners, look
    # A mirrored triangle is wound the other way round: its front would be the back.
    names = ("uv", "corner_albedo", "corner_normals", "coverage")
    arrays = {name: getattr(look, name) for name in names}
    backwards = {name: array[:, ::-1] for name, array in arrays.items() if array is not None}
    return np.ascontiguousarray(corners[:, ::-1]), replace(look, **backwards)


def _transform_to_world(corners: Floats, normals: Floats, world_from_item: Pose) -> None:
    """Move (n, 3, 3) corners and (n, 3) normals into the world.

    In place: new arrays of a million triangles are 96 MB, which a process gets page by page in up
    to 0.2 s.
    """
    rotation, translation = world_from_item.rotation, world_from_item.translation
    if np.array_equal(rotation, np.eye(3)):
        if translation.any():
            offset = tile_over_block(translation)
            for block in row_blocks(len(corners)):
                points = corners[block].reshape(-1)
                points += offset[: len(points)]
        return
    for block in row_blocks(len(corners)):
        # Rows of points: a product of n small matrices takes five times as long.
        moved = world_from_item.transform_points(corners[block].reshape(-1, 3))
        corners[block] = moved.reshape(-1, 3, 3)
        normals[block] = world_from_item.rotate_directions(normals[block])


_WHITE: Rgb = (0.80, 0.80, 0.80)
_GOAL_WALL_THICKNESS_M = 0.02


def _items_from_landmark(landmark: Landmark, albedos: dict[str, Rgb]) -> tuple[Item, ...]:
    """Items of a landmark, with a linear albedo for each colour name."""
    return {"beacon": _beacon_items, "goal": _goal_items}[landmark.kind](landmark, albedos)


def _beacon_items(landmark: Landmark, albedos: dict[str, Rgb]) -> tuple[Item, ...]:
    """Beacon: a white post below the band, then the band's lower and upper colour."""
    centre = landmark.band_centre_m
    parts = [
        ("post", 0.0, landmark.band_bottom_m, _WHITE),
        ("lower", landmark.band_bottom_m, centre, albedos[landmark.lower_colour]),
        ("upper", centre, landmark.band_top_m, albedos[landmark.upper_colour]),
    ]
    return tuple(
        Item(
            name=f"{landmark.name}.{part}",
            shape=Cylinder(radius_m=0.5 * landmark.width_m, height_m=top - bottom),
            world_from_item=Pose.from_rpy((landmark.x_m, landmark.y_m, -0.5 * (bottom + top))),
            material=Material(albedo),
            object_name=landmark.name,
            class_name=landmark.kind,
        )
        for part, bottom, top, albedo in parts
        # A band that begins at the floor has no post.
        if top > bottom
    )


def _goal_items(landmark: Landmark, albedos: dict[str, Rgb]) -> tuple[Item, ...]:
    """Goal: a back and two sides, open towards the world's origin, without floor and top."""
    # The mouth faces the origin along x: +1 for a goal at positive x, whose back is at larger x.
    outward = math.copysign(1.0, landmark.x_m)
    width, depth, height = landmark.width_m, landmark.depth_m, landmark.band_top_m
    thick = _GOAL_WALL_THICKNESS_M
    back_x = landmark.x_m + outward * (depth + 0.5 * thick)
    side_x, side_y = landmark.x_m + outward * 0.5 * depth, 0.5 * width + 0.5 * thick
    boards = [
        ("back", back_x, 0.0, (thick, width + 2 * thick, height)),
        ("left", side_x, -side_y, (depth, thick, height)),
        ("right", side_x, side_y, (depth, thick, height)),
    ]
    material = Material(albedos[landmark.upper_colour])
    return tuple(
        Item(
            name=f"{landmark.name}.{board}",
            shape=Box(size),
            world_from_item=Pose.from_rpy((x, landmark.y_m + y, -0.5 * height)),
            material=material,
            object_name=landmark.name,
            class_name=landmark.kind,
        )
        for board, x, y, size in boards
    )
