"""Ground truth of images: rays of their cameras, prepared once, and what these meet.

Belongs to the thread of the renderers. The rays of a camera are kept as long as there is room.

* Labels are found along the rays of the picture where rays and times are the same: proofs and hits
  serve both, and the bytes of the picture do not change. Else labels are traced alone.
* Occluded fraction: of the pixels that an object would have alone in the world, the part that
  others hide. Rays in a cone around the object's box are cast at the object's own triangles; at
  most 4096, evenly spread over the image, leave a standard error below 0.01.
* Flow: the point that a pixel shows moves with the object; the exact camera model has the point's
  pixel in the other exposure. The flow is unknown where the point is outside that image, or where
  that pixel's ray meets something else first.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels import (
    LABEL_CHANNELS,
    SKY_CLASS,
    GroundTruth,
    LabelledObject,
    parse_channels,
)
from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.elementary import (
    arcsin,
    arctan,
    arctan2,
    cos,
    hypot,
    interpolate_linear,
    matmul,
    sin,
)
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.medium.misalignment import lookup_maps
from catoptra_server.frames.labels import (
    LabelCamera,
    LabelledImage,
    RaySource,
    SceneLabels,
    build_label_rays,
    find_valid_pixels,
    label_exposure,
)
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, RayTable
from catoptra_server.render.trace.reference.triangle_search import TriangleSearch
from catoptra_server.render.trace.trace_engine import (
    FlowRays,
    FlowTables,
    LabelRequest,
    LabelTables,
    PixelLabels,
    TracedRays,
    assemble_grid,
)
from catoptra_server.world.objects import CameraState, DynamicObject, ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh

# Rays of labels take 13 bytes a sample besides the pictures': two cameras of 2048 px stay.
_MAX_RAY_BYTES = 256 * 2**20


class LabelRenderer:
    """Ground truth in one scene."""

    def __init__(
        self,
        renderer: TraceRenderer,
        scene: SceneMesh,
        class_numbers: Mapping[str, int] | None = None,
        others: tuple[str, ...] = (),
    ) -> None:
        """Number the scene's objects.

        Args:
            renderer: Traces the rays; closed by the owner.
            scene: The same scene.
            class_numbers, others: As of `SceneLabels`.

        Raises:
            DomainError: The world has more objects than labels number.
        """
        self._renderer = renderer
        self.labels = SceneLabels(scene, class_numbers, others)
        """Numbers of objects and classes."""
        self._meter = _OcclusionMeter(scene, self.labels)
        self._prepared: dict[tuple[RaySource, int], _PreparedRays] = {}  # last used at the end

    def render(
        self,
        image: LabelledImage,
        channels: Collection[str],
        other: CameraState | None = None,
        found_beside: PixelLabels | None = None,
    ) -> GroundTruth:
        """Ground truth of an exposure.

        Args:
            image: The image to label.
            channels: Names of the channels that are wanted.
            other: State of the frame that `flow` leads to, with the objects of that frame; None:
                there is no such frame, and the flow is unknown.
            found_beside: Labels of `request` for the same exposure and channels, found with the
                picture; None: labels are traced now.

        Raises:
            DomainError: There is no channel of a name.
        """
        wanted = {channel.name for channel in parse_channels(tuple(channels))}
        found = self._trace(image, wanted) if found_beside is None else dict(found_beside)
        if "flow" in wanted:
            found |= self._flow_of(image, found, other)
        if "classes" in wanted and self._renderer.has_sky:
            mask = self._prepare(image.ray_source, 1).mask
            found["classes"][(found["ids"] == 0) & (mask == 1)] = SKY_CLASS
        if "valid" in wanted:
            found["valid"] = self._prepare(image.ray_source, 1).mask.copy()
        objects = self.labels.describe(image.camera_state.objects)
        return GroundTruth(
            {name: found[name] for name in LABEL_CHANNELS if name in wanted}, objects
        )

    def request(self, image: LabelledImage, channels: Collection[str]) -> LabelRequest | None:
        """Labels that the rays of a picture find while it is drawn, for a part of the time.

        Args:
            image: The image, of which no picture is drawn yet.
            channels: Names of the channels that are wanted.

        Returns:
            The request; None where the picture has other rays or times.

        Raises:
            DomainError: There is no channel of a name.
        """
        is_of_same_rays = image.ray_source == RaySource(image.camera)
        wanted = {channel.name for channel in parse_channels(tuple(channels))}
        if not is_of_same_rays or image.camera_state.shutter is not None or wanted <= {"valid"}:
            return None
        return self._make_request(image, wanted)

    def _make_request(self, image: LabelledImage, wanted: set[str]) -> LabelRequest:
        # Flow begins at the points of the objects that pixels show.
        needed = wanted | ({"ids", "point"} if "flow" in wanted else set())
        needed |= {"ids"} if self._renderer.has_sky and "classes" in wanted else set()
        centres = self._prepare(image.ray_source, 1).table
        return LabelRequest(frozenset(needed), self._tables(image.camera_state), centres)

    def _trace(self, image: LabelledImage, wanted: set[str]) -> PixelLabels:
        """Labels without a picture."""
        request = self._make_request(image, wanted)
        # Only agreement takes more rays than one for each pixel's centre.
        samples = image.samples if "agreement" in wanted else 1
        rays = self._prepare(image.ray_source, samples).rays
        return rays.label_pixels(label_exposure(image.camera_state), request)

    def measure_occlusion(self, image: LabelledImage, truth: GroundTruth) -> dict[int, float]:
        """Hidden fraction of each object in view, by number; of ground truth with `ids`."""
        prepared = self._prepare(image.ray_source, 1)
        ids = truth.channels["ids"]
        return self._meter.measure(truth.objects, ids, prepared.grid, image.camera_state)

    def _tables(self, camera_state: CameraState) -> LabelTables:
        """Numbers of the objects of an exposure."""
        numbers = [self.labels.number_of(placed) for placed in camera_state.objects]
        return LabelTables(
            self.labels.triangle_numbers,
            np.array(numbers, dtype=np.uint16),
            self.labels.find_class_table(camera_state.objects),
        )

    def _flow_of(
        self, image: LabelledImage, found: PixelLabels, other: CameraState | None
    ) -> PixelLabels:
        if other is None:
            height_px, width_px = image.camera.height_px, image.camera.width_px
            unknown = np.full((height_px, width_px, 2), np.nan, dtype=np.float32)
            return {"flow": unknown}
        motions = {
            self.labels.number_of(there): there.world_from_object @ here.world_from_object.inverse()
            for here in image.camera_state.objects
            for there in other.objects
            if self.labels.number_of(here) == self.labels.number_of(there)
        }
        gone = {self.labels.number_of(here) for here in image.camera_state.objects} - set(motions)
        flow = _find_flow(
            self._renderer,
            self._prepare(image.ray_source, 1).rays,
            image.ray_source,
            other,
            found["point"],
            found["ids"],
            motions,
            gone,
        )
        return {"flow": flow}

    def _prepare(self, source: RaySource, samples: int) -> _PreparedRays:
        """Rays of an image, prepared at the first use."""
        key = source, samples
        prepared = self._prepared.pop(key, None)
        if prepared is None:
            prepared = _PreparedRays(build_label_rays(source, samples), self._renderer)
        self._prepared[key] = prepared
        while (
            len(self._prepared) > 2
            and sum(each.memory_bytes for each in self._prepared.values()) > _MAX_RAY_BYTES
        ):
            self._prepared.pop(next(iter(self._prepared))).close()
        return prepared

    def close(self) -> None:
        """Free all rays."""
        while self._prepared:
            self._prepared.popitem()[1].close()


def project_points(camera: LabelCamera, in_mirror: Floats) -> tuple[Floats, Bools]:
    """(n, 2) pixels of (n, 3) points in the mirror frame, and validity, within the image alone."""
    if isinstance(camera, PerspectiveCamera):
        pixel, valid = camera.pixel_from_direction(in_mirror)
    elif camera.is_central:
        pixel, valid = pixel_from_direction(camera, in_mirror)
    else:
        directions, is_aimed = _aim_rays(camera, in_mirror)
        pixel, valid = pixel_from_direction(camera, directions)
        pixel[~is_aimed], valid[~is_aimed] = pixel_from_point(camera, in_mirror[~is_aimed])
    size = (camera.width_px, camera.height_px)
    inside = ((pixel >= 0.0) & (pixel < size)).all(axis=-1)
    return pixel, valid & inside


class _PreparedRays:
    """Rays of an image, and what labels derive from them once."""

    def __init__(self, table: RayTable, renderer: TraceRenderer) -> None:
        self.table = table
        self._renderer = renderer
        self._rays: TracedRays | None = None

    @property
    def rays(self) -> TracedRays:
        """The same rays, ready to be traced by themselves: not needed beside a picture."""
        if self._rays is None:
            self._rays = self._renderer.prepare_rays(self.table)
        return self._rays

    @property
    def memory_bytes(self) -> int:
        """Size of the rays, and of what the engine needs for them."""
        return (self._rays or self.table).memory_bytes

    def close(self) -> None:
        """Free what belongs to the rays."""
        if self._rays is not None:
            self._rays.close()

    @cached_property
    def mask(self) -> npt.NDArray[np.uint8]:
        """(h, w) 1 where a pixel's centre has a ray, else 0."""
        return find_valid_pixels(self.table).astype(np.uint8)

    @cached_property
    def grid(self) -> _PixelRayGrid:
        """The same rays in rows, for occluded fractions."""
        return _PixelRayGrid(self.table)


class _PixelRayGrid:
    """Rays of the pixels' centres in the mirror frame, in blocks of neighbours."""

    def __init__(self, table: RayTable) -> None:
        """Arrange the valid rays of a table of one sample a pixel."""
        rows, columns = np.nonzero(find_valid_pixels(table))
        blocks = rows // _BLOCK_PX * (table.width_px // _BLOCK_PX + 1) + columns // _BLOCK_PX
        order = np.argsort(blocks, kind="stable")
        self.pixels = (rows * table.width_px + columns)[order]
        """(n,) pixels of the rays, block by block."""
        fill = np.float32(0.0)
        directions = assemble_grid(table, np.moveaxis(table.directions, 2, -1), fill=fill)
        self._axes = np.ascontiguousarray(directions.reshape(-1, 3)[self.pixels].T)
        self.origins: npt.NDArray[np.float32] | None = None
        """(n, 3) metres; None: all at the viewpoint."""
        self._max_miss_m = 0.0
        if table.origins is not None:
            origins = assemble_grid(table, np.moveaxis(table.origins, 2, -1), fill=fill)
            self.origins = origins.reshape(-1, 3)[self.pixels]
            self._max_miss_m = float(np.linalg.norm(self.origins, axis=-1).max(initial=0.0))
        self._firsts = np.flatnonzero(np.diff(blocks[order], prepend=-1))
        self._counts = np.diff(self._firsts, append=len(order))
        of_blocks = self._axes.T.astype(np.float64)
        self._middles = of_blocks[self._firsts + self._counts // 2]
        offsets = of_blocks - np.repeat(self._middles, self._counts, axis=0)
        lengths = hypot(offsets[:, 0], offsets[:, 1], offsets[:, 2])
        # Largest chord from a block's middle to its directions.
        self._chords = np.maximum.reduceat(lengths, self._firsts) if len(order) else lengths

    def find_candidates(self, centres: Floats, half_m: Floats) -> Iterator[npt.NDArray[np.intp]]:
        """Yield the places of at most _MAX_RAYS rays for each of n boxes, evenly spread over the
        blocks whose rays may meet the sphere around the box.

        Args:
            centres: (n, 3) in the mirror frame.
            half_m: (n, 3) half lengths of the edges.
        """
        distance = hypot(centres[:, 0], centres[:, 1], centres[:, 2])
        reach = hypot(half_m[:, 0], half_m[:, 1], half_m[:, 2]) + self._max_miss_m
        is_outside = distance > reach
        angle = arcsin(np.where(is_outside, reach, 0.0) / np.where(is_outside, distance, 1.0))
        chord = np.where(is_outside, 2.0 * sin(0.5 * angle + 5e-4), 2.0)
        cosines = matmul(centres / np.maximum(distance, _MIN_PLACE)[:, None], self._middles.T)
        for possible in 2.0 - 2.0 * cosines <= np.square(chord[:, None] + self._chords):
            counts = self._counts[possible]
            ends = np.cumsum(counts)
            firsts = self._firsts[possible] + counts - ends
            total = int(ends[-1]) if len(ends) else 0
            num = min(total, _MAX_RAYS)
            # Of the places i * total // num the first ceil(end * num / total) are below an end.
            upto = -(-ends * num // max(total, 1))
            places = np.arange(num) * total // max(num, 1)
            yield places + np.repeat(firsts, np.diff(upto, prepend=0))

    def turn_directions(self, world_from_mirror: Pose) -> npt.NDArray[np.float32]:
        """(n, 3) directions in the world."""
        x, y, z = self._axes
        rows = world_from_mirror.rotation.astype(np.float32)
        return np.stack([row[0] * x + row[1] * y + row[2] * z for row in rows], axis=-1)


_MAX_RAYS = 4096
_BLOCK_PX = 8
# Whether rays from (n, 3) origins along (n, 3) unit directions meet an object.
_RayTest = Callable[[Floats, npt.NDArray[np.float32]], Bools]


class _OcclusionMeter:
    """Occluded fractions of the objects of one world; meshes are committed at their first use."""

    def __init__(self, scene: SceneMesh, labels: SceneLabels) -> None:
        """Measure nothing yet.

        Args:
            scene: The world's triangles.
            labels: Their objects.
        """
        self._scene = scene
        self._labels = labels
        self._static: dict[int, _RayTest] = {}
        self._moving: dict[ObjectMesh, _RayTest] = {}

    def measure(
        self,
        objects: tuple[LabelledObject, ...],
        ids: npt.NDArray[np.uint16],
        rays: _PixelRayGrid,
        camera_state: CameraState,
    ) -> dict[int, float]:
        """Occluded fraction of each object in view, by number.

        Args:
            objects: All objects of the exposure.
            ids: (h, w) numbers that the pixels' centres meet.
            rays: Rays of the pixels.
            camera_state: The exposure, whose middle counts.
        """
        placed = {self._labels.number_of(one): one for one in camera_state.objects}
        in_view = np.bincount(ids.reshape(-1), minlength=2**16) > 0
        seen = [one for one in objects if in_view[one.number]]
        world_from_mirror = camera_state.world_from_mirror
        centres = np.array([one.world_from_box.translation for one in seen]).reshape(-1, 3)
        candidates = rays.find_candidates(
            world_from_mirror.inverse().transform_points(centres),
            np.array([one.half_size_m for one in seen]).reshape(-1, 3),
        )
        ways, numbers = rays.turn_directions(world_from_mirror), ids.reshape(-1)[rays.pixels]
        fractions = {}
        for one, places in zip(seen, candidates, strict=True):
            unseen = places[numbers[places] != one.number]
            starts = world_from_mirror.translation[None]
            if rays.origins is not None:
                starts = world_from_mirror.transform_points(rays.origins[unseen].astype(float))
            hidden = self._count_hits(one.number, placed.get(one.number), starts, ways[unseen])
            # In view by pixels between those that are cast: nothing is known to be hidden.
            own = hidden + len(places) - len(unseen)
            fractions[one.number] = hidden / own if own else 0.0
        return fractions

    def _count_hits(
        self,
        number: int,
        robot: DynamicObject | None,
        starts: Floats,
        ways: npt.NDArray[np.float32],
    ) -> int:
        """Number of rays in the world, of one origin or of one each, that meet an object."""
        if not len(ways):
            return 0
        if robot is None:
            meets = self._find_static(number)
        else:
            meets, inverse = self._find(robot.mesh), robot.world_from_object.inverse()
            ways = inverse.rotate_directions(ways.astype(np.float64)).astype(np.float32)
            starts = inverse.transform_points(starts)
        return int(np.count_nonzero(meets(np.broadcast_to(starts, ways.shape), ways)))

    def _find_static(self, number: int) -> _RayTest:
        if number not in self._static:
            triangles = self._labels.triangle_numbers == number
            self._static[number] = self._commit(self._scene.corners[triangles])
        return self._static[number]

    def _find(self, mesh: ObjectMesh) -> _RayTest:
        if mesh not in self._moving:
            self._moving[mesh] = self._commit(mesh.corners)
        return self._moving[mesh]

    def _commit(self, corners: Floats) -> _RayTest:
        """Test whether rays meet some triangles, at least one; in NumPy without the kernel."""
        centre = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
        try:
            caster = KernelMeshCaster(corners, centre, threads=1)
        except KernelUnavailableError:
            search = TriangleSearch(corners)
            return lambda origins, ways: search.first_hits(origins, ways.astype(float))[1] >= 0
        return lambda origins, ways: caster.closest_triangles(origins, ways)[1] >= 0


_Flow = npt.NDArray[np.float32]
# A point is visible if the ray of its pixel ends as far away, up to float32 and to the slope of its
# facet: a pixel's ray passes the point by a few hundred thousandths of the distance.
_SAME_RANGE = 2e-3
_SAME_RANGE_M = 2e-3
_DISPLACEMENT_STEPS = 3
# Between two nodes the image bends by 1e-5 px, the origin of a ray by less than a micrometre. 0.2 m
# from a mirror of 3 cm each step leaves a sixth of the error.
_TABLE_NODES = 4096
_AIM_STEPS = 9
# Of the last step: 1e-5 px and less where a step leaves a sixth of an error.
_AIMED_RAD = 1e-6
_MIN_PLACE = 1e-300


def _find_flow(
    renderer: TraceRenderer,
    rays: TracedRays,
    source: RaySource,
    other: CameraState,
    points: npt.NDArray[np.float32],
    ids: npt.NDArray[np.uint16],
    motions: Mapping[int, Pose],
    gone: Collection[int],
) -> _Flow:
    """(h, w, 2) displacement of each pixel's point from here to the other image, px.

    Args:
        renderer: Traces the rays that tell whether a point is visible.
        rays: Rays of the pixels' centres.
        source: Camera of both images.
        other: State of the other exposure, whose middle counts.
        points: (h, w, 3) points that the pixels show, world frame; nan where they show none.
        ids: (h, w) numbers of the objects that these belong to.
        motions: Motion of each moving object by number, world there from world here.
        gone: Numbers of objects that are missing in the other exposure.
    """
    camera = source.camera
    is_radial = isinstance(camera, OmniCamera) and camera.plane.is_radial
    # The kernel projects by tables of the angle alone, a twentieth of the time.
    if isinstance(camera, OmniCamera) and is_radial and source.misalignment is None:
        if isinstance(rays, FlowRays):
            table = _tabulate_camera(camera)
            tables = FlowTables(
                points,
                ids,
                motions,
                gone,
                table.places,
                table.radius_px,
                _image_axes(camera),
                camera.centre_px,
                table.origin_r,
                table.origin_z,
            )
            return rays.find_flow(_sharp(other), tables)
    height, width = ids.shape
    moved = _move_points(points.astype(np.float64), ids, motions)
    known = np.isfinite(moved).all(axis=-1) & ~np.isin(ids, list(gone))
    rows, columns = np.nonzero(known)
    in_mirror = other.world_from_mirror.inverse().transform_points(moved[rows, columns])
    pixel, shown = project_points(source.camera, in_mirror)
    rows, columns, pixel = rows[shown], columns[shown], pixel[shown]
    is_visible = _find_visible(renderer, source.camera, other, pixel, in_mirror[shown])
    flow = np.full((height, width, 2), np.nan, dtype=np.float32)
    here = np.stack((columns + 0.5, rows + 0.5), axis=-1)
    there = _displace(source, pixel)
    flow[rows[is_visible], columns[is_visible]] = (there - here)[is_visible]
    return flow


def _sharp(other: CameraState) -> CameraState:
    """The middle of an exposure, without light and air."""
    return replace(other, shutter=None, has_shadows=False, has_gloss=False, fog=None)


@dataclass(frozen=True, slots=True, eq=False)
class _CameraTable:
    """A camera by the angle from its axis."""

    places: Floats
    """(n,) evenly spaced t / (1 + t), t = tan(angle / 2)."""
    angles_rad: Floats
    """(n,) angles from the axis."""
    radius_px: Floats
    """(n,) image radii."""
    origin_r: Floats | None
    """(n,) distances of the mirror's points from the axis, metres; None with a viewpoint."""
    origin_z: Floats | None
    """(n,) their positions along the axis."""


@lru_cache(maxsize=4)
def _tabulate_camera(camera: OmniCamera) -> _CameraTable:
    first, last = (t / (1.0 + t) for t in (camera.projection.t_min, camera.rim_t))
    places = np.linspace(first, last, _TABLE_NODES)
    # The last place of a camera that sees all around is that of an infinite t, or rounds to it.
    t = np.clip(places / np.maximum(1.0 - places, _MIN_PLACE), None, camera.rim_t)
    radius_px = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    origins = (None, None) if camera.is_central else camera.mirror.surface_point(t)
    return _CameraTable(places, 2.0 * arctan(t), radius_px, *origins)


@lru_cache(maxsize=4)
def _image_axes(camera: OmniCamera) -> Floats:
    """(2, 2) unit displacements in the image, columns, of the azimuths of x and of y."""
    angle = 0.5 * (2.0 * arctan(camera.projection.t_min) + camera.rim_rad)
    level, height = sin(angle), cos(angle)
    along = np.array(((level, 0.0, height), (0.0, level, height)))
    offsets = pixel_from_direction(camera, along)[0] - camera.centre_px
    return np.asarray((offsets / np.linalg.norm(offsets, axis=-1, keepdims=True)).T)


def _aim_rays(camera: OmniCamera, in_mirror: Floats) -> tuple[Floats, Bools]:
    """Directions of the rays that meet (n, 3) points, of a mirror without a viewpoint, and where
    they are found.

    A ray's origin depends on its direction: a step for one shortens the error of the other by the
    origin's change per radian over the point's distance. Next to the mirror steps may miss:
    `pixel_from_point` finds the same root by bisection, of each point alone.
    """
    table = _tabulate_camera(camera)
    theta, r, z = table.angles_rad, table.origin_r, table.origin_z
    assert r is not None, "a mirror without a viewpoint"
    assert z is not None
    rho, height = hypot(in_mirror[:, 0], in_mirror[:, 1]), in_mirror[:, 2]
    last = angle = arctan2(rho, height)
    for _ in range(_AIM_STEPS):
        last, angle = (
            angle,
            arctan2(
                rho - interpolate_linear(angle, theta, r),
                height - interpolate_linear(angle, theta, z),
            ),
        )
    level = sin(angle) / np.where(rho > 0.0, rho, 1.0)
    directions = np.column_stack((in_mirror[:, :2] * level[:, None], cos(angle)))
    return directions, np.abs(angle - last) <= _AIMED_RAD


def _displace(source: RaySource, pixel: Floats) -> Floats:
    """Pixels of a displaced capture camera that look up (n, 2) pixels of the aligned one."""
    if source.misalignment is None or not isinstance(source.camera, OmniCamera):
        return pixel
    lookup = lookup_maps(source.misalignment, source.camera)[0]
    last = np.array((source.camera.width_px, source.camera.height_px)) - 1
    displaced = pixel
    # Offsets change by hundredths from pixel to pixel: each step is a hundred times as near.
    for _ in range(_DISPLACEMENT_STEPS):
        at = np.clip(displaced.astype(np.intp), 0, last)
        displaced = pixel - lookup[at[:, 1], at[:, 0], :2]
    return np.asarray(displaced)


def _move_points(
    points: Floats, ids: npt.NDArray[np.uint16], motions: Mapping[int, Pose]
) -> Floats:
    """Points where their objects are in the other exposure."""
    moved = points.copy()
    for number, motion in motions.items():
        those = ids == number
        moved[those] = motion.transform_points(points[those])
    return moved


def _find_visible(
    renderer: TraceRenderer,
    camera: LabelCamera,
    other: CameraState,
    pixel: Floats,
    in_mirror: Floats,
) -> Bools:
    """(n,) whether the rays of pixels end at the points that they should show."""
    if isinstance(camera, PerspectiveCamera):
        directions, _ = camera.direction_from_pixel(pixel)
        origins = np.zeros_like(directions)
    else:
        origins, directions, _ = ray_from_pixel(camera, pixel)
    table = _pack_rays(origins, directions)
    rays = renderer.prepare_rays(table)
    try:
        ranges = rays.find_hits(_sharp(other)).range_m.reshape(-1)[: len(pixel)]
    finally:
        rays.close()
    expected = np.linalg.norm(in_mirror - origins, axis=-1)
    visible: Bools = np.abs(ranges - expected) <= _SAME_RANGE * expected + _SAME_RANGE_M
    return visible


def _pack_rays(origins: Floats, directions: Floats) -> RayTable:
    """Table of any rays, in rows of tiles of one image."""
    num_tiles = max(1, -(-len(directions) // BLOCK_RAYS))
    packed = np.zeros((2, num_tiles * BLOCK_RAYS, 3), dtype=np.float32)
    packed[0, :, 2] = 1.0
    packed[0, : len(directions)], packed[1, : len(directions)] = directions, origins
    blocks = packed.reshape(2, num_tiles, 1, BLOCK_RAYS, 3).swapaxes(-1, -2)
    valid = np.zeros(num_tiles * BLOCK_RAYS, dtype=np.uint8)
    valid[: len(directions)] = 1
    bits = np.packbits(valid.reshape(num_tiles, 1, BLOCK_RAYS), axis=-1, bitorder="little")
    return RayTable(
        4 * num_tiles,
        4,
        1,
        np.arange(num_tiles, dtype=np.int32),
        np.ascontiguousarray(blocks[0]),
        bits.view("<u2")[..., 0],
        np.ascontiguousarray(blocks[1]),
    )
