"""Indirect light of a static scene on the nodes of the occlusion map's grids.

Rays from a node, distributed by the cosine, end on surfaces or in the sky; what each meets is
stored as a slot of a table of radiance, from which any number of bounces are gathered without
a ray. The irradiance of a node is the mean radiance of its slots. Sky, emission and area lights are
in the result; the sun and point lamps stay exact rays of each picture, and only what surfaces
reflect of them is. Source: Cohen & Wallace 1993, "Radiosity and Realistic Image Synthesis", with
form factors by rays.

Probes for what moves stand on a regular grid of the scene's box, each of six nodes that face along
the axes; one that sees backs, inside a solid or out of a room, has the light of the nearest other.
Walls between two do not count.

Passes of 16 rays, each shifted by random numbers of its own, are independent estimates, all bounces
included: a node's standard error is that of their mean, and only one pass's rays are kept. With one
table for all, noise of what nodes see was in no error: 5 of 100 nodes were beyond what was stated.
A tent over three by three nodes takes most noise; where it changes a node by more than its noise
explains, at the edge of a shadow, the node stays as it is.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects import UNCHANGED, VISIBLE_LEVELS
from catoptra_server.effects.scene.baked_light import find_grid_changes
from catoptra_server.render.trace.kernel.kernel_ray_caster import CommittedScene
from catoptra_server.render.trace.kernel.kernel_structs import (
    LIGHT_DIRECTIONAL,
    LIGHT_POINT,
    LIGHT_RECTANGLE,
    BakeJob,
    BakeLamp,
    GatherJob,
)
from catoptra_server.render.trace.kernel.library import KernelDevice, choose_instruction_set
from catoptra_server.render.trace.kernel.scene_arrays import (
    OwningStruct,
    hole_arrays,
    hole_textures,
    patch_structs,
)
from catoptra_server.render.trace.occlusion.baking import sobol_points
from catoptra_server.render.trace.occlusion.occlusion_cache import (
    LEAST_LIGHT,
    NodeLight,
    add_lights,
    find_ranges,
)
from catoptra_server.render.trace.occlusion.surface_grids import (
    MIN_NODE_DISTANCE_M,
    add_spare_grid,
    choose_layout,
    continue_grids,
    find_atlas_rows,
    frame_surfaces,
    place_nodes,
    smooth_grids,
)
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    OPEN_LIGHT,
    OcclusionMap,
    facet_irradiance,
    hemisphere_lights,
    light_of_bytes,
    shadow_casting_lights,
)
from catoptra_server.world.world_description import (
    DirectionalLight,
    LightProbes,
    PointLight,
    RectangleLight,
    Rgb,
    World,
)

RAYS_PER_PASS = 16
FIRST_PASSES = 4
"""Before the first picture: from fewer no error can be estimated that holds."""
FIRST_DETAIL = 0.25
"""Share of nodes and probes in the first picture."""
MAX_PASSES = 16
"""However large the errors are."""
MAX_NODES = 56_000
# Beside these, six nodes each; a metre apart at least.
MAX_PROBES = 1000
_MIN_PROBE_DISTANCE_M = 1.0
# A probe that sees more of backs stands where nothing moves: outside a round room a tenth.
_BACK_SHARE = 0.05
# Of the most grids: with all, small parts of furniture left walls a node a metre.
_GRID_SHARE = 0.2
_INSIDE_SHARE = 0.1
# Nodes along each side of the sky's two squares.
_SKY_SIDE = 64
# Of the brightest clouds, twice: the sun's disc, a texel of the sky here, is brighter.
_MAX_SKY = 4.0
_GOLDEN = 0.6180339887
_MAX_BOUNCES = 128
# Of the brightest node: what further bounces may add together, in the first pass and in others,
# which start from the mean of those before.
_REMAINDERS = 1e-6, 1e-3
_FINEST = 1e-5
# Standard errors that 99 of 100 nodes are within, where they are estimated from many passes.
_SIGMAS = 3.0
# Of few it is larger by the root of 1 + (5 / (passes - 1))^2: about Student's distribution.
_FEW_PASSES = 5.0
MAX_ERROR = 1.0
"""Grey levels that nobody misses, of 99 of 100 nodes: from there on no rays are added."""
# Directions of a probe's nodes, as of `HemisphereLight.faces`.
_FACES = np.kron(np.eye(3), np.array([[1.0], [-1.0]]))
_Float32s = npt.NDArray[np.float32]
_BakedLights = Sequence[DirectionalLight | PointLight | RectangleLight]


def sky_radiance(world: World, directions: Floats) -> Floats:
    """(n, 3) radiance of the sky along (n, 3) directions.

    Without a panorama an open facet has exactly the irradiance of the world's hemisphere lights.
    """
    if world.sky is not None:
        # A sun's disc is not sky: its light is that of the directional light.
        return np.minimum(world.sky.radiance(directions), _MAX_SKY)
    radiance = np.zeros(directions.shape)
    for light in hemisphere_lights(world.lights):
        # z points down. A facet sees the share (1 + cos tilt) / 2 of the upper half.
        up, down = np.asarray(light.up_irradiance), np.asarray(light.down_irradiance)
        radiance += np.where(directions[:, 2:] < 0.0, up, down)
    return radiance


def bake_light(
    scene: SceneMesh,
    world: World,
    passes: int,
    *,
    threads: int,
    detail: float = 1.0,
    instruction_set: str | None = None,
) -> NodeLight:
    """Light of a scene from a number of passes, two at least; errors as of `LightBake`."""
    bake = LightBake(scene, world, threads=threads, detail=detail, instruction_set=instruction_set)
    try:
        for _ in range(passes):
            bake.cast()
        return add_lights(bake.finish(), {})
    finally:
        bake.close()


def count_passes(light: NodeLight, passes: int) -> int:
    """Passes from which the stated error of light by fewer is `MAX_ERROR`, or all."""
    # Errors fall with the square root of the number of rays.
    needed = passes * min(light.stated_error / MAX_ERROR, 1e3) ** 2
    return min(max(2, math.ceil(needed)), MAX_PASSES)


class LightBake:
    """Rays from the nodes of a scene's grids, pass by pass, and the light gathered from them."""

    def __init__(
        self,
        scene: SceneMesh,
        world: World,
        *,
        threads: int,
        detail: float = 1.0,
        instruction_set: str | None = None,
    ) -> None:
        """Lay out the grids of a scene; the result is the same for any number of threads.

        Args:
            scene: Triangles.
            world: World whose lamps, sky and groups of lights count.
            threads: Threads.
            detail: Share of the most nodes and probes.
            instruction_set: Of the kernel; the best of this processor by default.

        Raises:
            KernelUnavailableError: The kernel's library is missing.
        """
        self._scene, self._world, self._is_coarse = scene, world, detail < 1.0
        self._device = KernelDevice(instruction_set or choose_instruction_set(), threads)
        self._owners: list[object] = []
        self._lamps: _BakedLights = (*shadow_casting_lights(world.lights), *world.area_lights)
        # Those of one kind, group and strength are known by their sum: 23 lamps took 96 MB.
        self._columns = [*dict.fromkeys(map(_find_strength, self._lamps))]
        self._frames, self._has_spare = add_spare_grid(
            scene, frame_surfaces(scene, threads=threads, share=_GRID_SHARE)
        )
        self._probes = _place_probes(scene, round(detail * MAX_PROBES))
        area_m2 = np.linalg.norm(np.cross(self._frames.side_x, self._frames.side_y), axis=-1).sum()
        most = round(detail * MAX_NODES)
        # With any smaller distance there are more.
        least_m = max(MIN_NODE_DISTANCE_M, math.sqrt(area_m2 / most))
        self._layout, self._is_node = choose_layout(
            self._frames, lambda layout: layout.grid >= 0, most, distance_m=least_m
        )
        self._nodes = place_nodes(self._frames, self._layout, self._is_node)
        self._albedo = _mean_albedo(scene)
        self._materials = self._find_materials()
        self.num_passes = 0
        count = len(self._nodes.patch) + 6 * math.prod(self._probes.faces.shape[:3])
        self._hits = np.zeros((count, RAYS_PER_PASS), dtype=np.int32)
        self._backs = np.zeros(count, dtype=np.int32)
        self._lamp_light = np.zeros((2, count, len(self._columns)), dtype=np.float32)
        self._sequence = _make_sequence(MAX_PASSES * RAYS_PER_PASS)
        self._job = self._make_job()
        self._sky = self._make_table()
        # Mean of the passes and the sum of their squared differences from it.
        self._estimates = {group: np.zeros((2, count, 3)) for group in ("", *world.light_groups)}

    def _make_job(self) -> BakeJob:
        """All of a pass that no pass changes."""
        scene, frames = self._scene, self._frames
        textures = hole_textures(scene) if scene.coverage is not None else None
        shines = scene.unlit if scene.emission is None else scene.unlit | scene.emission.any(axis=1)
        rows = scene.casts_shadows | shines
        self._loose = np.flatnonzero(rows & (frames.patch_of < 0))
        mesh = self._commit(rows, textures)
        has_same = bool((rows == scene.casts_shadows).all())
        casters = mesh if has_same else self._commit(scene.casts_shadows, textures)
        normals = scene.normals[rows]
        if scene.two_sided is not None:
            normals = normals * ~scene.two_sided[rows, None]
        lengths = np.linalg.norm(frames.side_x, axis=-1, keepdims=True)
        axis_x = np.concatenate((frames.side_x / lengths, np.roll(_FACES, 1, axis=1)))
        normal = np.concatenate((frames.normal, _FACES))
        axes = np.stack((axis_x, np.cross(normal, axis_x), normal), axis=1)
        places = np.repeat(self._probe_places(), 6, axis=0)
        grid = np.append(self._nodes.patch, len(frames.normal) + np.arange(len(places)) % 6)
        # Off all fractions of the sequence: rays along diagonals would end on the edges of rooms.
        turns = 2.0 * np.pi * (np.arange(256) + _GOLDEN) / 256
        # Within its group: rays do not depend on factors of groups.
        powers: dict[str, float] = {}
        for one in self._world.area_lights:
            powers[one.group] = max(powers.get(one.group, 1e-9), *one.intensity)
        lamps = (BakeLamp * max(1, len(self._lamps)))(
            *(_lamp_struct(lamp, scene.centre, powers.get(lamp.group, 1.0)) for lamp in self._lamps)
        )
        for struct, lamp in zip(lamps, self._lamps, strict=False):
            struct.column = self._columns.index(_find_strength(lamp))
        size = self._is_node.size
        arrays: dict[str, npt.NDArray[Any]] = {
            "positions": np.concatenate((self._nodes.positions, places)) - scene.centre,
            "grid": grid.astype(np.int32),
            "axes": axes.astype(np.float32),
            "normals": normals.astype(np.float32),
            "grid_of": frames.patch_of[rows],
            "slot_of": (size - 1 + np.cumsum(frames.patch_of[rows] < 0)).astype(np.int32),
            "turns": np.stack((cos(turns), sin(turns)), axis=-1).astype(np.float32),
            "backs": self._backs,
            "hits": self._hits,
            "light": self._lamp_light[1],
        }
        dark = np.zeros((3, *self._is_node.shape), dtype=np.uint16)
        patches = patch_structs(self._make_map(dark), scene.centre)
        arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        self._owners += [arrays, patches, lamps, textures]
        job = BakeJob(
            mesh=mesh.address,
            casters=casters.address,
            num_nodes=len(grid),
            first_probe=len(self._nodes.patch),
            width=self._is_node.shape[1],
            sky_slot=size + len(self._loose),
            sky_side=_SKY_SIDE,
            num_rays=RAYS_PER_PASS,
            num_lamps=len(self._lamps),
            num_columns=len(self._columns),
            **{name: array.ctypes.data for name, array in arrays.items()},
        )
        job.patches, job.lamps = ctypes.addressof(patches), ctypes.addressof(lamps)
        return job

    def _commit(self, rows: Bools, textures: OwningStruct | None) -> CommittedScene:
        shared = None if textures is None else textures.struct
        mesh = CommittedScene(
            self._device, hole_arrays(self._scene, self._scene.centre, shared, rows)
        )
        self._owners.append(mesh)
        return mesh

    @np.errstate(under="ignore")  # an underflow is black
    def cast(self) -> None:
        """Cast the rays of one more pass, and gather its light."""
        # Sobol's points repeat beyond 256: each pass is shifted otherwise.
        first = self.num_passes % MAX_PASSES * RAYS_PER_PASS
        self._job.pass_number = self.num_passes
        self._job.sequence = self._sequence[first:].ctypes.data
        self._lamp_light[1] = 0.0
        self._device.bake(self._job)
        if not self.num_passes:
            # Exact lamps are in the first pass alone.
            self._lamp_light[0] = self._lamp_light[1]
        self.num_passes += 1
        source = self._find_sources(self._is_inside())
        for group, (mean, squares) in self._estimates.items():
            light = self._solve(group, source, mean)
            difference = light - mean
            mean += difference / self.num_passes
            squares += difference * (light - mean)

    def _is_inside(self) -> Bools:
        """(k,) nodes inside solids, or of no surface."""
        backs = self._backs[: len(self._nodes.patch)]
        is_inside = backs > _INSIDE_SHARE * self.num_passes * RAYS_PER_PASS
        if self._has_spare:
            is_inside |= self._nodes.patch == len(self._frames.origin) - 1
        return is_inside

    def _solve(self, group: str, source: npt.NDArray[np.intp], mean: Floats) -> _Float32s:
        """(n, 3) irradiance of nodes and probes after all bounces, by the rays of the last pass.

        Args:
            group: Lamps that shine alone; empty: what is in no group.
            source: As of `_find_sources`.
            mean: Irradiance by earlier passes, from which the bounces start.
        """
        shine = np.float32(not group)  # of sky and luminous surfaces
        lit, reflected = self._find_lamp_light(group)
        albedo, emission = self._materials
        table, count, size = shine * self._sky, len(source), self._is_node.size
        texel = np.flatnonzero(self._is_node.reshape(-1))
        is_first = self.num_passes == 1
        light = lit.copy() if is_first else mean.astype(np.float32)
        change, means = np.zeros_like(light), np.zeros_like(light)
        ratio, remainder = np.full(3, np.float32(0.99)), _REMAINDERS[not is_first]
        job = GatherJob(
            num_nodes=len(means),
            num_rays=RAYS_PER_PASS,
            hits=self._hits.ctypes.data,
            radiance=table.ctypes.data,
            means=means.ctypes.data,
        )
        for _ in range(_MAX_BOUNCES):
            radiance = albedo * (light + reflected)[:count] + shine * emission
            table[texel] = np.where(source[:, None] >= 0, radiance[source], np.float32(-1.0))
            at_nodes = np.average(light[:count], axis=0)
            table[size : size + len(self._loose)] = self._triangle_radiance(at_nodes, shine)
            self._device.gather(job)
            gathered = means + lit
            before, change = np.abs(change).max(axis=0, initial=0.0), gathered - light
            light = gathered
            largest = np.abs(change).max(axis=0, initial=0.0)
            top = light.max(axis=0, initial=0.0)
            # Nothing is known of it before the second bounce, nor of changes near float32's steps.
            is_known = (before > 0.0) & (largest > _FINEST * top)
            latest = np.minimum(largest / np.where(is_known, before, 1.0), 0.99)
            ratio = np.where(is_known, latest, ratio)
            if (largest * ratio <= remainder * (1.0 - ratio) * top).all():
                break
        # What is left falls by one factor a bounce.
        return np.asarray(light + change * ratio / (1.0 - ratio), dtype=np.float32)

    def _find_lamp_light(self, group: str) -> tuple[_Float32s, _Float32s]:
        """(n, 3) irradiance by area lights in the last pass, and by other lamps."""
        light = np.zeros((2, len(self._hits), 3), dtype=np.float32)
        for number, (is_area, of_group, strength) in enumerate(self._columns):
            if of_group == group:
                brought = self._lamp_light[int(is_area), :, number, None]
                light[1 - is_area] += brought * np.asarray(strength, dtype=np.float32)
        return light[0], light[1]

    def _find_materials(self) -> tuple[_Float32s, _Float32s]:
        """(k, 3) albedo and emission at nodes: those of one triangle of each surface."""
        scene, frames = self._scene, self._frames
        triangle = np.zeros(len(frames.origin), dtype=np.intp)
        inside = np.flatnonzero(frames.patch_of >= 0)
        # The last of each: which one does not matter on a flat surface of one material.
        triangle[frames.patch_of[inside]] = inside
        albedo = self._albedo[triangle]
        emission = np.zeros_like(albedo) if scene.emission is None else scene.emission[triangle]
        at_nodes = np.stack((albedo, emission))[:, self._nodes.patch].astype(np.float32)
        return at_nodes[0], at_nodes[1]

    def _make_table(self) -> _Float32s:
        """(slots, 3) radiance, that of the sky written."""
        half = (np.arange(_SKY_SIDE) + 0.5) / _SKY_SIDE * 2.0 - 1.0
        row, column = np.meshgrid(half, half, indexing="ij")
        # Twin: sky_texel in src/bake.c.
        x, y = 0.5 * (column + row), 0.5 * (column - row)
        z = 1.0 - np.abs(x) - np.abs(y)
        sky = np.concatenate([np.stack((x, y, sign * z), axis=-1) for sign in (-1.0, 1.0)])
        directions = sky.reshape(-1, 3) / np.linalg.norm(sky.reshape(-1, 3), axis=-1, keepdims=True)
        table = np.zeros((self._job.sky_slot + len(directions), 3), dtype=np.float32)
        table[self._job.sky_slot :] = sky_radiance(self._world, directions)
        return table

    def _triangle_radiance(self, irradiance: _Float32s, shine: np.float32) -> Floats:
        """(t, 3) radiance of triangles without a grid, by a mean irradiance."""
        scene, rows = self._scene, self._loose
        radiance = self._albedo[rows] * np.where(scene.unlit[rows, None], shine, irradiance)
        return radiance if scene.emission is None else radiance + shine * scene.emission[rows]

    def _find_sources(self, is_inside: Bools) -> npt.NDArray[np.intp]:
        """(k,) node whose radiance each has: inside a solid, that of one beside it on its grid.

        -1 on grids of which all is inside: rays meet them along edges, where two surfaces touch.
        """
        known = self._is_node.copy()
        known[self._is_node] = ~is_inside
        grid = self._layout.grid
        own = np.arange(grid.size).reshape(grid.shape)
        source = np.where(known, own, -1)
        for axis in (1, 0):
            for step in (1, -1):
                way = (slice(None),) * axis + (slice(None, None, step),)
                sign = step * np.where(source >= 0, source, -step * grid.size)[way]
                nearest = (step * np.maximum.accumulate(sign, axis=axis))[way]
                nearest = np.clip(nearest, 0, grid.size - 1)
                is_found = (source < 0) & (grid.reshape(-1)[nearest] == grid)
                is_found &= source.reshape(-1)[nearest] >= 0
                source = np.where(is_found, nearest, source)
        number = np.cumsum(self._is_node) - 1
        chosen = source[self._is_node]
        return np.where(chosen >= 0, number[chosen], -1)

    def _finish_probes(self, means: Floats) -> LightProbes:
        """Probes of (6 p, 3) means; those that see backs have the light of the nearest other."""
        faces = means.reshape(-1, 6, 3).copy()
        backs = self._backs[len(self._nodes.patch) :].reshape(-1, 6).sum(axis=-1)
        is_known = backs <= _BACK_SHARE * 6 * self.num_passes * RAYS_PER_PASS
        if is_known.any():
            places = self._probe_places()
            apart = places[~is_known][:, None] - places[is_known]
            nearest = np.square(apart).sum(axis=-1).argmin(axis=1)
            faces[~is_known] = faces[is_known][nearest]
        shaped = faces.reshape(self._probes.faces.shape)
        return replace(self._probes, faces=shaped.astype(np.float32))

    def _probe_places(self) -> Floats:
        """(p, 3) places of the probes, world frame."""
        at = np.indices(self._probes.faces.shape[:3]).reshape(3, -1).T
        return np.asarray(self._probes.first + at * self._probes.step)

    @np.errstate(under="ignore")  # an underflow is black
    def finish(self) -> dict[str, NodeLight]:
        """Light of the scene by groups of lamps, the empty one for all the rest: two passes at
        least."""
        return {group: self._filter(*estimate) for group, estimate in self._estimates.items()}

    def _filter(self, light: Floats, squares: Floats) -> NodeLight:
        """Filter the estimates of nodes, state their errors, and make the map."""
        layout, count = self._layout, len(self._nodes.patch)
        probes, at_nodes, is_inside = (
            self._finish_probes(light[count:]),
            light[:count],
            self._is_inside(),
        )
        shape = (*self._is_node.shape, 3)
        mean, variance = np.zeros(shape), np.zeros(shape)
        mean[self._is_node] = at_nodes
        others = self.num_passes - 1
        few = 1.0 + (_FEW_PASSES / others) ** 2
        variance[self._is_node] = few / (others * self.num_passes) * squares[:count]
        known = ~self._is_node
        known[self._is_node] = ~is_inside
        values, error = np.zeros(shape), np.zeros(shape)
        is_wide, is_high = layout.is_filtered
        less = np.append(np.where(is_wide, 0.375, 1.0) * np.where(is_high, 0.375, 1.0), 1.0)
        less = np.sqrt(less)[layout.grid]
        for channel in range(3):
            raw, spread = (
                continue_grids(one[..., channel], known, layout.grid, largest=np.inf, otherwise=0.0)
                for one in (mean, variance)
            )
            # Of few passes each: better known together. A continued value has two nodes' errors.
            spread = smooth_grids(np.where(known, spread, 9.0 * spread), layout)
            smooth = smooth_grids(raw, layout)
            change, noise = np.abs(smooth - raw), _SIGMAS * np.sqrt(spread)
            is_kept = change > noise
            values[..., channel] = np.where(is_kept, raw, smooth)
            error[..., channel] = np.where(is_kept, noise, noise * less + change)
        mean_light = np.average(at_nodes[~is_inside], axis=0) if len(at_nodes) else 0.0
        if self._has_spare:
            values[layout.grid == len(self._frames.origin) - 1] = mean_light
        if self._is_coarse:
            self._light_unseen(values, known, probes)
        brightest = np.maximum(values[self._is_node].max(axis=0, initial=0.0), LEAST_LIGHT)
        values[~self._is_node] = brightest
        error += 0.5 * brightest / OPEN_LIGHT
        self._level_grids(values, error)
        texels = np.rint(np.moveaxis(values / brightest, -1, 0) * OPEN_LIGHT).astype(np.uint16)
        sky = self._mean_sky(at_nodes, is_inside)
        texels = np.ascontiguousarray(texels)
        # Of half precision, upward.
        stated = (1.001 * error + 1e-7).astype(np.float16)
        return NodeLight(self._make_map(texels), brightest, sky, stated, probes)

    def _light_unseen(self, values: Floats, known: Bools, probes: LightProbes) -> None:
        """Light grids all of whose nodes are inside solids, as of edges, by the probes about them.

        With few nodes these are surfaces that are seen, which the finished bake has nodes on. No
        error is stated: no ray makes one smaller.
        """
        frames, grid = self._frames, self._layout.grid
        is_unseen = np.ones(len(frames.origin) + 1, dtype=bool)
        is_unseen[grid[known]] = False
        is_unseen[len(frames.origin) - self._has_spare :] = False
        light = np.zeros((len(is_unseen), 3))
        for number in np.flatnonzero(is_unseen):
            centre = frames.origin[number] + 0.5 * (frames.side_x[number] + frames.side_y[number])
            sky = probes.find_light(centre)
            light[number] = facet_irradiance((sky,), frames.normal[number][None])[0]
        at = is_unseen[grid]
        values[at] = light[grid[at]]

    def _level_grids(self, values: Floats, error: Floats) -> None:
        """Give the nodes of a grid their mean where nobody misses the rest."""
        grid = self._layout.grid
        ranges = find_ranges(values, error, self._layout.bounds())
        # Errors count, too: nodes that seem to agree may not.
        is_level = np.append(find_grid_changes(ranges, UNCHANGED) <= VISIBLE_LEVELS, False)
        at = is_level[grid]
        mean = ranges[1, grid[at]]
        error[at] += np.abs(values[at] - mean)
        values[at] = mean

    def _mean_sky(self, irradiance: Floats, is_inside: Bools) -> Floats:
        """(2, 3) mean light on facets that face up and down; that of all nodes where none do."""
        height = self._frames.normal[self._nodes.patch, 2]
        sides = (irradiance[is_side & ~is_inside] for is_side in (height < -0.5, height > 0.5))
        chosen = (side if len(side) else irradiance for side in sides)
        return np.array([one.mean(axis=0) if len(one) else np.zeros(3) for one in chosen])

    def _make_map(self, texels: npt.NDArray[np.uint16]) -> OcclusionMap:
        bounds = self._layout.bounds()
        columns, rows = find_atlas_rows(self._frames, bounds)
        if self._has_spare:
            # One node for every point.
            columns[-1], rows[-1] = (0.0, 0.0, 0.0, bounds[-1, 0]), (0.0, 0.0, 0.0, bounds[-1, 1])
        return OcclusionMap(self._frames.patch_of, columns, rows, bounds, texels)

    def close(self) -> None:
        """Free the rays and end the threads."""
        self._owners.clear()
        self._device.close()


def _place_probes(scene: SceneMesh, max_probes: int) -> LightProbes:
    """Dark probes all over a scene's box, and a metre above, where robots stand on it."""
    first = scene.box_min - np.array([0.0, 0.0, 1.0])
    size = np.maximum(scene.box_max - first, 1e-3)
    distance_m = _MIN_PROBE_DISTANCE_M
    while True:
        counts = np.ceil(size / distance_m).astype(np.intp)
        if math.prod(counts.tolist()) <= max_probes:
            break
        distance_m *= 1.05
    step = size / counts
    return LightProbes(first + 0.5 * step, step, np.zeros((*counts, 6, 3), np.float32))


def _make_sequence(count: int) -> _Float32s:
    """(count, 3) Sobol's points: squared sine of the tilt, cosine and sine of the azimuth."""
    across, around = sobol_points(count)
    azimuth = 2.0 * np.pi * around
    return np.stack((across, cos(azimuth), sin(azimuth)), axis=-1).astype(np.float32)


def _mean_albedo(scene: SceneMesh) -> Floats:
    """(n, 3) albedo of triangles, times the mean of their textures."""
    means = []
    for image in scene.textures:
        counts = np.stack([np.bincount(image[..., i].reshape(-1), minlength=256) for i in range(3)])
        means.append((counts * light_of_bytes()).sum(axis=1) / math.prod(image.shape[:2]))
    albedo: Floats = scene.albedo * np.array([*means, np.ones(3)])[scene.texture_index]
    return albedo


def _find_strength(lamp: DirectionalLight | PointLight | RectangleLight) -> tuple[bool, str, Rgb]:
    """Whether a lamp is an area, its group, and the light of one unit of its irradiance."""
    strength = lamp.irradiance if isinstance(lamp, DirectionalLight) else lamp.intensity
    return isinstance(lamp, RectangleLight), lamp.group, strength


def _lamp_struct(
    lamp: DirectionalLight | PointLight | RectangleLight, centre: Floats, brightest: float
) -> BakeLamp:
    if isinstance(lamp, DirectionalLight):
        x, y, z = lamp.direction
        return BakeLamp(kind=LIGHT_DIRECTIONAL, normal=(-x, -y, -z))
    place = np.asarray(lamp.position_m) - centre
    if isinstance(lamp, PointLight):
        return BakeLamp(kind=LIGHT_POINT, corner=tuple(place))
    normal = np.asarray(lamp.direction)
    horizontal = np.cross(np.array([0.0, 0.0, 1.0]), normal)
    is_level = float(np.linalg.norm(horizontal)) < 1e-3
    axis_x = np.array([1.0, 0.0, 0.0]) if is_level else horizontal
    axis_x = axis_x - (axis_x * normal).sum() * normal
    axis_x /= np.linalg.norm(axis_x)
    side_x = lamp.size_m[0] * axis_x
    side_y = lamp.size_m[1] * np.cross(normal, axis_x)
    return BakeLamp(
        kind=LIGHT_RECTANGLE,
        area=lamp.size_m[0] * lamp.size_m[1],
        power=max(lamp.intensity) / brightest,
        corner=tuple(place - 0.5 * (side_x + side_y)),
        side_x=tuple(side_x),
        side_y=tuple(side_y),
        normal=tuple(normal),
    )
