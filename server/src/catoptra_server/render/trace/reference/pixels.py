"""Radiance and labels of hits, in NumPy.

Radiance by the functions of `world/shading.py`, with a ray to every light where there are shadows.
Labels are the twin of `src/labels.c`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import fields, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.elementary import matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.reference.meshes import (
    FirstHits,
    PlacedMesh,
    WorldRays,
    find_first_hits,
    interpolate_poses,
)
from catoptra_server.render.trace.trace_engine import (
    NOTHING,
    STATIC_SCENE,
    LabelNumbers,
    LabelTables,
    PixelLabels,
    RayHits,
    TracedExposure,
    assemble_grid,
    camera_states,
)
from catoptra_server.world.objects import DynamicObject, FogMedium, find_body
from catoptra_server.world.panorama import Panorama
from catoptra_server.world.shading import (
    LEAST_COVERAGE,
    MAX_LAYERS,
    SHADE_FADE_M,
    SHADE_REACH_M,
    ShadowCastingLight,
    box_form_factors,
    direction_to_light,
    facet_irradiance,
    hemisphere_lights,
    point_irradiance,
    shadow_casting_lights,
    unshadowed_irradiance,
)
from catoptra_server.world.world_description import HemisphereLight, Rgb

# Distance of a shadow ray's origin in front of its facet, relative to the largest coordinate of
# hit and camera: positions and corners are rounded to 2^-24 each, and a hit on a plane loses a few
# times that. 40 um at 10 m. Without it the facet itself would occlude its lights.
_SHADOW_BIAS = 2.0**-18

_RayIndices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """What shades the rays of an exposure."""

    centre: Floats
    """(3,) scene's centre in the world: origin of the rays' coordinates."""
    background: Rgb
    """Linear radiance of rays without a hit."""
    has_shadows: bool
    """Whether surfaces occlude directional and point lights."""
    has_gloss: bool = False
    """Whether glossy surfaces show what they mirror."""
    fog: FogMedium | None = None
    """Air between camera and surfaces, and between these and what they mirror."""
    sky: Panorama | None = None
    """Radiance of rays without a hit, where it differs by direction."""
    bodies: tuple[DynamicObject, ...] = ()
    """Objects that shade baked light."""
    mean_sky: tuple[HemisphereLight, ...] = ()
    """What rough glossy surfaces mirror of all directions: the light of moving objects, too. On the
    scene itself baked light has that of its brightest node, times a map."""


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points of one mesh to be lit."""

    positions: Floats
    """(n, 3) relative to the scene's centre."""
    normals: Floats
    """(n, 3) unit."""
    bias_m: Floats
    """(n,) distances of shadow rays from their facets."""


_Record = TypeVar("_Record", WorldRays, FirstHits, _Points)


def shade_hits(
    meshes: Sequence[PlacedMesh], rays: WorldRays, hits: FirstHits, lighting: Lighting
) -> Floats:
    """(n, 3) linear radiance along rays."""
    radiance: Floats = np.full(rays.origins.shape, lighting.background, dtype=np.float64)
    if lighting.sky is not None:
        open_rays = np.flatnonzero(hits.object == NOTHING)
        radiance[open_rays] = lighting.sky.radiance(rays.directions[open_rays])
    for number in range(len(meshes)):
        selected = np.flatnonzero(hits.object == number)
        if len(selected):
            placed = [mesh.take(selected) for mesh in meshes]
            radiance[selected] = _shade_mesh(
                placed, number, _take(rays, selected), _take(hits, selected), lighting
            )
    gloss = meshes[STATIC_SCENE].mesh.gloss
    if lighting.has_gloss and gloss is not None:
        static = np.flatnonzero(hits.object == STATIC_SCENE)
        rows = static[gloss[hits.triangle[static], 0] > 0.0]
        placed, part = [mesh.take(rows) for mesh in meshes], _take(rays, rows)
        radiance[rows] = _mix_reflection(placed, part, _take(hits, rows), radiance[rows], lighting)
    return radiance


def _mix_reflection(
    meshes: Sequence[PlacedMesh], rays: WorldRays, hits: FirstHits, own: Floats, lighting: Lighting
) -> Floats:
    """(n, 3) radiance of glossy triangles, by the formula of `effects/scene/gloss.py`."""
    scene = meshes[STATIC_SCENE].mesh
    assert scene.gloss is not None, "the triangles are glossy"
    reflectance, roughness = scene.gloss[hits.triangle].T[..., None]
    normals = scene.facets.normals[hits.triangle]
    normals = -np.sign(_dot(normals, rays.directions)) * normals
    cosine = -_dot(normals, rays.directions)
    grazing = np.maximum(1.0 - roughness, reflectance)
    fresnel = reflectance + (grazing - reflectance) * (1.0 - np.minimum(cosine, 1.0)) ** 5
    positions = rays.origins + hits.distance[:, None] * rays.directions
    largest = np.maximum(np.abs(positions), np.abs(rays.origins)).max(axis=-1, keepdims=True)
    length = np.linalg.norm(rays.steps, axis=-1, keepdims=True)
    spread = np.hypot(length, roughness[:, None] ** 2) / np.where(length > 0.0, length, 1.0)
    steps = spread * (rays.steps - 2.0 * _dot(rays.steps, normals[:, None]) * normals[:, None])
    directions = rays.directions + 2.0 * cosine * normals
    mirrored = WorldRays(positions + _SHADOW_BIAS * largest * normals, directions, steps)
    seen = find_first_hits(meshes, mirrored)
    # As from the mirrored viewpoint, so that footprints grow from there.
    apart = replace(mirrored, origins=mirrored.origins - hits.distance[:, None] * directions)
    far = replace(seen, distance=seen.distance + hits.distance)
    light = shade_hits(meshes, apart, far, replace(lighting, has_gloss=False))
    light = light if lighting.fog is None else lighting.fog.mix(light, seen.distance)
    mean = facet_irradiance(lighting.mean_sky, normals)
    mixed: Floats = own + fresnel * (light + roughness * (mean - light) - own)
    return mixed


def _dot(one: Floats, other: Floats) -> Floats:
    product: Floats = (one * other).sum(axis=-1, keepdims=True)
    return product


def shade_layers(meshes: Sequence[PlacedMesh], rays: WorldRays, lighting: Lighting) -> Floats:
    """(n, 3) linear radiance along rays, blended front to back where the static scene blends."""
    fog = lighting.fog
    scene, count = meshes[0].mesh, len(rays.origins)
    radiance, passing, begin = np.zeros((count, 3)), np.ones(count), np.zeros(count)
    rows = np.arange(count)
    for layer in range(MAX_LAYERS + 1):
        some, part = [mesh.take(rows) for mesh in meshes], _take(rays, rows)
        least = LEAST_COVERAGE if layer < MAX_LAYERS else np.inf
        hits = find_first_hits(some, part, begin[rows], least)
        light = shade_hits(some, part, hits, lighting)
        light = light if fog is None else fog.mix(light, hits.distance)
        opacity = np.ones(len(rows))
        static = np.flatnonzero(hits.object == STATIC_SCENE)
        opacity[static] = scene.opacities(_take(hits, static))
        radiance[rows] += (passing[rows] * opacity)[:, None] * light
        passing[rows] *= 1.0 - opacity
        begin[rows] = hits.distance
        rows = rows[opacity < 1.0]
        if not len(rows):
            break
    return radiance


def _take(record: _Record, rays: _RayIndices) -> _Record:
    """Some of the rows of a record of arrays."""
    rows = {field.name: getattr(record, field.name).take(rays, axis=0) for field in fields(record)}
    return replace(record, **rows)


def _shade_mesh(
    meshes: Sequence[PlacedMesh], number: int, rays: WorldRays, hits: FirstHits, lighting: Lighting
) -> Floats:
    """(n, 3) radiance of rays that all meet one mesh."""
    mesh = meshes[number].mesh
    points = _lit_points(meshes[number], rays, hits)
    irradiance = _irradiance(meshes, number, points, lighting)
    if mesh.occlusion is not None:
        in_world = points.positions + lighting.centre
        factors = mesh.occlusion.factors(hits.triangle, in_world)
        if lighting.bodies:
            own = mesh.facets.normals[hits.triangle]
            factors = factors * _find_open_parts(lighting.bodies, in_world, own)[:, None]
        sky = facet_irradiance(hemisphere_lights(mesh.lights), points.normals)
        irradiance -= (1.0 - factors) * sky
    irradiance[mesh.facets.unlit[hits.triangle]] = 1.0
    radiance = meshes[number].albedo_at(hits, rays) * irradiance
    return radiance if mesh.emission is None else radiance + mesh.emission[hits.triangle]


def _find_open_parts(objects: Sequence[DynamicObject], points: Floats, normals: Floats) -> Floats:
    """(n,) parts of baked light that objects leave to (n, 3) points, world frame."""
    parts = np.ones(len(points))
    for placed in objects:
        box = np.array(find_body(placed.mesh))
        pose, half = placed.world_from_object, box[3:]
        local = matmul(points - pose.translation, pose.rotation) - box[:3]
        turned = matmul(normals, pose.rotation)
        outside = np.maximum(np.abs(local) - half, 0.0)
        distance = np.sqrt(np.square(outside).sum(axis=-1))
        fade = (SHADE_REACH_M - distance) / (SHADE_REACH_M - SHADE_FADE_M)
        near = np.flatnonzero(fade > 0.0)
        factors = np.clip(box_form_factors(local[near], turned[near], half), 0.0, 1.0)
        parts[near] *= 1.0 - np.minimum(fade[near], 1.0) * factors
    return parts


def _lit_points(placed: PlacedMesh, rays: WorldRays, hits: FirstHits) -> _Points:
    """Positions and normals of hits."""
    positions = rays.origins + hits.distance[:, None] * rays.directions
    # The static scene alone has backs, and its axes are the world's.
    shading = placed.mesh.shading_normals(hits, rays.directions)
    normals = placed.world_from_mesh.normals(shading)
    largest = np.maximum(np.abs(positions), np.abs(rays.origins)).max(axis=-1)
    return _Points(positions, normals, _SHADOW_BIAS * largest)


def _irradiance(
    meshes: Sequence[PlacedMesh], number: int, points: _Points, lighting: Lighting
) -> Floats:
    """(n, 3) irradiance of points on one mesh."""
    lights = meshes[number].mesh.lights
    in_world = points.positions + lighting.centre
    if not lighting.has_shadows:
        total = facet_irradiance(lights, points.normals)
        return total + point_irradiance(lights, in_world, points.normals)
    total = facet_irradiance(hemisphere_lights(lights), points.normals)
    for light in shadow_casting_lights(lights):
        added = unshadowed_irradiance(light, in_world, points.normals)
        # Only facets turned to the light send a ray; all others are dark anyway.
        facing = np.flatnonzero(added.any(axis=-1))
        placed = [mesh.take(facing) for mesh in meshes]
        lit = facing[~_find_occlusion(placed, light, _take(points, facing), lighting.centre)]
        total[lit] += added[lit]
    return total


def _find_occlusion(
    meshes: Sequence[PlacedMesh], light: ShadowCastingLight, points: _Points, centre: Floats
) -> Bools:
    """(n,) whether some mesh lies between points and a light."""
    origins = points.positions + points.bias_m[:, None] * points.normals
    directions, distance = direction_to_light(light, origins + centre)
    is_occluded = np.zeros(len(origins), dtype=bool)
    for placed in meshes:
        transform = placed.world_from_mesh
        is_occluded |= placed.mesh.casters.occludes(
            transform.inverse_points(origins), transform.inverse_vectors(directions), distance
        )
    return is_occluded


def label_pixels(
    table: RayTable,
    hits: RayHits,
    exposure: TracedExposure,
    scene_normals: Floats,
    tables: LabelTables,
    channels: Collection[str],
) -> PixelLabels:
    """Label the pixels of an image.

    Args:
        table: Rays of the pixels' centres.
        hits: Hits of these rays.
        exposure: State, or states for rays with times.
        scene_normals: (n, 3) unit normals of the static scene's triangles, world frame.
        tables: Numbers of objects and classes.
        channels: Names of the channels that are wanted.

    Returns:
        Arrays by name, as `LABEL_CHANNELS` has them.
    """
    numbers = hit_numbers(hits, tables)
    values: dict[str, npt.NDArray[np.generic]] = {
        "range": hits.range_m,
        "ids": numbers,
        "classes": tables.class_table[numbers],
    }
    is_hit = hits.object >= STATIC_SCENE
    if {"point", "normal"} & set(channels):
        origins, directions, rotations = _world_rays(table, exposure)
        range_m = np.where(is_hit, hits.range_m, np.nan)[..., None]
        values["point"] = origins + range_m * directions
        normals = _world_normals(table, hits, exposure, scene_normals)
        facing = np.einsum("...i,...i->...", normals, directions)
        normals = np.where(facing[..., None] > 0.0, -normals, normals)
        values["normal"] = np.einsum("...ji,...j->...i", rotations, normals)
    return {name: _assemble(table, name, values[name]) for name in values if name in channels}


def hit_numbers(hits: RayHits, tables: LabelTables) -> LabelNumbers:
    """(t, samples^2, 16) number of the object that each ray meets; 0 for none."""
    numbers = np.zeros(hits.object.shape, dtype=np.uint16)
    static = hits.object == STATIC_SCENE
    numbers[static] = tables.triangle_numbers[hits.triangle[static]]
    moving = hits.object > STATIC_SCENE
    numbers[moving] = tables.object_numbers[hits.object[moving] - 1]
    return numbers


def count_agreement(table: RayTable, numbers: LabelNumbers, ids: LabelNumbers) -> PixelLabels:
    """The channel `agreement`.

    Args:
        table: Rays of the pixels' samples.
        numbers: Numbers of the objects that these meet.
        ids: (h, w) numbers of the objects that the pixels' centres meet.
    """
    samples = table.samples
    grid = assemble_grid(table, numbers[..., None].astype(np.float32), fill=np.float32(0.0))
    wanted = np.repeat(np.repeat(ids, samples, axis=0), samples, axis=1)
    # Nothing is no object that samples could share.
    agrees = (wanted > 0) & (grid[..., 0] == wanted)
    height, width = ids.shape
    share = agrees.reshape(height, samples, width, samples).mean(axis=(1, 3))
    return {"agreement": np.floor(255.0 * share + 0.5).astype(np.uint8)}


def _world_rays(table: RayTable, exposure: TracedExposure) -> tuple[Floats, Floats, Floats]:
    """(t, b, 16, 3) origins and unit directions in the world, and rotations of the camera."""
    states = camera_states(exposure)
    directions = np.moveaxis(table.directions, 2, -1).astype(np.float64)
    shape = directions.shape
    times = None if table.times is None else table.times.reshape(-1).astype(np.float64)
    camera = interpolate_poses([state.world_from_mirror for state in states], times)
    flat = camera.vectors(directions.reshape(-1, 3))
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
    origins = np.zeros((flat.shape[0], 3))
    if table.origins is not None:
        origins = np.moveaxis(table.origins, 2, -1).reshape(-1, 3).astype(np.float64)
    starts = camera.points(origins)
    matrix = np.broadcast_to(camera.matrix, (len(flat), 3, 3)).reshape(*shape, 3)
    return starts.reshape(shape), flat.reshape(shape), matrix


def _world_normals(
    table: RayTable, hits: RayHits, exposure: TracedExposure, scene_normals: Floats
) -> Floats:
    """(t, b, 16, 3) unit normals of what rays meet, by the winding, world frame; 0 for nothing."""
    states = camera_states(exposure)
    normals = np.zeros((*hits.object.shape, 3))
    static = hits.object == STATIC_SCENE
    normals[static] = scene_normals[hits.triangle[static]]
    for number, placed in enumerate(states[0].objects, 1):
        those = hits.object == number
        times = None if table.times is None else table.times[those].astype(np.float64)
        poses = [state.objects[number - 1].world_from_object for state in states]
        world_from_object = interpolate_poses(poses, times)
        normals[those] = world_from_object.normals(placed.mesh.normals[hits.triangle[those]])
    return normals


def _assemble(
    table: RayTable, name: str, values: npt.NDArray[np.generic]
) -> npt.NDArray[np.generic]:
    """Image of a channel of (t, 1, 16) or (t, 1, 16, k) values."""
    channel = LABEL_CHANNELS[name]
    at_pixels = values.reshape(*values.shape[:3], channel.depth).astype(np.float32)
    image = assemble_grid(table, at_pixels, fill=np.float32(channel.nothing))
    shape = channel.shape(table.height_px, table.width_px)
    return np.ascontiguousarray(image.reshape(shape), dtype=channel.dtype)
