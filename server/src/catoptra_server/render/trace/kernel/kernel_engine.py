"""The native engine: a scene on a kernel device, and the rays of cameras.

A frame is one call, from the rays and the camera's pose to pixels, without the interpreter and on
the kernel's own threads. What a frame computes, and in which file, is in README.md.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_server.effects import EffectChange, Threshold
from catoptra_server.render.image_changer import srgb_table
from catoptra_server.render.renderer import NO_THRESHOLDS, Image, LinearImage
from catoptra_server.render.trace.kernel.exposure_arrays import (
    CentreMatch,
    ObjectTable,
    change_limits,
    exposure_arrays,
    flow_arrays,
    frame_origin,
    label_arrays,
    match_centres,
    ray_table_struct,
    read_change,
)
from catoptra_server.render.trace.kernel.kernel_ray_caster import CommittedScene
from catoptra_server.render.trace.kernel.kernel_structs import (
    OUTPUT_FLOW,
    OUTPUT_HITS,
    OUTPUT_LABELS,
    OUTPUT_LINEAR,
    OUTPUT_SRGB,
    FrameCounts,
    SceneStruct,
)
from catoptra_server.render.trace.kernel.library import (
    KernelDevice,
    KernelError,
    choose_instruction_set,
)
from catoptra_server.render.trace.kernel.scene_arrays import (
    OwningStruct,
    caster_arrays,
    encoded_table,
    find_flat_surfaces,
    hemisphere_struct,
    light_array,
    occlusion_struct,
    radiance_table,
    scene_arrays,
    surfaces_struct,
    texture_array,
)
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, Float32s, RayTable
from catoptra_server.render.trace.trace_engine import (
    FlowTables,
    LabelRequest,
    PixelLabels,
    RayHits,
    TracedExposure,
    TracedFrame,
    TraceRequest,
    camera_states,
    find_ego_body,
    first_state,
    invert_ranges,
)
from catoptra_server.runtime.memory import release_freed_memory
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    OcclusionMap,
    are_lit_alike,
    hemisphere_lights,
    object_lights,
)
from catoptra_server.world.world_description import Light, World

if TYPE_CHECKING:
    from catoptra_server.effects.bounds.light_loss import ObjectRadiances
    from catoptra_server.render.trace.kernel.image import KernelImageChanger

# Fewer rays take less time than proofs of what fills parts of the image, in all bundled worlds:
# 0.08 instead of 0.35 ms at 16 px in the field.
MIN_PROVEN_RAYS = 2**14
# Bits of `ended_measures` of the measures that an effect's change follows from.
_ENDED_BY = {"Shadows": 1, "BakedLight": 2, "SelfView": 1 | 4}


class KernelRays:
    """The rays of one camera on a kernel device."""

    def __init__(self, table: RayTable, device: KernelDevice, engine: KernelEngine) -> None:
        """Prepare the rays; the kernel reads the table's own arrays."""
        self._table = table
        self._device = device
        self._engine = engine
        self._num_pixels = table.width_px * table.height_px
        self._view: int | None = device.prepare(ray_table_struct(table))
        self._centres: CentreMatch | None = None
        self.last_counts = FrameCounts()
        """Tiles of the last frame: all, and those that one surface was proven to fill."""

    @property
    def memory_bytes(self) -> int:
        """Size of the rays and of their beams."""
        own = 0 if self._view is None else self._device.view_bytes(self._view)
        return self._table.memory_bytes + own

    def render(self, exposure: TracedExposure, request: TraceRequest) -> TracedFrame:
        """A frame and all other outputs that are wanted."""
        output = OUTPUT_LINEAR if request.is_linear else OUTPUT_SRGB
        shape = (self._table.height_px, self._table.width_px)
        image: npt.NDArray[Any] = np.zeros(
            (*shape, 3), dtype=np.float32 if request.is_linear else np.uint8
        )
        inverse = np.zeros(shape, dtype=np.float32) if request.has_ranges else None
        labels, owned = self._label_beside(exposure, request.labels)
        self._render(
            exposure,
            output,
            request.thresholds,
            image=image.ctypes.data,
            inverse_range=None if inverse is None else inverse.ctypes.data,
            labels=None if owned is None else ctypes.addressof(owned.struct),
        )
        # Other threads encode a frame while the next one is rendered.
        if not request.is_linear:
            image.setflags(write=False)
        counts, state = self.last_counts, first_state(exposure)
        shutter = state.shutter
        is_blurred = shutter is not None and shutter.exposure_s > 0.0
        changes = _read_changes(self._num_pixels, state, counts, request.thresholds)
        if self._engine.scene.baked_light is None:
            changes.pop("BakedLight", None)
        return TracedFrame(
            image,
            changes,
            None if inverse is None else invert_ranges(inverse),
            {"MotionBlur": counts.blur_ms} if is_blurred else {},
            labels,
        )

    def render_srgb(self, exposure: TracedExposure) -> Image:
        """(h, w, 3) sRGB, read-only; black off the mirror."""
        return self.render(exposure, TraceRequest()).image

    def render_linear(self, exposure: TracedExposure) -> LinearImage:
        """(h, w, 3) linear light; zero off the mirror. Light beyond white is kept."""
        return self.render(exposure, TraceRequest(is_linear=True)).image

    def find_hits(self, exposure: TracedExposure) -> RayHits:
        """First hit of each ray."""
        shape = (*self._table.valid.shape, BLOCK_RAYS)
        range_m = np.zeros(shape, dtype=np.float32)
        triangle, hit_object = np.zeros(shape, dtype=np.int32), np.zeros(shape, dtype=np.int32)
        self._render(
            exposure,
            OUTPUT_HITS,
            range_m=range_m.ctypes.data,
            triangle=triangle.ctypes.data,
            object=hit_object.ctypes.data,
        )
        return RayHits(range_m, triangle, hit_object)

    def label_pixels(self, exposure: TracedExposure, request: LabelRequest) -> PixelLabels:
        """Labels without an image; the agreement is of these rays."""
        arrays, owned = self._label_arrays(exposure, request)
        self._render(exposure, OUTPUT_LABELS, labels=ctypes.addressof(owned.struct))
        return arrays

    def _label_beside(
        self, exposure: TracedExposure, request: LabelRequest | None
    ) -> tuple[PixelLabels | None, OwningStruct | None]:
        """Channels to be found with a picture; none where these rays cannot find any."""
        if request is None:
            return None, None
        try:
            return self._label_arrays(exposure, request)
        except DomainError:
            # The picture is as good without; whoever wants the labels alone is told why.
            return None, None

    def _label_arrays(
        self, exposure: TracedExposure, request: LabelRequest
    ) -> tuple[PixelLabels, OwningStruct]:
        origin = frame_origin(exposure, self._engine.scene)
        return label_arrays(self._match(request.centres), request, origin)

    def _match(self, centres: RayTable) -> CentreMatch:
        """Where the rays of the pixels' centres are among these; kept for the next frame."""
        if self._centres is None or self._centres.centres is not centres:
            view = self._require_view()
            self._centres = match_centres(self._device, view, self._table, centres)
        return self._centres

    def find_flow(self, other: TracedExposure, tables: FlowTables) -> Float32s:
        """(h, w, 2) displacement of points to their places in another exposure; nan: not seen."""
        flow, owned = flow_arrays(tables, frame_origin(other, self._engine.scene))
        self._render(other, OUTPUT_FLOW, flow=ctypes.addressof(owned.struct))
        return flow

    def trace_bare(self, exposure: TracedExposure) -> None:
        """Trace the rays without any use of the hits: the bare rate, for benchmarks."""
        self._engine.trace_bare(self._require_view(), exposure)

    def _render(
        self,
        exposure: TracedExposure,
        output: int,
        thresholds: Mapping[str, Threshold] = NO_THRESHOLDS,
        **addresses: int | None,
    ) -> None:
        view = self._require_view()
        has_few_rays = BLOCK_RAYS * self._table.valid.size < MIN_PROVEN_RAYS
        self.last_counts = self._engine.render(
            view,
            exposure,
            output,
            thresholds,
            self._num_pixels,
            has_few_rays=has_few_rays,
            **addresses,
        )
        if self.last_counts.drops_layers:
            self._engine.scene.report_dropped_layers()

    def _require_view(self) -> int:
        if self._view is None:
            raise KernelError("the view is closed: nothing can be rendered with it")
        return self._view

    def close(self) -> None:
        """Free the view."""
        if self._view is not None:
            self._device.release_view(self._view)
        self._view = self._centres = None


def _measures(thresholds: Mapping[str, Threshold], effect: str) -> bool:
    return effect in thresholds and thresholds[effect].is_measured


def _spread(thresholds: Mapping[str, Threshold]) -> int:
    """Pixels of the picture that one of the frame's may change: a mosaic's neighbours."""
    return 9 if any(one.has_mosaic for one in thresholds.values()) else 1


def _read_changes(
    num_pixels: int,
    state: CameraState,
    counts: FrameCounts,
    thresholds: Mapping[str, Threshold],
) -> dict[str, EffectChange]:
    """Changes by the scene's effects that are drawn and have a threshold."""
    changes = {}
    spread = _spread(thresholds)
    if state.has_shadows:
        changes["Shadows"] = read_change(counts.shadow_change, num_pixels, spread)
    if state.has_baked_light:
        changes["BakedLight"] = read_change(counts.light_change, num_pixels, spread)
    if state.has_gloss:
        changes["Gloss"] = read_change(counts.gloss_change, num_pixels, spread)
    if state.fog is not None:
        changes["Fog"] = read_change(counts.fog_change, num_pixels, spread)
    if find_ego_body(state):
        changes["SelfView"] = _read_self_view(num_pixels, state, counts, thresholds)
    if state.shutter is not None and state.shutter.readout_s > 0.0:
        changes["RollingShutter"] = read_change(counts.rolling_change, num_pixels, spread)
    if state.shutter is not None and state.shutter.exposure_s > 0.0:
        changes["MotionBlur"] = read_change(counts.blur_change, num_pixels, spread)
    return {
        name: replace(one, is_partial=bool(counts.ended_measures & _ENDED_BY.get(name, 0)))
        for name, one in changes.items()
        if _measures(thresholds, name)
    }


def _read_self_view(
    num_pixels: int,
    state: CameraState,
    counts: FrameCounts,
    thresholds: Mapping[str, Threshold],
) -> EffectChange:
    """Change by the ego body: where it is seen, and by its shadows, no more than by all."""
    if not counts.shows_watched and not state.has_shadows:
        return EffectChange(0.0)
    spread = _spread(thresholds)
    own = read_change(counts.watched_change, num_pixels, spread)
    if counts.shows_watched and own.largest == 0.0:
        return EffectChange(np.inf)  # at other instants alone
    if not state.has_shadows:
        return own
    if not _measures(thresholds, "Shadows"):
        return EffectChange(np.inf if counts.shows_watched else 0.0)
    shadows = read_change(counts.shadow_change, num_pixels, spread)
    share = min(own.visible_share + shadows.visible_share, 1.0)
    return EffectChange(max(own.largest, shadows.largest), share)


class KernelEngine:
    """A scene on a kernel device."""

    def __init__(
        self,
        scene: SceneMesh,
        world: World,
        *,
        threads: int,
        scene_lights: tuple[Light, ...],
        instruction_set: str = "",
    ) -> None:
        """Commit a scene.

        Args:
            scene: Triangles of the static scene.
            world: Lights of dynamic objects, and background.
            threads: Threads, the calling one included.
            scene_lights: Lights of the static scene.
            instruction_set: For tests, one that this processor has; else the processor's best.

        Raises:
            KernelUnavailableError: The kernel's library is missing.
        """
        self._device = KernelDevice(instruction_set or choose_instruction_set(), threads)
        # Neither processor nor threads, which would be in the plan of every frame.
        self.description = "kernel"
        self.scene = scene
        self._world = world
        self._scene_lights = scene_lights
        self._owners: list[object] = []
        self._looks: list[object] = []
        """Arrays of lights and colours, until the scene is repainted."""
        self._occlusions: dict[int, Any] = {}
        """Structures of maps of light, by the identity of those, which they hold."""
        self._meshes: list[CommittedScene] = []
        self._objects = ObjectTable(self._device)
        self._has_shadow_tables = False
        self._radiances: tuple[float, ObjectRadiances] | None = None
        try:
            self._scene = self._make_scene()
        except BaseException:
            # Nobody else knows the device: the threads would stay.
            self._device.close()
            raise

    @property
    def num_object_meshes(self) -> int:
        """Number of object meshes committed so far."""
        return len(self._objects)

    @cached_property
    def image_changer(self) -> KernelImageChanger:
        """Stages of image effects on the engine's device."""
        # Not at the start of a server whose cameras have none: `commands/server.py`.
        from catoptra_server.render.trace.kernel.image import KernelImageChanger

        return KernelImageChanger(self._device)

    def _make_scene(self) -> SceneStruct:
        """Scene without what only shadows need."""
        textures = self._keep(texture_array(self.scene))
        self._textures = textures
        with ThreadPoolExecutor(max_workers=1) as pool:
            # Beside the tables: one thread alone builds the top of the hierarchy.
            arrays = scene_arrays(self.scene, self.scene.centre, textures)
            mesh = pool.submit(self._commit, arrays, self.scene)
            tables = self._tabulate(self.scene)
        sky = self._world.sky
        # The table of greys is cached for the life of the process.
        scene = SceneStruct(
            mesh=mesh.result(),
            num_textures=len(self.scene.textures),
            textures=ctypes.addressof(textures),
            srgb_table=srgb_table().ctypes.data,
            surfaces=self._keep(surfaces_struct(find_flat_surfaces(self.scene, self._device))),
            sky=None if sky is None else sky.texels.ctypes.data,
            sky_size=0 if sky is None else sky.size,
            **self._light_members(),
            **tables,
        )
        # Gaps: float32s of textures, boxes of the hierarchy, 60 of 625 MiB in a house.
        release_freed_memory()
        return scene

    def _light_members(self) -> dict[str, Any]:
        lights, num_lights = light_array(self._world.lights, self._scene_lights, self.scene.centre)
        self._looks.append(lights)
        return {
            "num_lights": num_lights,
            "lights": ctypes.addressof(lights),
            "hemisphere": hemisphere_struct(self._world.lights),
            "object_hemisphere": hemisphere_struct(object_lights(self._world)),
        }

    def repaint(self, scene: SceneMesh, world: World) -> None:
        """Show the same triangles in other colours, textures, gloss and light; views stay.

        Args:
            scene: Of `SceneMesh.repaint`, of the committed scene. Facets of one surface and look
                have one look again: proofs about surfaces are those of the first scene.
            world: The same world with other lights, all of which light the scene.
        """
        is_lit_alike = are_lit_alike(world, self._world)
        if scene is self.scene and is_lit_alike:
            return
        was, self.scene, self._world = self.scene, scene, world
        self._scene_lights = self._scene_lights if is_lit_alike else world.lights
        self.__dict__.pop("_mean_tables", None)
        self._radiances = None
        if not is_lit_alike:
            self._device.release_light_maps(self._scene)
            self._has_shadow_tables = False
        # After the last frame with the former ones.
        self._looks = []
        if scene is not was:
            self._meshes[0].repaint(scene_arrays(scene, scene.centre, self._textures))
        members = self._tabulate(scene) | self._light_members()
        if self._has_shadow_tables and scene.occlusion is None:
            members["ambient_radiance"] = self._tabulate_ambient(scene)
        for name, value in members.items():
            setattr(self._scene, name, value)

    def _tabulate(self, scene: SceneMesh) -> dict[str, Any]:
        """Members of a scene's structure that its map of light is in."""
        radiance = radiance_table(scene, self._scene_lights, self._world.background)
        encoded = encoded_table(radiance)
        self._looks += [radiance, encoded]
        # Read for shadows and hidden sky alone; until then the same table stands in.
        has_map = scene.occlusion is not None
        ambient = self._tabulate_ambient(scene) if has_map else radiance.ctypes.data
        return {
            "sharp_radiance": radiance.ctypes.data,
            "ambient_radiance": ambient,
            "encoded": encoded.ctypes.data,
            "occlusion": self._find_occlusion(scene),
        }

    def _find_occlusion(self, scene: SceneMesh) -> Any:
        """Structure of a scene's map of light, made once: 30 ms of a furnished world."""
        key = id(scene.occlusion)
        if key not in self._occlusions:
            owned = occlusion_struct(scene.occlusion, scene.centre)
            self._occlusions[key] = self._keep(owned)
        return self._occlusions[key]

    @cached_property
    def _mean_occlusion(self) -> OcclusionMap:
        """The map of baked light with one factor on each grid."""
        occlusion = self.scene.baked_light
        assert occlusion is not None, "light is baked"
        return occlusion.average()

    def _tabulate_ambient(self, scene: SceneMesh) -> int:
        """Address of the facets' radiance by hemisphere lights alone."""
        ambient = hemisphere_lights(self._scene_lights)
        radiance = radiance_table(scene, ambient, self._world.background)
        self._looks.append(radiance)
        return radiance.ctypes.data

    @cached_property
    def _mean_tables(self) -> dict[str, Any]:
        """Members of the structure of a scene with one light on each grid of its map."""
        return self._tabulate(self.scene.repaint(occlusion=self._mean_occlusion))

    @cached_property
    def _grid_means(self) -> npt.NDArray[np.float32]:
        """(m, 3) factors of the grids of baked light where nobody looks at nodes."""
        occlusion = self.scene.baked_light
        assert occlusion is not None, "light is baked"
        return occlusion.average().darkest.astype(np.float32)

    def _choose_scene(self, state: CameraState, *, measures_light: bool) -> SceneStruct:
        """Structure of the scene as effects of a state show it, and measure baked light's."""
        has_map = self.scene.baked_light is not None
        has_mean, measures_light = has_map > state.has_baked_light, measures_light and has_map
        if not has_mean and not measures_light and (state.has_sky or self._world.sky is None):
            return self._scene
        scene = SceneStruct.from_buffer_copy(self._scene)
        if has_mean:
            for name, value in self._mean_tables.items():
                setattr(scene, name, value)
        if not state.has_sky:
            scene.sky = None
        if measures_light:
            scene.occlusion.means = self._grid_means.ctypes.data
        return scene

    def _keep(self, owned: OwningStruct) -> Any:
        """Structure whose arrays live as long as the engine."""
        self._owners += [owned.struct, *owned.owners]
        return owned.struct

    def _commit(self, owned: OwningStruct, shared: SceneMesh | None = None) -> int:
        """Mesh of the device, released with the engine, or with the last caster that shares it."""
        mesh = CommittedScene(self._device, owned, shared)
        self._meshes.append(mesh)
        return mesh.address

    def _prepare_shadows(self) -> None:
        """Add to the scene what only shadows need, at the first frame with shadows."""
        if self._has_shadow_tables:
            return
        if self.scene.occlusion is None:
            self._scene.ambient_radiance = self._tabulate_ambient(self.scene)
        # Else the triangles that are seen occlude as well: no second hierarchy.
        if not (self._scene.casters or self.scene.casts_shadows.all()):
            self._scene.casters = self._commit(
                caster_arrays(self.scene, self.scene.centre, self._textures)
            )
            casters = np.flatnonzero(self.scene.casts_shadows).astype(np.int32)
            self._owners.append(casters)
            self._scene.caster_triangles = casters.ctypes.data
        self._scene.light_maps = self._device.build_light_maps(self._scene)
        self._has_shadow_tables = True

    def prepare(self, rays: RayTable) -> KernelRays:
        """Prepare the rays of a camera."""
        return KernelRays(rays, self._device, self)

    def render(
        self,
        view: int,
        exposure: TracedExposure,
        output: int,
        thresholds: Mapping[str, Threshold],
        num_pixels: int,
        **members: int | None,
    ) -> FrameCounts:
        """Render an exposure into arrays; further arguments are members of `FrameStruct`."""
        frame = exposure_arrays(exposure, self.scene, self._objects, self._world.probes)
        struct = frame.struct
        if struct.has_shadows:
            self._prepare_shadows()
        struct.output = output
        struct.measures_shadows = _measures(thresholds, "Shadows")
        struct.ends_measures = any(one.may_end for one in thresholds.values())
        struct.measures_fog = _measures(thresholds, "Fog")
        if struct.has_gloss:
            struct.measures_gloss = _measures(thresholds, "Gloss")
            struct.gloss_limit = thresholds["Gloss"].plain_change if struct.measures_gloss else -1.0
            struct.brightest = self._max_radiance(camera_states(exposure)[0])
        if _measures(thresholds, "SelfView"):
            struct.watched_object = find_ego_body(exposure)
        if _measures(thresholds, "MotionBlur"):
            struct.blur_threshold = thresholds["MotionBlur"].plain_change
        if thresholds:
            # Those of the first effect include all others'.
            first = next(iter(thresholds.values()))
            struct.least_gain, struct.largest_gain = first.gains
            struct.spill[:] = first.spill
        for one in thresholds.values():
            if one.is_measured:
                struct.limits = change_limits(one, num_pixels, _spread(thresholds))
        for name, value in members.items():
            setattr(struct, name, value)
        measures_light = _measures(thresholds, "BakedLight")
        scene = self._choose_scene(camera_states(exposure)[0], measures_light=measures_light)
        return self._device.render(scene, view, struct)

    def _max_radiance(self, state: CameraState) -> float:
        """Largest radiance of anything that glossy surfaces may mirror."""
        if self._radiances is None:
            # Loaded with the first glossy surface.
            from catoptra_server.effects.bounds.light_loss import ObjectRadiances, max_radiance

            of_scene = max_radiance(self.scene, self._world)
            self._radiances = of_scene, ObjectRadiances(self._world)
        of_scene, of_objects = self._radiances
        return max(of_scene, of_objects.max_radiance(state.objects))

    def trace_bare(self, view: int, exposure: TracedExposure) -> None:
        """Trace a view's rays without any use of the hits."""
        frame = exposure_arrays(exposure, self.scene, self._objects, self._world.probes)
        self._device.trace(self._scene, view, frame.struct)

    def close(self) -> None:
        """Free the scene and end the threads."""
        self._objects.close()
        self._device.release_light_maps(self._scene)
        # Sensors may still trace the scene.
        self._meshes.clear()
        self._device.close()
