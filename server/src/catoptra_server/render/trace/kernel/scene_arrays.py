"""Scenes and objects as the kernel's structures, with the arrays that these point into.

Levels of textures, 6 bytes a texel of the image and 2 of the coarser ones, are 16-bit linear light;
images of large scenes are sRGB bytes, 3 a texel. Each has a border, the level repeated by one texel
on every side, so that a bilinear look-up never leaves the array. Twin:
`world/textures.py:sample_levels`.

The kernel proves for parts of an image that one flat surface fills all (`src/coverage.h`); it finds
the surfaces by sorting edges, a million triangles in the time of their hierarchy.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.image_changer import encode_srgb
from catoptra_server.render.trace.kernel.kernel_structs import (
    FACET_CORNER_COLOURS,
    FACET_EMISSIVE,
    FACET_FILTERED,
    FACET_GLOSSY,
    FACET_SMOOTH,
    FACET_TEXTURED,
    FACET_TWO_SIDED,
    FACET_UNLIT,
    LIGHT_DIRECTIONAL,
    LIGHT_POINT,
    SAMPLE_CLAMP_U,
    SAMPLE_CLAMP_V,
    SAMPLE_NEAREST,
    FacetSource,
    HemisphereStruct,
    LightStruct,
    MeshArrays,
    OcclusionPatchStruct,
    OcclusionStruct,
    SurfacesStruct,
    TextureLevelStruct,
    TextureStruct,
)
from catoptra_server.render.trace.kernel.library import KernelDevice
from catoptra_server.runtime.memory import MAX_LIGHT_TEXELS, count_processors
from catoptra_server.world.objects import ObjectMesh
from catoptra_server.world.scene_mesh import MAX_FLOAT_REACH_M, SceneMesh
from catoptra_server.world.shading import (
    OcclusionMap,
    facet_radiance,
    hemisphere_lights,
    light_of_bytes,
    shadow_casting_lights,
    write_facet_radiance,
)
from catoptra_server.world.textures import (
    Levels,
    Texture,
    TextureSampling,
    build_levels,
    find_border,
    make_texels,
    repeat_border,
)
from catoptra_server.world.triangles import row_blocks, tile_over_block
from catoptra_server.world.world_description import DirectionalLight, Light, PointLight

_MAX_TEXEL = 65535
"""Texel of white."""
_Indices = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class OwningStruct:
    """A structure of addresses, and the objects that must outlive the structure."""

    struct: Any
    """A ctypes structure, or an array of structures."""
    owners: tuple[object, ...]
    """Arrays that the structure points into."""


def scene_arrays(
    scene: SceneMesh, centre: Floats, textures: TextureArray | None = None
) -> OwningStruct:
    """Triangles of a static scene, relative to its centre.

    Args:
        scene: The scene.
        centre: (3,) origin of the kernel's coordinates.
        textures: Textures of the scene, which outlive the structure; None for one without holes.
    """
    flags = (
        scene.unlit * np.uint8(FACET_UNLIT)
        + (scene.texture_index >= 0) * np.uint8(FACET_TEXTURED)
        + _has_corner_colours(scene) * np.uint8(FACET_CORNER_COLOURS)
    )
    if scene.emission is not None:
        flags += scene.emission.any(axis=-1) * np.uint8(FACET_EMISSIVE)
    if scene.corner_normals is not None:
        flags += scene.is_smooth * np.uint8(FACET_SMOOTH)
    if scene.gloss is not None:
        flags += (scene.gloss[:, 0] > 0.0) * np.uint8(FACET_GLOSSY)
    if scene.two_sided is not None:
        flags += scene.two_sided * np.uint8(FACET_TWO_SIDED)
    filtered = _filter_members(scene, textures)
    flags += filtered.pop("flags", np.uint8(0))
    return _mesh_arrays(
        scene.corners,
        centre,
        scene.normals,
        scene.albedo,
        flags,
        corner_albedo=_float32(scene.corner_albedo),
        emission=_float32(scene.emission),
        gloss=_float32(scene.gloss),
        corner_normals=_float32(scene.corner_normals),
        **filtered,
        blended=None if scene.blended is None else scene.blended.astype(np.uint8),
        uv=np.ascontiguousarray(scene.uv) if scene.textures else None,
        uv_rows=scene.uv_rows,
        texture=scene.texture_index if scene.textures else None,
    )


def object_arrays(mesh: ObjectMesh) -> OwningStruct:
    """Triangles of a dynamic object, in its own frame."""
    flags = mesh.unlit * np.uint8(FACET_UNLIT)
    if mesh.bent is not None:
        flags |= mesh.bent * np.uint8(FACET_SMOOTH)
    members: dict[str, npt.NDArray[Any] | None] = {"corner_normals": _float32(mesh.corner_normals)}
    owners: tuple[object, ...] = ()
    if mesh.textures:
        textures = texture_array(mesh)
        owners = (textures.struct, *textures.owners)
        flags |= (mesh.texture_index >= 0) * np.uint8(FACET_TEXTURED)
        structs = np.frombuffer(memoryview(textures.struct), dtype=np.uint8)
        members |= {"uv": mesh.uv, "texture": mesh.texture_index, "textures": structs}
    owned = _mesh_arrays(mesh.corners, np.zeros(3), mesh.normals, mesh.albedo, flags, **members)
    return OwningStruct(owned.struct, (*owned.owners, *owners))


def caster_arrays(
    scene: SceneMesh, centre: Floats, textures: TextureArray | None = None
) -> OwningStruct:
    """Triangles that occlude lights, without materials: no ray shows a caster."""
    rows = scene.casts_shadows
    return hole_arrays(scene, centre, textures, rows)


def hole_arrays(
    scene: SceneMesh,
    centre: Floats,
    textures: TextureArray | None = None,
    rows: slice | Bools = slice(None),
) -> OwningStruct:
    """Some triangles of a scene that are met from both sides, except in holes, and never shown."""
    filtered = _filter_members(scene, textures)
    shared = {name: filtered.pop(name) for name in ("textures",) if name in filtered}
    flags = filtered.pop("flags", np.zeros(len(scene), dtype=np.uint8)) | np.uint8(FACET_TWO_SIDED)
    if filtered and scene.textures:
        flags |= (scene.texture_index >= 0) * np.uint8(FACET_TEXTURED)
        filtered |= {"uv": scene.corner_uv, "texture": scene.texture_index}
    chosen = {name: np.ascontiguousarray(array[rows]) for name, array in filtered.items()}
    normals = scene.normals[rows]
    return _mesh_arrays(
        scene.corners[rows],
        centre,
        normals,
        np.zeros_like(normals),
        np.ascontiguousarray(flags[rows]),
        **chosen,
        **shared,
    )


TextureArray = ctypes.Array[TextureStruct]


def _filter_members(scene: SceneMesh, textures: TextureArray | None) -> dict[str, npt.NDArray[Any]]:
    """Flags and arrays of triangles that have holes, or are none from behind."""
    if scene.coverage is None and scene.single_sided is None:
        return {}
    coverage = np.full((len(scene), 3), np.inf) if scene.coverage is None else scene.coverage
    is_filtered = np.isfinite(coverage).all(axis=-1)
    flags = np.where(is_filtered, np.uint8(FACET_FILTERED), np.uint8(0))
    if scene.single_sided is not None:
        flags = np.where(scene.single_sided, np.uint8(FACET_FILTERED), flags)
    members = {"flags": flags, "coverage": np.ascontiguousarray(coverage, dtype=np.float32)}
    if textures is not None:
        # One element, whose address is that of the first structure.
        members["textures"] = np.frombuffer(memoryview(textures), dtype=np.uint8)
    return members


def corner_arrays(corners: Floats, centre: Floats) -> OwningStruct:
    """(n, 3, 3) corners relative to a centre, of triangles that are only met and never shown.

    A mesh of these reads them while it is committed, never later.
    """
    arrays = _corner_members(corners, centre)
    addresses = {name: _address(array) for name, array in arrays.items()}
    return OwningStruct(MeshArrays(len(corners), **addresses), tuple(arrays.values()))


def _mesh_arrays(
    corners: Floats,
    centre: Floats,
    normals: Floats,
    albedo: Floats,
    flags: npt.NDArray[np.uint8],
    **optional: npt.NDArray[Any] | None,
) -> OwningStruct:
    """Triangles with their materials; optional: members of `MeshArrays` that some meshes have."""
    arrays = {
        **_corner_members(corners, centre),
        "normals": _float32(normals),
        "albedo": _float32(albedo),
        "flags": flags,
        **optional,
    }
    addresses = {name: _address(array) for name, array in arrays.items()}
    return OwningStruct(MeshArrays(len(corners), **addresses), tuple(arrays.values()))


def _corner_members(corners: Floats, centre: Floats) -> dict[str, npt.NDArray[Any] | None]:
    """(n, 3, 3) corners relative to a centre, in double precision besides where they are far."""
    relative = np.zeros(corners.shape, dtype=np.float32)
    offset = tile_over_block(centre)
    for block in row_blocks(len(corners)):
        points = np.ascontiguousarray(corners[block]).reshape(-1)
        out = relative[block].reshape(-1)
        np.subtract(points, offset[: len(points)], out=out, casting="same_kind")
    # Not of absolute values, which take new memory.
    reach_m = max(relative.max(initial=0.0), -relative.min(initial=0.0))
    is_large = reach_m > MAX_FLOAT_REACH_M
    return {"corners": relative, "fine_corners": corners - centre if is_large else None}


def _float32(array: npt.NDArray[Any] | None) -> npt.NDArray[np.float32] | None:
    return None if array is None else np.ascontiguousarray(array, dtype=np.float32)


def _address(array: npt.NDArray[Any] | None) -> int | None:
    assert array is None or array.flags.c_contiguous, "the kernel reads arrays without strides"
    return None if array is None else array.ctypes.data


def _has_corner_colours(scene: SceneMesh) -> Bools:
    """(n,) whether the colour varies over each triangle from corner to corner."""
    if scene.corner_albedo is None:
        return np.zeros(len(scene), dtype=bool)
    varies: Bools = (np.ptp(scene.corner_albedo, axis=1) > 0.0).any(axis=-1)
    return varies


def _has_own_shading(scene: SceneMesh) -> Bools:
    """(n,) triangles whose radiance is computed at each point, or depends on the side."""
    computed = _has_corner_colours(scene)
    if scene.emission is not None:
        computed = computed | scene.emission.any(axis=-1)
    if scene.coverage is not None:
        computed = computed | np.isfinite(scene.coverage).all(axis=-1)
    return computed if scene.bent is None else computed | scene.bent


def radiance_table(
    scene: SceneMesh, lights: Sequence[Light], background: Sequence[float]
) -> npt.NDArray[np.float32]:
    """(n + 1, 3) radiance of the facets without point lights and textures; background last."""
    table = np.zeros((len(scene) + 1, 3), dtype=np.float32)
    write_facet_radiance(scene, lights, table[:-1])
    if scene.occlusion is not None and scene.occlusion.is_constant.any():
        is_constant, factors = scene.occlusion.find_constants()
        rows = np.flatnonzero(is_constant)
        of_sky = facet_radiance(scene, hemisphere_lights(lights))[rows]
        table[rows] -= ((1.0 - factors[rows]) * of_sky).astype(np.float32)
    table[-1] = background
    return table


def encoded_table(radiance: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """(n + 1,) sRGB of a radiance table, R in the lowest byte."""
    packed = np.zeros((len(radiance), 4), dtype=np.uint8)
    for block in row_blocks(len(radiance)):
        packed[block, :3] = encode_srgb(radiance[block])
    return packed.view("<u4").reshape(-1)


def texture_array(
    scene: SceneMesh | ObjectMesh, find_levels: Callable[[Texture], Levels] = build_levels
) -> OwningStruct:
    """Textures at their levels; an image that is sampled in two ways is there once."""
    images = {id(image): image for image in scene.textures}
    light = np.rint(_MAX_TEXEL * light_of_bytes())
    num_texels = sum(image.shape[0] * image.shape[1] for image in images.values())
    table = light if num_texels > MAX_LIGHT_TEXELS else None
    with ThreadPoolExecutor(count_processors()) as pool:
        levels = pool.map(lambda image: _texture_levels(find_levels(image), table), images.values())
        owned = dict(zip(images, levels, strict=True))
    structs = [
        TextureStruct(
            len(owned[id(image)].struct),
            _sampling_bits(sampling),
            image.shape[-1],
            ctypes.addressof(owned[id(image)].struct),
        )
        for image, sampling in zip(scene.textures, scene.samplings, strict=True)
    ]
    owners = (*owned.values(), light)
    return OwningStruct((TextureStruct * max(1, len(structs)))(*structs), owners)


def hole_textures(scene: SceneMesh) -> OwningStruct:
    """Textures of a scene for its holes: only images that have an opacity."""
    return texture_array(scene, lambda image: (image if image.shape[-1] == 4 else image[:1, :1],))


def _sampling_bits(sampling: TextureSampling) -> int:
    nearest = 0 if sampling.has_filter else SAMPLE_NEAREST
    return SAMPLE_CLAMP_U * sampling.clamps_u + SAMPLE_CLAMP_V * sampling.clamps_v + nearest


def _texture_levels(levels: Levels, table: npt.NDArray[np.float32] | None) -> OwningStruct:
    """The levels of one texture; with a table the image's bytes are kept."""
    image = levels[0] if table is not None else _decode_image(levels[0])
    texels = (_pad_texels(image), *map(_pad_texels, levels[1:]))
    structs = [
        TextureLevelStruct(level.shape[1], level.shape[0], owned.ctypes.data)
        for level, owned in zip(levels, texels, strict=True)
    ]
    structs[0].light = _address(table)
    return OwningStruct((TextureLevelStruct * len(structs))(*structs), texels)


def _decode_image(image: Texture) -> npt.NDArray[np.uint16]:
    """(h, w, c) linear light and opacity, by a table: no float of each texel of a large image."""
    light = np.rint(_MAX_TEXEL * light_of_bytes()).astype(np.uint16).take(image)
    light[..., 3:] = image[..., 3:].astype(np.uint16) * np.uint16(257)
    return light


def _pad_texels(level: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(h + 2, w + 2, c) texels of a (h, w, c) level: uint16 of float32, else as they are."""
    if (bordered := find_border(level)) is not None:
        return bordered
    is_float = level.dtype == np.float32
    height, width, channels = level.shape
    bordered = make_texels(height, width, channels, np.uint16 if is_float else level.dtype)
    inside = bordered[1:-1, 1:-1]
    if is_float:
        np.rint(_MAX_TEXEL * level, out=inside, casting="unsafe")
    else:
        inside[...] = level
    repeat_border(bordered)
    return bordered


def light_array(
    lights: Sequence[Light], scene_lights: Sequence[Light], centre: Floats
) -> tuple[ctypes.Array[LightStruct], int]:
    """Lights that surfaces can occlude, and their number; some do not light the static scene."""
    structs = [
        _light_struct(light, centre, lights_scene=light in scene_lights)
        for light in shadow_casting_lights(lights)
    ]
    return (LightStruct * max(1, len(structs)))(*structs), len(structs)


def _light_struct(
    light: DirectionalLight | PointLight, centre: Floats, *, lights_scene: bool
) -> LightStruct:
    if isinstance(light, DirectionalLight):
        towards = -np.asarray(light.direction)
        nowhere = (0.0, 0.0, 0.0)
        vectors = (nowhere, tuple(towards), tuple(light.irradiance))
        return LightStruct(LIGHT_DIRECTIONAL, lights_scene, *vectors)
    position = tuple(np.asarray(light.position_m) - centre)
    return LightStruct(LIGHT_POINT, lights_scene, position, position, tuple(light.intensity))


def hemisphere_struct(lights: Sequence[Light]) -> HemisphereStruct:
    """Sum of all hemisphere lights."""
    hemispheres = hemisphere_lights(lights)
    up = sum((np.asarray(light.up_irradiance) for light in hemispheres), np.zeros(3))
    down = sum((np.asarray(light.down_irradiance) for light in hemispheres), np.zeros(3))
    return HemisphereStruct(tuple(up), tuple(down))


def occlusion_struct(occlusion: OcclusionMap | None, centre: Floats) -> OwningStruct:
    """Ambient occlusion of a scene."""
    if occlusion is None:
        return OwningStruct(OcclusionStruct(), ())
    structs = patch_structs(occlusion, centre)
    height, width = occlusion.texels.shape[-2:]
    sums = _sum_dark_nodes(occlusion)
    # A grid with one factor is in the tables of facets: no ray looks it up.
    is_constant, factors = occlusion.find_constants()
    patch_of = np.where(is_constant, np.int32(-1), occlusion.patch_of)
    constants = _float32(factors) if is_constant.any() else None
    # Colours side by side, like a texture's: two lines of memory a ray, where planes are six.
    nodes = np.moveaxis(occlusion.texels, 0, -1)
    light = np.append(nodes, np.uint16(0)) if nodes.ndim == 3 else None
    struct = OcclusionStruct(
        width=width,
        height=height,
        texels=occlusion.texels.ctypes.data,
        light=_address(light),
        patch_of=patch_of.ctypes.data,
        patches=ctypes.addressof(structs),
        num_patches=len(structs),
        dark_sums=sums.ctypes.data,
        flat_factors=None if constants is None else constants.ctypes.data,
    )
    return OwningStruct(struct, (occlusion, structs, sums, patch_of, constants, light))


def patch_structs(occlusion: OcclusionMap, centre: Floats) -> ctypes.Array[OcclusionPatchStruct]:
    """The grids of a map, relative to a centre."""
    structs = (OcclusionPatchStruct * len(occlusion.bounds))()
    rows = zip(
        _relative_rows(occlusion.columns_from_world, centre),
        _relative_rows(occlusion.rows_from_world, centre),
        occlusion.bounds.tolist(),
        strict=True,
    )
    for struct, (column, row, bounds) in zip(structs, rows, strict=True):
        struct.column[:], struct.row[:] = column, row
        struct.left, struct.top, struct.right, struct.bottom = bounds
        struct.offset[:] = column[3], row[3]
    return structs


def _relative_rows(rows: Floats, centre: Floats) -> list[list[float]]:
    """(m, 4) rows for points relative to a centre."""
    offset = rows[:, 3:] + matmul(rows[:, :3], centre[:, None])
    relative: list[list[float]] = np.concatenate((rows[:, :3], offset), axis=1).tolist()
    return relative


def _sum_dark_nodes(occlusion: OcclusionMap) -> npt.NDArray[np.int32]:
    """(h + 1, w + 1) numbers of texels above and left that are not open."""
    is_dark = (occlusion.planes < occlusion.open).any(axis=0)
    sums = np.zeros((is_dark.shape[0] + 1, is_dark.shape[1] + 1), dtype=np.int32)
    np.cumsum(is_dark, axis=0, out=sums[1:, 1:])
    np.cumsum(sums, axis=1, out=sums)
    return sums


@dataclass(frozen=True, slots=True, eq=False)
class FlatSurfaces:
    """Surfaces of a scene: connected coplanar triangles of one material."""

    surface: _Indices
    """(n,) surface of each triangle."""
    outer_edges: npt.NDArray[np.uint8]
    """(n,) bit masks of the edges that bound a surface; bit k is the edge from corner k on."""
    representative: _Indices
    """(s,) largest triangle of each surface."""


def find_flat_surfaces(scene: SceneMesh, device: KernelDevice) -> FlatSurfaces:
    """Surfaces of a scene, by all threads of a device.

    Raises:
        KernelError: Memory is short.
    """
    arrays: dict[str, npt.NDArray[Any] | None] = {
        "corners": scene.corners,
        "normals": scene.normals,
        "albedo": scene.albedo,
        "uv": scene.corner_uv if scene.textures else None,
        "texture": scene.texture_index,
        "object": scene.object_index + _number_looks(scene) * np.int32(len(scene.objects)),
        "unlit": scene.unlit,
        "has_colours": _has_own_shading(scene),
    }
    arrays = {n: None if a is None else np.ascontiguousarray(a) for n, a in arrays.items()}
    addresses = {name: _address(array) for name, array in arrays.items()}
    surface = np.zeros(len(scene), dtype=np.int32)
    outer_edges = np.zeros(len(scene), dtype=np.uint8)
    largest = np.zeros(len(scene), dtype=np.int32)
    facets = FacetSource(len(scene), tuple(scene.centre), **addresses)
    count = device.find_surfaces(facets, surface, outer_edges, largest)
    return FlatSurfaces(surface, outer_edges, largest[:count].copy())


def _number_looks(scene: SceneMesh) -> _Indices:
    """(n,) numbers of gloss and grid of baked light, of which a surface has one each."""
    looks = [] if scene.gloss is None else [*scene.gloss.T]
    if scene.baked_light is not None:
        looks.append(scene.baked_light.patch_of)
    if not looks:
        return np.zeros(len(scene), dtype=np.int32)
    numbers = np.unique(np.stack(looks, axis=-1), axis=0, return_inverse=True)[1]
    return numbers.astype(np.int32).reshape(-1)


def surfaces_struct(surfaces: FlatSurfaces) -> OwningStruct:
    """Flat surfaces of a scene."""
    struct = SurfacesStruct(
        num_surfaces=len(surfaces.representative),
        surface=_address(surfaces.surface),
        outer_edges=_address(surfaces.outer_edges),
        representative=_address(surfaces.representative),
    )
    return OwningStruct(struct, (surfaces,))
