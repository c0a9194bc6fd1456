"""Lighting and texture model in float64, the reference of both renderers.

Twin: glsl/include/point_irradiance.glsl.

A triangle is a Lambertian facet with one normal, lit on its outer side; its radiance is albedo
times irradiance, with 1 = a white facet at full scale. Hemisphere and directional lights depend on
the normal alone, so their irradiance is computed once a triangle; a point light's depends on the
position and is computed per sample. With shadows, directional lights are computed per sample as
well, since they may be occluded. Textures repeat and are interpolated bilinearly in linear light.
Encoding to sRGB comes last.

Surfaces that blend are shown front to back: each adds its radiance, fogged, times its opacity, and
lets the rest of what lies behind through.

Ambient occlusion of a static scene: how much of the sky's light reaches each of its points. Flat
surfaces carry grids of factors, the nodes of which are
stored in one atlas of bytes and interpolated bilinearly; a factor scales hemisphere light alone.
Most triangles have no grid: nothing near occludes them, and their factor is exactly 1. Twins:
render/trace/kernel/src/occlusion.c and glsl/include/occlusion.glsl.

Where light is baked, grids have 16-bit factors of each colour, of a hemisphere light as bright as
the brightest node: sky, area lights and all that surfaces reflect (render/trace/occlusion/
light_bake.py). Dynamic objects then have the light of probes about their centres.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field, replace
from functools import cache
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan2, einsum, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.triangles import row_blocks
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Light,
    PointLight,
    Vector3,
    World,
    linear_from_srgb,
)

# Lights that a surface can occlude.
ShadowCastingLight = DirectionalLight | PointLight

MIN_LIGHT_DISTANCE_M = 1e-3
"""A point light counts from this distance at least: a lamp may touch a surface, where the inverse
square has no value."""

MAX_LAYERS = 8
"""Blended surfaces that a ray shows: the nearest ones; behind them what is opaque, alone. Of
surfaces at one distance one is shown. Twins: src/tiles.c, render/raster/face_pass.py."""

SHADE_FADE_M, SHADE_REACH_M = 0.6, 0.8
"""Distances from a body between which the shade that it throws on baked light fades. Twin:
src/body_shade.c."""

LEAST_COVERAGE = 2.0**-12
"""From which a point of a blended surface counts as one of them: half of it, as an opacity, changes
black by less than half a grey level."""


class LitFacets(Protocol):
    """Surfaces to be lit: the triangles of a scene, or of a dynamic object at its pose."""

    @property
    def normals(self) -> Floats:
        """(n, 3) unit normals, world frame."""

    @property
    def albedo(self) -> Floats:
        """(n, 3) linear albedos."""

    @property
    def unlit(self) -> Bools:
        """(n,) triangles shown at their albedo, whatever the lights."""


def facet_irradiance(lights: Iterable[Light], normals: Floats) -> Floats:
    """(n, 3) irradiance by hemisphere and directional lights on facets of (n, 3) normals."""
    # A row for each colour channel: operations on rows of three take five times as long.
    total = np.zeros((3, len(normals)))
    for light in lights:
        match light:
            case HemisphereLight(sides=sides) if sides is not None:
                # The even part weighs the means of opposite sides by squares of the normal.
                one, other = light.faces[::2], light.faces[1::2]
                irradiance = matmul(normals, 0.5 * (one - other))
                irradiance += matmul(np.square(normals), 0.5 * (one + other))
                total += np.maximum(irradiance, 0.0).T
            case HemisphereLight(up_irradiance, down_irradiance):
                # z points down: an upward facet has normal z = -1.
                upward = 0.5 * (1.0 - normals[:, 2])
                for channel, up, down in zip(total, up_irradiance, down_irradiance, strict=True):
                    channel += upward * up + (1.0 - upward) * down
            case DirectionalLight(direction, irradiance):
                cosine = np.maximum(-matmul(normals, np.asarray(direction)), 0.0)
                for channel, value in zip(total, irradiance, strict=True):
                    channel += cosine * value
            case PointLight():
                pass
    return total.T


def box_form_factors(points: Floats, normals: Floats, half: Floats) -> Floats:
    """(n,) form factors of a box from (n, 3) points with (n, 3) unit normals; 0 inside.

    Lambert's formula for each face before a point, cut off at the point's horizon. Source: Baum et
    al. 1989, Eq. 11.

    Args:
        points: In the box's frame.
        normals: Likewise.
        half: (3,) half sides.
    """
    total = np.zeros(len(points))
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        side = np.sign(points[:, axis]) * (np.abs(points[:, axis]) > half[axis])
        corners = np.zeros((len(points), 4, 3))
        corners[..., axis] = (side * half[axis])[:, None]
        corners[..., others] = signs * half[others]
        total -= side * _polygon_terms(corners - points[:, None], normals)
    return np.asarray(total / (2.0 * np.pi))


def _polygon_terms(corners: Floats, normals: Floats) -> Floats:
    """(n,) sums of angles of the edges of (n, 4, 3) polygons times cosines of their planes."""
    heights = einsum("nki,ni->nk", corners, normals)
    cuts: dict[bool, Floats] = {way: np.zeros((len(corners), 3)) for way in (False, True)}
    total = np.zeros(len(corners))
    for one, other in ((0, 1), (1, 2), (2, 3), (3, 0)):
        first, second = heights[:, one], heights[:, other]
        begin, end = corners[:, one], corners[:, other]
        rises, sinks = (first < 0.0) & (second >= 0.0), (first >= 0.0) & (second < 0.0)
        share = first / np.where(rises | sinks, first - second, 1.0)
        cut = begin + share[:, None] * (end - begin)
        for way, is_cut in ((False, rises), (True, sinks)):
            cuts[way] = np.where(is_cut[:, None], cut, cuts[way])
        begin = np.where(rises[:, None], cut, begin)
        end = np.where(sinks[:, None], cut, end)
        term = _edge_terms(begin, end, normals)
        total += np.where((first < 0.0) & (second < 0.0), 0.0, term)
    return total + _edge_terms(cuts[True], cuts[False], normals)


def _edge_terms(begin: Floats, end: Floats, normals: Floats) -> Floats:
    product = np.cross(begin, end)
    sine = np.sqrt(np.square(product).sum(axis=-1))
    along = einsum("ni,ni->n", product, normals) / np.where(sine > 0.0, sine, 1.0)
    return np.asarray(along * arctan2(sine, einsum("ni,ni->n", begin, end)))


def point_irradiance(lights: Iterable[Light], points: Floats, normals: Floats) -> Floats:
    """(n, 3) irradiance by point lights at (n, 3) points with (n, 3) normals.

    At the light itself the irradiance is as at a millimetre.
    """
    total = np.zeros_like(normals)
    for light in point_lights(lights):
        towards = np.asarray(light.position_m) - points
        squared = np.maximum(
            einsum("ij,ij->i", towards, towards), MIN_LIGHT_DISTANCE_M * MIN_LIGHT_DISTANCE_M
        )
        cosine = np.maximum(einsum("ij,ij->i", towards, normals), 0.0) / np.sqrt(squared)
        total += (cosine / squared)[:, None] * np.asarray(light.intensity)
    return total


def point_lights(lights: Iterable[Light]) -> tuple[PointLight, ...]:
    """Point lights among the lights."""
    return tuple(light for light in lights if isinstance(light, PointLight))


def shadow_casting_lights(lights: Iterable[Light]) -> tuple[ShadowCastingLight, ...]:
    """Lights that cast shadows: directional lights first, then point lights."""
    directional = tuple(light for light in lights if isinstance(light, DirectionalLight))
    return (*directional, *point_lights(lights))


def hemisphere_lights(lights: Iterable[Light]) -> tuple[HemisphereLight, ...]:
    """Hemisphere lights among the lights; no surface occludes them."""
    return tuple(light for light in lights if isinstance(light, HemisphereLight))


def object_lights(world: World, place: Floats | None = None) -> tuple[Light, ...]:
    """Lights of dynamic objects, at a (3,) place or wherever they are."""
    sky = world.object_sky
    if world.probes is not None and place is not None:
        sky = world.probes.find_light(place)
    if sky is None:
        return world.lights
    return (sky, *(light for light in world.lights if not isinstance(light, HemisphereLight)))


def are_lit_alike(world: World, other: World) -> bool:
    """Whether two worlds have the same lights."""
    return world.lights == other.lights and world.object_sky == other.object_sky


def open_irradiance(lights: Iterable[Light]) -> Vector3:
    """Irradiance of an upward surface that nothing is hidden from, by hemisphere lights."""
    up = [light.up_irradiance for light in hemisphere_lights(lights)]
    red, green, blue = (sum(values) for values in zip((0.0, 0.0, 0.0), *up, strict=True))
    return red, green, blue


def unshadowed_irradiance(light: ShadowCastingLight, points: Floats, normals: Floats) -> Floats:
    """(n, 3) irradiance by one light at (n, 3) points, without occlusion."""
    if isinstance(light, PointLight):
        return point_irradiance((light,), points, normals)
    return facet_irradiance((light,), normals)


def direction_to_light(light: ShadowCastingLight, points: Floats) -> tuple[Floats, Floats]:
    """(n, 3) unit directions from points to a light, and (n,) distances, inf for directional
    ones."""
    if isinstance(light, DirectionalLight):
        towards = np.broadcast_to(-np.asarray(light.direction), points.shape)
        return towards, np.full(len(points), np.inf)
    offset = np.asarray(light.position_m) - points
    distance = np.linalg.norm(offset, axis=-1)
    return offset / np.maximum(distance, MIN_LIGHT_DISTANCE_M)[:, None], distance


def facet_radiance(facets: LitFacets, lights: Iterable[Light]) -> Floats:
    """(n, 3) linear radiance of each triangle without texture and point lights."""
    radiance = np.zeros(facets.normals.shape)
    write_facet_radiance(facets, lights, radiance)
    return radiance


def write_facet_radiance(
    facets: LitFacets, lights: Iterable[Light], radiance: npt.NDArray[np.floating]
) -> None:
    """Write the result of `facet_radiance` into an (n, 3) array, rounded to its type."""
    lights = tuple(lights)
    for block in row_blocks(len(radiance)):
        irradiance = facet_irradiance(lights, facets.normals[block])
        np.copyto(irradiance, 1.0, where=facets.unlit[block, None])
        np.multiply(facets.albedo[block], irradiance, out=radiance[block], casting="same_kind")


def corner_radiance(facets: LitFacets, corner_albedo: Floats, lights: Iterable[Light]) -> Floats:
    """(n, 3, 3) linear radiance at the corners of triangles without texture and point lights.

    Radiance is proportional to the albedo, so interpolation of either gives the same.
    """
    irradiance = facet_irradiance(lights, facets.normals)
    return corner_albedo * np.where(facets.unlit[:, None], 1.0, irradiance)[:, None]


def sample_texture(texture: npt.NDArray[Any], uv: Floats) -> Floats:
    """(n, 3) linear colours of a (h, w, 3) texture at (n, 2) coordinates; with opacity, (n, 4).

    (0, 0) is the top left corner of the image, (1, 1) the bottom right; the texture repeats.

    Args:
        texture: linear texels, or bytes as of `decode_texels`.
        uv: the coordinates.
    """
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, top = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    # Modulo before the lookup: the texel beyond the last column is the first.
    xa, xb, ya, yb = left % width, (left + 1) % width, top % height, (top + 1) % height
    corners = [texture[row, column] for row in (ya, yb) for column in (xa, xb)]
    if texture.dtype == np.uint8:
        corners = [decode_texels(texels) for texels in corners]
    upper = (1.0 - fx) * corners[0] + fx * corners[1]
    lower = (1.0 - fx) * corners[2] + fx * corners[3]
    value: Floats = (1.0 - fy) * upper + fy * lower
    return value


def decode_texels(texels: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """(..., 3) linear light of sRGB bytes, or (..., 4) with opacity, whose bytes are linear."""
    light = light_of_bytes().take(texels)
    light[..., 3:] = texels[..., 3:] / np.float32(255.0)
    return light


@cache
def light_of_bytes() -> npt.NDArray[np.float32]:
    """(256,) linear light of sRGB bytes."""
    light = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
    light.setflags(write=False)
    return light


# Bytes are factors: 255 is 1. So are 16 bits.
OPEN = 255
OPEN_LIGHT = 65535
# Grids begin at multiples of this in the atlas, whose sides are multiples, too: blocks of nodes
# that belong to one grid.
BLOCK = 4


def find_grid_nodes(
    bounds: npt.NDArray[np.integer], width: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Places of the k nodes of m grids in an atlas, grid by grid and row by row.

    Args:
        bounds: (m, 4) as of `OcclusionMap`.
        width: Columns of the atlas.

    Returns:
        (k,) index of each node, (k,) its grid, and (m,) where each grid begins among them.
    """
    left, top, right, bottom = np.asarray(bounds, dtype=np.intp).T
    columns, count = right - left + 1, (right - left + 1) * (bottom - top + 1)
    first, number = np.cumsum(count) - count, np.repeat(np.arange(len(count)), count)
    row, column = np.divmod(np.arange(len(number)) - first[number], columns[number])
    return (top[number] + row) * width + left[number] + column, number, first


@dataclass(frozen=True, slots=True, eq=False)
class OcclusionMap:
    """Factors of hemisphere light on the surfaces of a scene."""

    patch_of: npt.NDArray[np.int32]
    """(n,) grid of each triangle; -1: nothing occludes it."""
    columns_from_world: Floats
    """(m, 4) for each grid: the atlas column of a point is the product with (x, y, z, 1)."""
    rows_from_world: Floats
    """(m, 4) likewise for the row."""
    bounds: npt.NDArray[np.int32]
    """(m, 4) first column, first row, last column, last row of each grid in the atlas."""
    texels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    """(h, w) atlas; of 16 bits for each colour, (3, h, w)."""
    ranges: Floats | None = None
    """(3, m, 3) least, mean and largest factor of each grid of baked light, errors included; None
    for ambient occlusion."""
    stated_error: float = 0.0
    """Grey levels of a white surface that the errors of 99 of 100 nodes stay below."""
    darkest: Floats = field(init=False)
    """(m, 1) or (m, 3) smallest factors of each grid."""
    is_constant: Bools = field(init=False)
    """(m,) grids of baked light that have one factor."""

    def __post_init__(self) -> None:
        """Find what is darkest on each grid, for bounds, and where nothing is brighter."""
        planes = self.planes
        index, _, first = find_grid_nodes(self.bounds, planes.shape[-1])
        nodes = planes.reshape(len(planes), -1)[:, index]
        darkest, brightest = (
            extreme.reduceat(nodes, first, axis=1).T for extreme in (np.minimum, np.maximum)
        )
        object.__setattr__(self, "darkest", darkest / self.open)
        is_constant = (darkest == brightest).all(axis=1) & (len(planes) > 1)
        object.__setattr__(self, "is_constant", is_constant)
        for array in (self.patch_of, self.columns_from_world, self.rows_from_world, self.bounds):
            array.setflags(write=False)
        self.texels.setflags(write=False)

    @property
    def planes(self) -> npt.NDArray[np.integer]:
        """(1, h, w) or (3, h, w) atlas."""
        return self.texels if self.texels.ndim == 3 else self.texels[None]

    @property
    def open(self) -> int:
        """Texel of the factor 1."""
        return OPEN if self.texels.ndim == 2 else OPEN_LIGHT

    @property
    def arrays(self) -> tuple[npt.NDArray[np.generic], ...]:
        """All that a map is made of."""
        rows = self.columns_from_world, self.rows_from_world
        return (self.patch_of, *rows, self.bounds, self.texels)

    def atlas_positions(self, triangles: npt.NDArray[np.integer], points: Floats) -> Floats:
        """(n, 2) columns and rows of (n, 3) points on triangles that have grids."""
        patch = self.patch_of[triangles]
        frames = np.stack((self.columns_from_world[patch], self.rows_from_world[patch]), axis=1)
        positions: Floats = einsum("nki,ni->nk", frames[..., :3], points) + frames[..., 3]
        bounds = self.bounds[patch]
        # A point beside the outermost nodes, by rounding or near an edge, has the nodes' factor.
        return np.clip(positions, bounds[:, :2], bounds[:, 2:])

    def factors(self, triangles: npt.NDArray[np.integer], points: Floats) -> Floats:
        """(n, 1) or (n, 3) factors of hemisphere light at (n, 3) points, world frame."""
        planes = self.planes
        factors = np.ones((len(points), len(planes)))
        inside = np.flatnonzero(self.patch_of[triangles] >= 0)
        positions = self.atlas_positions(triangles[inside], points[inside])
        first = np.floor(positions).astype(np.intp)
        fx, fy = (positions - first).T
        # In the last column and row both nodes are the same.
        last = self.bounds[self.patch_of[triangles[inside]], 2:]
        (xa, ya), (xb, yb) = first.T, np.minimum(first + 1, last).T
        upper = (1.0 - fx) * planes[:, ya, xa] + fx * planes[:, ya, xb]
        lower = (1.0 - fx) * planes[:, yb, xa] + fx * planes[:, yb, xb]
        factors[inside] = (((1.0 - fy) * upper + fy * lower) / self.open).T
        return factors

    def find_constants(self) -> tuple[Bools, Floats]:
        """(n,) triangles whose grid has one factor, and (n, 1) or (n, 3) factors there, else 1."""
        is_constant: Bools = np.append(self.is_constant, False)[self.patch_of]
        return is_constant, np.where(is_constant[:, None], self.smallest_factors(), 1.0)

    def average(self) -> OcclusionMap:
        """The same with one factor on each grid, the mean of its nodes."""
        texels = self.texels.copy()
        for left, top, right, bottom in self.bounds.tolist():
            part = texels[..., top : bottom + 1, left : right + 1]
            part[...] = np.rint(part.mean(axis=(-2, -1), keepdims=True)).astype(texels.dtype)
        return replace(self, texels=texels)

    def smallest_factors(self, triangles: slice | npt.NDArray[np.intp] = slice(None)) -> Floats:
        """(k, 1) or (k, 3) smallest factors of any point of each of some triangles."""
        darkest = np.concatenate((self.darkest, np.ones((1, len(self.planes)))))
        smallest: Floats = darkest[self.patch_of[triangles]]
        return smallest
