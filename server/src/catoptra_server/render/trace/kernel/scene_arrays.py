"""Scenes and objects as the kernel's structures, with the arrays that these point into."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.srgb_encoding import encode_srgb
from catoptra_server.render.trace.kernel.flat_surfaces import find_flat_surfaces, has_corner_colours
from catoptra_server.render.trace.kernel.kernel_structs import (
    FACET_CORNER_COLOURS,
    FACET_OCCLUDED,
    FACET_TEXTURED,
    FACET_UNLIT,
    LIGHT_DIRECTIONAL,
    LIGHT_POINT,
    HemisphereStruct,
    LightStruct,
    MeshArrays,
    OcclusionPatchStruct,
    OcclusionStruct,
    SurfacesStruct,
    TextureLevelStruct,
    TextureStruct,
)
from catoptra_server.render.trace.kernel.padded_texels import pad_texels
from catoptra_server.world import shading
from catoptra_server.world.objects import ObjectMesh
from catoptra_server.world.occlusion_map import OPEN, OcclusionMap
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.textures import Levels, build_levels
from catoptra_server.world.triangles import row_blocks
from catoptra_server.world.world_description import DirectionalLight, Light, PointLight

# Embree loads corners by vectors of four floats: the last ones reach beyond the array.
_CORNER_PADDING = 4


@dataclass(frozen=True, slots=True, eq=False)
class Owned:
    """A structure of addresses, and the objects that must outlive it."""

    struct: Any
    """A ctypes structure, or an array of them."""
    owners: tuple[object, ...]
    """Arrays that the structure points into."""


@dataclass(frozen=True, slots=True, eq=False)
class _Optional:
    """Arrays that only some meshes have."""

    corner_albedo: npt.NDArray[np.float32] | None = None
    """(n, 3, 3) linear."""
    uv: npt.NDArray[np.float32] | None = None
    """(n, 6) texture coordinates."""
    texture: npt.NDArray[np.int32] | None = None
    """(n,) indices of textures."""


_NOTHING = _Optional()


def scene_arrays(scene: SceneMesh, centre: Floats) -> Owned:
    """Triangles of a static scene, relative to its centre."""
    flags = (
        scene.unlit * np.uint8(FACET_UNLIT)
        + (scene.texture_index >= 0) * np.uint8(FACET_TEXTURED)
        + has_corner_colours(scene) * np.uint8(FACET_CORNER_COLOURS)
    )
    if scene.occlusion is not None:
        flags += (scene.occlusion.patch_of >= 0) * np.uint8(FACET_OCCLUDED)
    optional = _Optional(
        corner_albedo=_float32(scene.corner_albedo),
        uv=_uv_frames(scene.uv) if scene.textures else None,
        texture=scene.texture_index.astype(np.int32) if scene.textures else None,
    )
    return _mesh_arrays(scene.corners, centre, scene.normals, scene.albedo, flags, optional)


def object_arrays(mesh: ObjectMesh) -> Owned:
    """Triangles of a dynamic object, in its own frame."""
    flags = mesh.unlit * np.uint8(FACET_UNLIT)
    return _mesh_arrays(mesh.corners, np.zeros(3), mesh.normals, mesh.albedo, flags)


def caster_arrays(scene: SceneMesh, centre: Floats) -> Owned:
    """Triangles that occlude lights; nothing of them is ever seen."""
    casters = scene.casts_shadows
    normals = scene.normals[casters]
    flags = np.zeros(len(normals), dtype=np.uint8)
    return _mesh_arrays(scene.corners[casters], centre, normals, np.zeros_like(normals), flags)


def corner_arrays(corners: Floats, centre: Floats) -> Owned:
    """(n, 3, 3) corners relative to a centre, of triangles that are only met and never shown."""
    padded = _pad_corners(corners, centre)
    return Owned(MeshArrays(len(corners), corners=_address(padded)), (padded,))


def _mesh_arrays(
    corners: Floats,
    centre: Floats,
    normals: Floats,
    albedo: Floats,
    flags: npt.NDArray[np.uint8],
    optional: _Optional = _NOTHING,
) -> Owned:
    arrays = {
        "corners": _pad_corners(corners, centre),
        "normals": _float32(normals),
        "albedo": _float32(albedo),
        "flags": flags,
        "corner_albedo": optional.corner_albedo,
        "uv": optional.uv,
        "texture": optional.texture,
    }
    addresses = {name: _address(array) for name, array in arrays.items()}
    return Owned(MeshArrays(len(corners), **addresses), tuple(arrays.values()))


def _pad_corners(corners: Floats, centre: Floats) -> npt.NDArray[np.float32]:
    """(9 n + _CORNER_PADDING,) coordinates of (n, 3, 3) corners relative to a centre."""
    padded = np.zeros(corners.size + _CORNER_PADDING, dtype=np.float32)
    # Subtracted in float64, stored in float32, without an array of the one in between.
    relative = padded[: corners.size].reshape(corners.shape)
    np.subtract(corners, centre, out=relative, casting="same_kind")
    return padded


def _float32(array: npt.NDArray[Any] | None) -> npt.NDArray[np.float32] | None:
    return None if array is None else np.ascontiguousarray(array, dtype=np.float32)


def _address(array: npt.NDArray[Any] | None) -> int | None:
    assert array is None or array.flags.c_contiguous, "the kernel reads arrays without strides"
    return None if array is None else array.ctypes.data


def _uv_frames(uv: Floats) -> npt.NDArray[np.float32]:
    """(n, 6) texture coordinates of each triangle's first corner and of its two edges."""
    first, second, third = np.moveaxis(uv, 1, 0)
    # Edges instead of corners: coordinates at a point are then two products and two sums.
    frames = np.concatenate((first, second - first, third - first), axis=-1)
    return np.ascontiguousarray(frames, dtype=np.float32)


def texture_array(scene: SceneMesh) -> Owned:
    """Textures of a scene, each at all its levels."""
    textures = [_texture_levels(build_levels(image)) for image in scene.textures]
    structs = [TextureStruct(len(one.struct), ctypes.addressof(one.struct)) for one in textures]
    return Owned((TextureStruct * max(1, len(structs)))(*structs), tuple(textures))


def _texture_levels(levels: Levels) -> Owned:
    """The levels of one texture."""
    texels = tuple(pad_texels(level) for level in levels)
    structs = [
        TextureLevelStruct(level.shape[1], level.shape[0], padded.ctypes.data)
        for level, padded in zip(levels, texels, strict=True)
    ]
    return Owned((TextureLevelStruct * len(structs))(*structs), texels)


def light_array(
    lights: Sequence[Light], scene_lights: Sequence[Light], centre: Floats
) -> tuple[ctypes.Array[LightStruct], int]:
    """Lights that surfaces can occlude, and their number; some do not light the static scene."""
    structs = [
        _light_struct(light, centre, lights_scene=light in scene_lights)
        for light in shading.shadow_casting_lights(lights)
    ]
    return (LightStruct * max(1, len(structs)))(*structs), len(structs)


def _light_struct(
    light: DirectionalLight | PointLight, centre: Floats, *, lights_scene: bool
) -> LightStruct:
    if isinstance(light, DirectionalLight):
        towards = -np.asarray(light.direction)
        return LightStruct(LIGHT_DIRECTIONAL, lights_scene, tuple(towards), tuple(light.irradiance))
    position = np.asarray(light.position_m) - centre
    return LightStruct(LIGHT_POINT, lights_scene, tuple(position), tuple(light.intensity))


def hemisphere_struct(lights: Sequence[Light]) -> HemisphereStruct:
    """Sum of all hemisphere lights."""
    hemispheres = shading.hemisphere_lights(lights)
    up = sum((np.asarray(light.up_irradiance) for light in hemispheres), np.zeros(3))
    down = sum((np.asarray(light.down_irradiance) for light in hemispheres), np.zeros(3))
    return HemisphereStruct(tuple(up), tuple(down))


def surfaces_struct(scene: SceneMesh, centre: Floats) -> Owned:
    """Flat surfaces of a scene."""
    found = find_flat_surfaces(scene)
    clusters = found.clusters - np.append(centre, 0.0)
    # Float32 rounds centres: spheres grow by as much.
    clusters[:, 3] += 1e-6 * np.abs(clusters).max(axis=1, initial=0.0)
    spheres = clusters.astype(np.float32)
    struct = SurfacesStruct(
        num_triangles=len(found.triangles),
        triangles=found.triangles.ctypes.data,
        surface=found.surface.ctypes.data,
        outer_edges=found.outer_edges.ctypes.data,
        num_surfaces=len(found.representative),
        representative=found.representative.ctypes.data,
        num_clusters=len(spheres),
        clusters=spheres.ctypes.data,
    )
    return Owned(struct, (found, spheres))


def occlusion_struct(occlusion: OcclusionMap | None, centre: Floats) -> Owned:
    """Ambient occlusion of a scene."""
    if occlusion is None:
        return Owned(OcclusionStruct(), ())
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
    height, width = occlusion.texels.shape
    sums = _sum_dark_nodes(occlusion.texels)
    struct = OcclusionStruct(
        width=width,
        height=height,
        texels=occlusion.texels.ctypes.data,
        patch_of=occlusion.patch_of.ctypes.data,
        patches=ctypes.addressof(structs),
        dark_sums=sums.ctypes.data,
    )
    return Owned(struct, (occlusion, structs, sums))


def _relative_rows(rows: Floats, centre: Floats) -> list[list[float]]:
    """(m, 4) rows for points relative to a centre."""
    offset = rows[:, 3:] + rows[:, :3] @ centre[:, None]
    relative: list[list[float]] = np.concatenate((rows[:, :3], offset), axis=1).tolist()
    return relative


def _sum_dark_nodes(texels: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
    """(h + 1, w + 1) numbers of texels above and left that are not open."""
    sums = np.zeros((texels.shape[0] + 1, texels.shape[1] + 1), dtype=np.int32)
    np.cumsum(texels < OPEN, axis=0, out=sums[1:, 1:])
    np.cumsum(sums, axis=1, out=sums)
    return sums


def radiance_table(
    scene: SceneMesh, lights: Sequence[Light], background: Sequence[float]
) -> npt.NDArray[np.float32]:
    """(n + 1, 3) radiance of the facets without point lights and textures; background last."""
    table = np.zeros((len(scene) + 1, 3), dtype=np.float32)
    shading.write_facet_radiance(scene, lights, table[:-1])
    table[-1] = background
    return table


def encoded_table(radiance: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """(n + 1,) sRGB of a radiance table, R in the lowest byte."""
    packed = np.zeros((len(radiance), 4), dtype=np.uint8)
    for block in row_blocks(len(radiance)):
        packed[block, :3] = encode_srgb(radiance[block])
    return packed.view("<u4").reshape(-1)
