"""The reference engine: every valid ray of a table on its own, in batches on a thread pool.

Bytes depend on scene and rays alone, neither on batches nor on threads. A long exposure is the mean
of sharp frames; effects are drawn everywhere and measured against a second frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import EffectChange, Threshold
from catoptra_server.effects.kernels.grey_levels import measure_change
from catoptra_server.render.image_changer import NumpyImageChanger, encode_srgb
from catoptra_server.render.renderer import Image, LinearImage, advance, sample_shutter
from catoptra_server.render.trace.ray_table import (
    BLOCK_RAYS,
    TILE_PX,
    Element,
    Float32s,
    RayTable,
)
from catoptra_server.render.trace.reference.meshes import (
    PlacedMesh,
    TracedMesh,
    WorldRays,
    find_first_hits,
    interpolate_poses,
    trace_object,
    trace_scene,
)
from catoptra_server.render.trace.reference.pixels import (
    Lighting,
    count_agreement,
    hit_numbers,
    label_pixels,
    shade_hits,
    shade_layers,
)
from catoptra_server.render.trace.trace_engine import (
    NOTHING,
    LabelRequest,
    MovingExposure,
    PixelLabels,
    RayHits,
    TracedExposure,
    TracedFrame,
    TraceRequest,
    assemble_tiles,
    camera_states,
    find_ego_body,
    first_state,
    invert_ranges,
)
from catoptra_server.world.objects import CameraState, DynamicObject, ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import hemisphere_lights, object_lights
from catoptra_server.world.world_description import Light, World, srgb_from_linear

# Rays of a batch: arrays of three numbers a ray stay in the cache; 2^16 take 2.5 times as long.
_RAYS_PER_BATCH = 2**14


class ReferenceEngine:
    """A scene, searched and shaded in float64."""

    def __init__(
        self, scene: SceneMesh, world: World, *, threads: int, scene_lights: tuple[Light, ...]
    ) -> None:
        """Commit a scene.

        Args:
            scene: Triangles of the static scene.
            world: Lights of dynamic objects, and background.
            threads: Threads of the pool.
            scene_lights: Lights of the static scene.
        """
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="trace")
        self._world = world
        self._centre = scene.centre
        self._scene = trace_scene(scene, self._centre, scene_lights)
        self._is_baked = scene.baked_light is not None
        self._objects: dict[ObjectMesh, TracedMesh] = {}
        self.image_changer = NumpyImageChanger()
        self.description = "reference (NumPy float64)"

    @property
    def num_object_meshes(self) -> int:
        """Number of object meshes committed so far."""
        return len(self._objects)

    def repaint(self, scene: SceneMesh, world: World) -> None:
        """Show the same triangles in other looks and light; as of `KernelEngine`."""
        self._world, self._scene = world, trace_scene(scene, self._centre, world.lights)
        self._objects.clear()

    def prepare(self, rays: RayTable) -> _ReferenceRays:
        """Keep the rays of a camera."""
        return _ReferenceRays(rays, self._make_frame, self._pool)

    def _make_frame(self, exposure: TracedExposure) -> _Frame:
        """Meshes and poses of an exposure; meshes are committed at their first use."""
        states = camera_states(exposure)
        objects = (
            (
                self._find_object(copies[0]),
                tuple(self._relative(copy.world_from_object) for copy in copies),
            )
            for copies in zip(*(state.objects for state in states), strict=True)
        )
        return _Frame(
            tuple(self._relative(state.world_from_mirror) for state in states),
            ((self._find_scene(states[0]), (Pose.identity(),)), *objects),
            Lighting(
                self._centre,
                self._world.background,
                states[0].has_shadows,
                states[0].has_gloss,
                states[0].fog,
                self._world.sky if states[0].has_sky else None,
                states[0].objects if states[0].has_baked_light and self._is_baked else (),
                hemisphere_lights(object_lights(self._world)),
            ),
        )

    def _find_scene(self, state: CameraState) -> TracedMesh:
        """The static scene, with one light on each grid where a state has no more."""
        occlusion = self._scene.occlusion
        if state.has_baked_light or occlusion is None or not self._is_baked:
            return self._scene
        return replace(self._scene, occlusion=occlusion.average())

    def _relative(self, pose: Pose) -> Pose:
        """Pose relative to the scene's centre. Both may be far from the world's origin."""
        return Pose(pose.rotation, pose.translation - self._centre)

    def _find_object(self, placed: DynamicObject) -> TracedMesh:
        """An object's mesh with all lights: objects move towards lights that the scene culls."""
        mesh = placed.mesh
        if mesh not in self._objects:
            self._objects[mesh] = trace_object(mesh, ())
        return replace(self._objects[mesh], lights=object_lights(self._world, placed.centre))

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """An exposure, with its meshes. All poses relative to the scene's centre."""

    mirror_poses: tuple[Pose, ...]
    """World from mirror, one of each state."""
    meshes: tuple[tuple[TracedMesh, tuple[Pose, ...]], ...]
    """Static scene and dynamic objects, with their poses."""
    lighting: Lighting
    """Background, shadows and fog."""

    def place(self, batch: _RayBatch) -> tuple[tuple[PlacedMesh, ...], WorldRays]:
        """Meshes at the times of a batch, and its rays."""
        camera = interpolate_poses(self.mirror_poses, batch.times)
        directions = camera.vectors(batch.directions)
        # Between two poses a rotation's entries shorten: distances are metres of unit directions.
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        steps = np.stack([camera.vectors(batch.steps[:, i]) for i in range(2)], axis=1)
        rays = WorldRays(camera.points(batch.origins), directions, steps)
        meshes = tuple(
            PlacedMesh(mesh, interpolate_poses(poses, batch.times)) for mesh, poses in self.meshes
        )
        return meshes, rays

    def shade(self, batch: _RayBatch) -> Floats:
        """(n, 3) linear radiance of a batch."""
        meshes, rays = self.place(batch)
        fog = self.lighting.fog
        if self.meshes[0][0].blended is not None:
            return shade_layers(meshes, rays, self.lighting)
        hits = find_first_hits(meshes, rays)
        radiance = shade_hits(meshes, rays, hits, self.lighting)
        return radiance if fog is None else fog.mix(radiance, hits.distance)


class _ReferenceRays:
    """The rays of one camera."""

    def __init__(
        self,
        table: RayTable,
        make_frame: Callable[[TracedExposure], _Frame],
        pool: ThreadPoolExecutor,
    ) -> None:
        """Keep the table."""
        self._table = table
        self._make_frame = make_frame
        self._pool = pool
        self.memory_bytes = table.memory_bytes
        """Size of the rays."""

    def render(self, exposure: TracedExposure, request: TraceRequest) -> TracedFrame:
        """A frame and all other outputs that are wanted; effects are drawn everywhere."""
        image = self.render_linear(exposure) if request.is_linear else self.render_srgb(exposure)
        # Changes and ranges are of the middle of the exposure, as the kernel's.
        sharp = exposure if isinstance(exposure, MovingExposure) else advance(exposure, 0.0)
        changes = {}
        measured = {name for name, one in request.thresholds.items() if one.is_measured}
        if "Shadows" in measured and first_state(exposure).has_shadows:
            changes["Shadows"] = self._measure_shadows(exposure, sharp, request.thresholds)
        if "Fog" in measured and first_state(exposure).fog is not None:
            changes["Fog"] = self._measure(sharp, request.thresholds["Fog"], fog=None)
        if "Gloss" in measured and first_state(exposure).has_gloss:
            changes["Gloss"] = self._measure(sharp, request.thresholds["Gloss"], has_gloss=False)
        if "BakedLight" in measured and first_state(exposure).has_baked_light:
            threshold = request.thresholds["BakedLight"]
            changes["BakedLight"] = self._measure(sharp, threshold, has_baked_light=False)
        if "SkyRadiance" in measured and first_state(exposure).has_sky:
            changes["SkyRadiance"] = self._measure(
                sharp, request.thresholds["SkyRadiance"], has_sky=False
            )
        if "SelfView" in measured and (number := find_ego_body(exposure)):
            threshold = request.thresholds["SelfView"]
            changes["SelfView"] = self._measure(sharp, threshold, unseen=number)
        ranges = self._measure_ranges(sharp) if request.has_ranges else None
        return TracedFrame(image, changes, ranges)

    def _measure_shadows(
        self,
        exposure: TracedExposure,
        sharp: TracedExposure,
        thresholds: Mapping[str, Threshold],
    ) -> EffectChange:
        """Change by shadows; of all instants where the sharp frame shows none."""
        threshold = thresholds["Shadows"]
        change = self._measure(sharp, threshold, has_shadows=False)
        if isinstance(exposure, MovingExposure) or exposure.shutter is None:
            return change
        if not threshold.covers(change):
            return change
        instants = sample_shutter(exposure, self._table.height_px)
        changes = [
            change,
            *(self._measure(state, threshold, has_shadows=False) for state, _ in instants),
        ]
        # Different pixels may change at different instants.
        share = min(1.0, sum(one.visible_share for one in changes))
        return EffectChange(max(one.largest for one in changes), share)

    def _measure(
        self, exposure: TracedExposure, threshold: Threshold, *, unseen: int = 0, **without: Any
    ) -> EffectChange:
        """Difference of the picture from frames without an effect, or an object by its number."""
        states = tuple(
            replace(
                state,
                objects=tuple(
                    one for number, one in enumerate(state.objects, 1) if number != unseen
                ),
                **without,
            )
            for state in camera_states(exposure)
        )
        plain = states[0] if len(states) == 1 else MovingExposure(states)
        light, without_it = (self._render(each, mean_pixels, 0.0) for each in (exposure, plain))
        return measure_change(light, without_it, threshold)

    def _measure_ranges(self, exposure: TracedExposure) -> Float32s:
        """(h, w) inverses of the pixels' mean inverse ranges, metres."""
        inverse = 1.0 / self.find_hits(exposure).range_m.astype(np.float64)
        tiles = mean_pixels(inverse[..., None], self._table.samples)
        inverse_range = assemble_tiles(self._table, tiles, fill=0.0)[..., 0]
        return invert_ranges(inverse_range.astype(np.float32))

    def render_srgb(self, exposure: TracedExposure) -> Image:
        """(h, w, 3) sRGB, read-only; black off the mirror."""
        if isinstance(exposure, CameraState) and exposure.shutter is not None:
            image = encode_srgb(self.render_linear(exposure))
        else:
            image = self._render(exposure, encode_pixels, np.uint8(0))
        # Other threads encode a frame while the next one is rendered.
        image.setflags(write=False)
        return image

    def render_linear(self, exposure: TracedExposure) -> LinearImage:
        """(h, w, 3) linear light; zero off the mirror. Light beyond white is kept."""
        if isinstance(exposure, MovingExposure):
            return self._render(exposure, mean_pixels, 0.0).astype(np.float32)
        # A long exposure is the mean of sharp frames.
        light = np.zeros((self._table.height_px, self._table.width_px, 3))
        for sharp_state, weights in sample_shutter(exposure, self._table.height_px):
            light += self._render(sharp_state, mean_pixels, 0.0) * weights[:, None, None]
        return light.astype(np.float32)

    def _render(
        self,
        exposure: TracedExposure,
        develop: Callable[[Floats, int], npt.NDArray[Element]],
        black: Element | float,
    ) -> npt.NDArray[Element]:
        """(h, w, 3) image, by the (t, 4, 4, 3) pixels of (t, samples^2, 16, 3) radiance."""
        table, frame = self._table, self._make_frame(exposure)
        tiles = np.full((len(table.tiles), TILE_PX, TILE_PX, 3), black)

        def render(batch: _RayBatch) -> None:
            part = tiles[batch.tiles]
            # Rays that do not see the mirror are black.
            radiance = np.zeros((len(part), table.samples**2, BLOCK_RAYS, 3))
            radiance.reshape(-1, 3)[batch.rays] = frame.shade(batch)
            part[:] = develop(radiance, table.samples)

        self._for_all_batches(render)
        return assemble_tiles(table, tiles, fill=black)

    def find_hits(self, exposure: TracedExposure) -> RayHits:
        """First hit of each ray."""
        frame, shape = self._make_frame(exposure), (*self._table.valid.shape, BLOCK_RAYS)
        nothing = np.full(shape, NOTHING, dtype=np.int32)
        found = RayHits(np.full(shape, np.inf, dtype=np.float32), nothing, nothing.copy())

        def trace(batch: _RayBatch) -> None:
            hits = find_first_hits(*frame.place(batch))
            found.range_m[batch.tiles].reshape(-1)[batch.rays] = hits.distance
            found.triangle[batch.tiles].reshape(-1)[batch.rays] = hits.triangle
            found.object[batch.tiles].reshape(-1)[batch.rays] = hits.object

        self._for_all_batches(trace)
        return found

    def label_pixels(self, exposure: TracedExposure, request: LabelRequest) -> PixelLabels:
        """Labels without an image; the agreement is of these rays."""
        static, _ = self._make_frame(exposure).meshes[0]
        centres = _ReferenceRays(request.centres, self._make_frame, self._pool)
        hits = centres.find_hits(exposure)
        needed = {*request.channels, "ids"}
        table, tables = request.centres, request.tables
        found = label_pixels(table, hits, exposure, static.facets.normals, tables, needed)
        if "agreement" in request.channels:
            numbers = hit_numbers(self.find_hits(exposure), tables)
            found |= count_agreement(self._table, numbers, found["ids"])
        return {name: found[name] for name in found if name in request.channels}

    def _for_all_batches(self, work: Callable[[_RayBatch], None]) -> None:
        """Work on all batches; no two write the same tiles, so the threads share no element."""

        def work_on(tiles: slice) -> None:
            work(_read_batch(self._table, tiles))

        step = max(1, _RAYS_PER_BATCH // (BLOCK_RAYS * self._table.samples**2))
        batches = [slice(n, n + step) for n in range(0, len(self._table.tiles), step)]
        # list() waits for all batches and raises the first error of any. NumPy releases the GIL.
        list(self._pool.map(work_on, batches))

    def close(self) -> None:
        """Do nothing: threads and scene belong to the engine."""


@dataclass(frozen=True, slots=True, eq=False)
class _RayBatch:
    """The valid rays of some tiles, mirror frame."""

    tiles: slice
    """Tiles in the table."""
    rays: npt.NDArray[np.intp]
    """(n,) flat indices of the valid rays in (tiles, samples^2, 16)."""
    directions: Floats
    """(n, 3) unit."""
    origins: Floats
    """(n, 3) metres."""
    steps: Floats
    """(n, 2, 3) from a direction to its neighbours to the right and below; one mean step each
    for the rays of a block."""
    times: Floats | None
    """(n,) times within the exposure, if the table has times."""


def _read_batch(table: RayTable, tiles: slice) -> _RayBatch:
    """The valid rays of some tiles."""
    is_valid = (table.valid[tiles, :, None] >> np.arange(BLOCK_RAYS)) & 1
    rays = np.flatnonzero(is_valid)
    directions = _select_vectors(table.directions[tiles], rays)
    origins = None if table.origins is None else _select_vectors(table.origins[tiles], rays)
    times = None if table.times is None else table.times[tiles].reshape(-1)[rays]
    return _RayBatch(
        tiles,
        rays,
        # Unit in float32 only.
        directions / np.linalg.norm(directions, axis=-1, keepdims=True),
        np.zeros_like(directions) if origins is None else origins,
        _mean_steps(table.directions[tiles], is_valid)[rays // BLOCK_RAYS],
        None if times is None else times.astype(np.float64),
    )


def _select_vectors(blocks: npt.NDArray[np.float32], rays: npt.NDArray[np.intp]) -> Floats:
    """(n, 3) vectors of some rays in (t, samples^2, 3, 16) blocks."""
    return blocks.swapaxes(-1, -2).reshape(-1, 3)[rays].astype(np.float64)


def _mean_steps(directions: npt.NDArray[np.float32], is_valid: npt.NDArray[np.integer]) -> Floats:
    """(blocks, 2, 3) mean steps to the right and down between valid rays; zero where are none.

    Args:
        directions: (t, samples^2, 3, 16).
        is_valid: (t, samples^2, 16) of zeros and ones.
    """
    grid = directions.astype(np.float64).reshape(-1, 3, TILE_PX, TILE_PX)
    valid = is_valid.reshape(-1, 1, TILE_PX, TILE_PX).astype(np.float64)
    steps = []
    for axis in (3, 2):
        before = [slice(None)] * 4
        after = [slice(None)] * 4
        before[axis], after[axis] = slice(0, -1), slice(1, None)
        pairs = valid[tuple(before)] * valid[tuple(after)]
        total = ((grid[tuple(after)] - grid[tuple(before)]) * pairs).sum(axis=(2, 3))
        steps.append(total / np.maximum(pairs.sum(axis=(2, 3)), 1.0))
    return np.stack(steps, axis=1)


def mean_pixels(values: Floats, samples: int) -> Floats:
    """(t, 4, 4, k) means over the samples of each pixel, of (t, samples^2, 16, k) rays."""
    depth = values.shape[-1]
    blocks = values.reshape(-1, samples, samples, TILE_PX, TILE_PX, depth)
    # Axes: tile, block row, ray row, block column, ray column; rows of the grid are both together.
    grid = blocks.swapaxes(2, 3).reshape(-1, TILE_PX, samples, TILE_PX, samples, depth)
    means: Floats = grid.mean(axis=(2, 4))
    return means


def encode_pixels(radiance: Floats, samples: int) -> npt.NDArray[np.uint8]:
    """(t, 4, 4, 3) sRGB of the means of (t, samples^2, 16, 3) rays, which a sensor clips."""
    means = mean_pixels(radiance, samples)
    return np.rint(255.0 * srgb_from_linear(means)).astype(np.uint8)
