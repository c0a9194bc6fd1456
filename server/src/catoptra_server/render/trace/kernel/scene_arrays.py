"""Scenes and objects as the kernel's structures, with the arrays that these point into.

Texels have a border: the image is repeated by one texel on every side, so that a bilinear look-up
never leaves the array. Twin: `world/textures.py:sample_levels`.

The kernel proves for parts of an image that one flat surface fills all (`src/coverage.h`). Every
surface is a candidate in every part of the image, so their number is limited; small triangles are
enclosed in spheres, which can only prevent a proof.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import einsum, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.image_changer import encode_srgb
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
from catoptra_server.world.objects import ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    OPEN,
    OcclusionMap,
    hemisphere_lights,
    shadow_casting_lights,
    write_facet_radiance,
)
from catoptra_server.world.textures import Levels, build_levels, uv_gradients
from catoptra_server.world.triangles import row_blocks
from catoptra_server.world.world_description import DirectionalLight, Light, PointLight

# Beyond, no sensible part of an image shows one surface, and finding surfaces takes a second for a
# million triangles.
MAX_TRIANGLES = 200_000
# Candidates of a frame: each costs 5 ns for each of 100 parts of an image.
_MAX_LARGE = 4000
_MAX_CLUSTERS = 500
# Two triangles lie in one plane if their unit normals agree to this: 1e-5 rad.
_SAME_NORMAL = 1.0 - 5e-11
# Texture coordinates at one point, by the planes of two triangles.
_SAME_UV = 1e-9
# Corners of neighbours result from different sums: within a nanometre both are one vertex.
_SAME_POSITION_DIGITS = 9
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


def scene_arrays(scene: SceneMesh, centre: Floats) -> OwningStruct:
    """Triangles of a static scene, relative to its centre."""
    flags = (
        scene.unlit * np.uint8(FACET_UNLIT)
        + (scene.texture_index >= 0) * np.uint8(FACET_TEXTURED)
        + _has_corner_colours(scene) * np.uint8(FACET_CORNER_COLOURS)
    )
    if scene.occlusion is not None:
        flags += (scene.occlusion.patch_of >= 0) * np.uint8(FACET_OCCLUDED)
    return _mesh_arrays(
        scene.corners,
        centre,
        scene.normals,
        scene.albedo,
        flags,
        corner_albedo=_float32(scene.corner_albedo),
        uv=_uv_frames(scene.uv) if scene.textures else None,
        texture=scene.texture_index.astype(np.int32) if scene.textures else None,
    )


def object_arrays(mesh: ObjectMesh) -> OwningStruct:
    """Triangles of a dynamic object, in its own frame."""
    flags = mesh.unlit * np.uint8(FACET_UNLIT)
    return _mesh_arrays(mesh.corners, np.zeros(3), mesh.normals, mesh.albedo, flags)


def caster_arrays(scene: SceneMesh, centre: Floats) -> OwningStruct:
    """Triangles that occlude lights, without materials: no ray shows a caster."""
    casters = scene.casts_shadows
    normals = scene.normals[casters]
    flags = np.zeros(len(normals), dtype=np.uint8)
    return _mesh_arrays(scene.corners[casters], centre, normals, np.zeros_like(normals), flags)


def corner_arrays(corners: Floats, centre: Floats) -> OwningStruct:
    """(n, 3, 3) corners relative to a centre, of triangles that are only met and never shown."""
    relative = _round_corners(corners, centre)
    return OwningStruct(MeshArrays(len(corners), corners=_address(relative)), (relative,))


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
        "corners": _round_corners(corners, centre),
        "normals": _float32(normals),
        "albedo": _float32(albedo),
        "flags": flags,
        **optional,
    }
    addresses = {name: _address(array) for name, array in arrays.items()}
    return OwningStruct(MeshArrays(len(corners), **addresses), tuple(arrays.values()))


def _round_corners(corners: Floats, centre: Floats) -> npt.NDArray[np.float32]:
    """(n, 3, 3) corners relative to a centre."""
    relative = np.zeros(corners.shape, dtype=np.float32)
    np.subtract(corners, centre, out=relative, casting="same_kind")
    return relative


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


def _has_corner_colours(scene: SceneMesh) -> Bools:
    """(n,) whether the colour varies over each triangle from corner to corner."""
    if scene.corner_albedo is None:
        return np.zeros(len(scene), dtype=bool)
    varies: Bools = (np.ptp(scene.corner_albedo, axis=1) > 0.0).any(axis=-1)
    return varies


def radiance_table(
    scene: SceneMesh, lights: Sequence[Light], background: Sequence[float]
) -> npt.NDArray[np.float32]:
    """(n + 1, 3) radiance of the facets without point lights and textures; background last."""
    table = np.zeros((len(scene) + 1, 3), dtype=np.float32)
    write_facet_radiance(scene, lights, table[:-1])
    table[-1] = background
    return table


def encoded_table(radiance: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """(n + 1,) sRGB of a radiance table, R in the lowest byte."""
    packed = np.zeros((len(radiance), 4), dtype=np.uint8)
    for block in row_blocks(len(radiance)):
        packed[block, :3] = encode_srgb(radiance[block])
    return packed.view("<u4").reshape(-1)


def texture_array(scene: SceneMesh) -> OwningStruct:
    """Textures of a scene, each at all its levels."""
    textures = [_texture_levels(build_levels(image)) for image in scene.textures]
    structs = [TextureStruct(len(one.struct), ctypes.addressof(one.struct)) for one in textures]
    return OwningStruct((TextureStruct * max(1, len(structs)))(*structs), tuple(textures))


def _texture_levels(levels: Levels) -> OwningStruct:
    """The levels of one texture."""
    texels = tuple(_pad_texels(level) for level in levels)
    structs = [
        TextureLevelStruct(level.shape[1], level.shape[0], padded.ctypes.data)
        for level, padded in zip(levels, texels, strict=True)
    ]
    return OwningStruct((TextureLevelStruct * len(structs))(*structs), texels)


def _pad_texels(linear: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """(h + 2, w + 2, 4) texels of (h, w, 3) linear light; the fourth channel is zero."""
    height, width = linear.shape[:2]
    texels = np.zeros((height + 2, width + 2, 4), dtype=np.uint16)
    np.rint(_MAX_TEXEL * linear, out=texels[1:-1, 1:-1, :3], casting="unsafe")
    texels[0], texels[-1] = texels[-2], texels[1]
    texels[:, 0], texels[:, -1] = texels[:, -2], texels[:, 1]
    return texels


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
        return LightStruct(LIGHT_DIRECTIONAL, lights_scene, tuple(towards), tuple(light.irradiance))
    position = np.asarray(light.position_m) - centre
    return LightStruct(LIGHT_POINT, lights_scene, tuple(position), tuple(light.intensity))


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
    return OwningStruct(struct, (occlusion, structs, sums))


def _relative_rows(rows: Floats, centre: Floats) -> list[list[float]]:
    """(m, 4) rows for points relative to a centre."""
    offset = rows[:, 3:] + matmul(rows[:, :3], centre[:, None])
    relative: list[list[float]] = np.concatenate((rows[:, :3], offset), axis=1).tolist()
    return relative


def _sum_dark_nodes(texels: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
    """(h + 1, w + 1) numbers of texels above and left that are not open."""
    sums = np.zeros((texels.shape[0] + 1, texels.shape[1] + 1), dtype=np.int32)
    np.cumsum(texels < OPEN, axis=0, out=sums[1:, 1:])
    np.cumsum(sums, axis=1, out=sums)
    return sums


def surfaces_struct(scene: SceneMesh, centre: Floats) -> OwningStruct:
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
    return OwningStruct(struct, (found, spheres))


@dataclass(frozen=True, slots=True, eq=False)
class FlatSurfaces:
    """Surfaces of a scene: connected coplanar triangles of one material. World frame."""

    triangles: _Indices
    """(m,) triangles that belong to surfaces."""
    surface: _Indices
    """(m,) surface of each."""
    outer_edges: npt.NDArray[np.uint8]
    """(m,) bit masks of the edges that bound a surface; bit k is the edge from corner k on."""
    representative: _Indices
    """(s,) largest triangle of each surface."""
    clusters: Floats
    """(c, 4) centres and radii of spheres around all other triangles, metres."""


def find_flat_surfaces(scene: SceneMesh) -> FlatSurfaces:
    """Surfaces and clusters of a scene; none at all for a scene of very many triangles."""
    if not 0 < len(scene) <= MAX_TRIANGLES:
        return _NO_SURFACES
    longest = _longest_edge(scene.corners)
    side = _cluster_side(scene.corners, longest)
    large, small = np.flatnonzero(longest > side), np.flatnonzero(longest <= side)
    pairs, outer_edges = _join_triangles(scene, large)
    surface = _connected_components(len(large), pairs)
    return FlatSurfaces(
        triangles=large.astype(np.int32),
        surface=surface,
        outer_edges=outer_edges,
        representative=_largest_of_each(scene.corners, large, surface),
        clusters=_enclose_clusters(scene.corners[small], side),
    )


_NO_SURFACES = FlatSurfaces(
    triangles=np.zeros(0, np.int32),
    surface=np.zeros(0, np.int32),
    outer_edges=np.zeros(0, np.uint8),
    representative=np.zeros(0, np.int32),
    clusters=np.zeros((0, 4)),
)


def _longest_edge(corners: Floats) -> Floats:
    """(n,) length of each triangle's longest edge."""
    edges = corners - np.roll(corners, 1, axis=1)
    longest: Floats = np.sqrt(np.square(edges).sum(axis=-1).max(axis=-1, initial=0.0))
    return longest


def _cluster_side(corners: Floats, longest: Floats) -> float:
    """Least side of clusters that leaves few enough triangles and clusters, metres; -1: none."""
    if len(corners) <= _MAX_LARGE:
        return -1.0
    # Not so small that the numbers of the cubes leave 63 bits.
    extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    side = max(float(np.partition(longest, -_MAX_LARGE)[-_MAX_LARGE]), 1e-5 * extent)
    centres = corners.mean(axis=1)
    while len(np.unique(_number_cubes(centres, side))) > _MAX_CLUSTERS:
        side *= 1.5
    return side


def _number_cubes(points: Floats, side: float) -> npt.NDArray[np.int64]:
    """(n,) number of the cube that contains each of (n, 3) points."""
    cell = np.floor((points - points.min(axis=0, initial=np.inf)) / side).astype(np.int64)
    count = cell.max(axis=0, initial=0) + 1
    numbers: npt.NDArray[np.int64] = (cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2]
    return numbers


def _enclose_clusters(corners: Floats, side: float) -> Floats:
    """(c, 4) centres and radii of spheres around the triangles of each cube."""
    if not len(corners):
        return np.zeros((0, 4))
    _, group = np.unique(_number_cubes(corners.mean(axis=1), side), return_inverse=True)
    order = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[order], np.arange(int(group.max()) + 1))
    lowest = np.minimum.reduceat(corners.min(axis=1)[order], starts)
    highest = np.maximum.reduceat(corners.max(axis=1)[order], starts)
    centres = 0.5 * (lowest + highest)
    reach = np.linalg.norm(corners - centres[group][:, None], axis=-1).max(axis=-1)
    return np.column_stack((centres, np.maximum.reduceat(reach[order], starts)))


def _largest_of_each(corners: Floats, large: npt.NDArray[np.intp], surface: _Indices) -> _Indices:
    """(s,) triangle with the largest area of each surface: its plane is the best known."""
    cross = np.cross(corners[large, 1] - corners[large, 0], corners[large, 2] - corners[large, 0])
    order = np.lexsort((-np.linalg.norm(cross, axis=-1), surface))
    first = np.searchsorted(surface[order], np.arange(int(surface.max(initial=-1)) + 1))
    return large[order[first]].astype(np.int32)


def _join_triangles(
    scene: SceneMesh, large: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.uint8]]:
    """(p, 2) pairs of large triangles that continue each other, and the edges without any pair."""
    corners = scene.corners[large].reshape(-1, 3).round(_SAME_POSITION_DIGITS)
    _, corner = np.unique(_number_rows(corners), return_inverse=True)
    triangles = corner.reshape(-1, 3)
    follower = np.roll(triangles, -1, axis=1)
    ends = np.sort(np.stack((triangles, follower), axis=-1), axis=-1)
    numbers = _number_rows(ends.reshape(-1, 2))
    _, edge, count = np.unique(numbers, return_inverse=True, return_counts=True)
    order = np.argsort(edge.reshape(-1), kind="stable")
    first = (np.cumsum(count) - count)[count == 2]
    # Flat indices 3 * triangle + edge of the two sides of each edge that two triangles share.
    sides = np.stack((order[first], order[first + 1]), axis=-1)
    # One edge, one normal: triangles that pass the edge in opposite directions lie on both
    # sides. Copies of one triangle do not, and end there.
    is_forward = (triangles < follower).reshape(-1)[sides]
    sides = sides[is_forward[:, 0] != is_forward[:, 1]]
    sides = sides[_continue_each_other(scene, large[sides // 3])]
    is_outer = np.ones(3 * len(large), dtype=bool)
    is_outer[sides.reshape(-1)] = False
    return sides // 3, (is_outer.reshape(-1, 3) @ np.array([1, 2, 4])).astype(np.uint8)


def _number_rows(rows: npt.NDArray[np.generic]) -> npt.NDArray[np.int64]:
    """(n,) numbers that order and tell apart (n, k) rows, as their elements do.

    Sorted column by column: `np.unique` of whole rows takes seven times as long.
    """
    numbers = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:
        values, rank = np.unique(column, return_inverse=True)
        numbers = numbers * len(values) + rank
    return numbers


def _continue_each_other(scene: SceneMesh, pairs: npt.NDArray[np.intp]) -> Bools:
    """(p,) whether two neighbours are coplanar and of one material."""
    a, b = pairs[:, 0], pairs[:, 1]
    alike: Bools = einsum("ij,ij->i", scene.normals[a], scene.normals[b]) > _SAME_NORMAL
    alike &= (scene.albedo[a] == scene.albedo[b]).all(axis=-1)
    alike &= scene.unlit[a] == scene.unlit[b]
    # One surface has one label.
    alike &= scene.object_index[a] == scene.object_index[b]
    alike &= scene.texture_index[a] == scene.texture_index[b]
    has_colours = _has_corner_colours(scene)
    alike &= ~has_colours[a] & ~has_colours[b]
    textured = np.flatnonzero(alike & (scene.texture_index[a] >= 0))
    # Texture coordinates of the first one's plane, at the other's corners.
    corners, uv = scene.corners[a[textured]], scene.uv[a[textured]]
    gradient = uv_gradients(corners, uv)
    offset = uv[:, 0] - einsum("nki,ni->nk", gradient, corners[:, 0])
    there = einsum("pci,pki->pck", scene.corners[b[textured]], gradient) + offset[:, None]
    alike[textured] = (np.abs(there - scene.uv[b[textured]]) < _SAME_UV).all(axis=(1, 2))
    return alike


def _connected_components(count: int, pairs: npt.NDArray[np.intp]) -> _Indices:
    """(count,) group of each element joined by (p, 2) pairs, numbered from 0."""
    label = np.arange(count)
    while True:
        smallest = label.copy()
        np.minimum.at(smallest, pairs[:, 0], label[pairs[:, 1]])
        np.minimum.at(smallest, pairs[:, 1], label[pairs[:, 0]])
        smallest = smallest[smallest]  # halves the length of chains
        if (smallest == label).all():
            break
        label = smallest
    return np.unique(label, return_inverse=True)[1].astype(np.int32)
