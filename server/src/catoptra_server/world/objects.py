"""What changes from frame to frame: dynamic objects, such as robots, and the state of a camera.

Dynamic objects are meshes at poses, and boxes. A mesh is built once for a class of robots, in the
object's frame; an object adds pose and motion. Objects are lit by the same model as the scene
(`shading`), round parts by normals between those at corners; bodies of items keep their textures.

To each other's sensors robots are oriented boxes, intersected with rays in closed form: 0.6 ms a
cycle of the P2AT among seven others (tests/measurements/sensor_times.py).

A camera's state is its pose, motion and surroundings during one exposure, and nothing else: camera
model, plan and scene stay the same and belong to a view. Effects, bounds and renderers read this
one description.

Shutter: an image of a moving scene is the mean, in linear light, of sharp images. Row v of h is
exposed from t_v - T/2 to t_v + T/2, T the exposure time, t_v = R ((v + 1/2) / h - 1/2), R the
readout time; both are centred on the pose. The whole time, T + R, is divided into equal slots, and
one sharp image is rendered at the centre of each, with camera, objects, occlusion and shadows of
that time. A row's weight of a slot is the fraction of the row's exposure within the slot; the
weights sum to 1, so no light is lost.

Within a slot everything stands still. Steps of a pixel during the exposure leave less than a grey
level of rms against 64 time samples, since pixels are means already; a row that shows a single slot
is off by up to half a slot, so the displacement during the readout counts four times. Spreading one
image along each pixel's displacement came first: 1.3 to 2.3 grey levels of rms, in 330 to 720 ms.

Fog: L' = L exp(-beta D) + A (1 - exp(-beta D)), D the range, beta the extinction per metre, A the
airlight, the same in all directions. What is infinitely far away has the colour of the airlight.
Source: Koschmieder's law.

Noise: the seed is made of camera and tick, so an additional request changes nobody's noise, and two
channels that show one exposure agree.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import einsum, exp, hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.world.shapes import Patch, smooth_normals
from catoptra_server.world.textures import Texture, TextureSampling, no_texture_coordinates
from catoptra_server.world.world_description import (
    AT_REST,
    ROBOT_CLASS,
    Material,
    Twist,
)

if TYPE_CHECKING:
    from catoptra_server.world.scene_mesh import SceneMesh


# Shares of an object's surface between which it is massive.
_MASSIVE = (0.05, 0.95)


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMesh:
    """Triangles in an object's frame."""

    corners: Floats
    """(n, 3, 3) metres."""
    normals: Floats
    """(n, 3) unit, from the winding."""
    albedo: Floats
    """(n, 3) linear."""
    unlit: Bools
    """(n,)."""
    centre: Floats
    """(3,) centre of a bounding sphere."""
    radius_m: float
    """Radius of the bounding sphere."""
    half_size_m: Floats
    """(3,) half lengths of the bounding box about the same centre."""
    corner_normals: Floats | None = None
    """(n, 3, 3) as of `SceneMesh`; None: all triangles are flat."""
    bent: Bools | None = None
    """(n,) as of `SceneMesh`, beside the normals at corners."""
    uv: Floats = field(default_factory=lambda: no_texture_coordinates(0))
    """(n, 3, 2) texture coordinates; none without textures."""
    texture_index: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    """(n,) as of `SceneMesh`; none without textures."""
    textures: tuple[Texture, ...] = ()
    samplings: tuple[TextureSampling, ...] = ()
    """How each texture is sampled."""

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.corners)


@dataclass(frozen=True, slots=True, eq=False)
class DynamicObject:
    """Object at a pose; objects of one class share their mesh."""

    mesh: ObjectMesh
    world_from_object: Pose
    twist: Twist = AT_REST
    """Motion of the object's frame in the world, referred to the frame's origin."""
    name: str = ""
    """Name of the robot, for labels."""
    number: int = 0
    """Number of the robot among all that were ever spawned, from 1; 0: unknown."""
    class_name: str = ROBOT_CLASS

    @property
    def centre(self) -> Floats:
        """Centre of the bounding sphere, (3,) metres, world frame."""
        return self.world_from_object.transform_points(self.mesh.centre)

    def with_pose(self, world_from_object: Pose) -> DynamicObject:
        """The same object at another pose; itself at the pose that it has."""
        if world_from_object is self.world_from_object:
            return self
        return replace(self, world_from_object=world_from_object)

    def encloses(self, point: Floats) -> bool:
        """Whether a (3,) point of the world lies in the box around the object, in its own axes."""
        # The sphere first: most objects are far from most points.
        if hypot(*(point - self.centre).tolist()) > self.mesh.radius_m:
            return False
        offset = self.world_from_object.inverse().transform_points(point) - self.mesh.centre
        return bool((np.abs(offset) <= self.mesh.half_size_m).all())


@dataclass(frozen=True, slots=True, eq=False)
class _WorldFacets:
    """Facets of an object in the world, as `shading.LitFacets`."""

    normals: Floats
    """(n, 3) unit, world frame."""
    albedo: Floats
    """(n, 3) linear."""
    unlit: Bools
    """(n,)."""


def world_facets(dynamic_object: DynamicObject) -> _WorldFacets:
    """Facets of an object at its pose."""
    mesh = dynamic_object.mesh
    return _WorldFacets(
        dynamic_object.world_from_object.rotate_directions(mesh.normals), mesh.albedo, mesh.unlit
    )


def build_object_mesh(
    parts: Iterable[tuple[Patch, Material]],
    *,
    is_smooth: bool = False,
    body: SceneMesh | None = None,
) -> ObjectMesh:
    """Build the mesh of patches with their materials, in the object's frame, not empty.

    Args:
        parts: Patches with their materials, which have no textures.
        is_smooth: Whether each patch is lit by `smooth_normals`.
        body: Triangles before those of the patches, with textures and normals of their own, but
            without holes, gloss and emission, and of one albedo each.
    """
    parts = tuple(parts)
    assert all(material.texture is None for _, material in parts), "patches have no textures"
    counts = [len(patch.corners) for patch, _ in parts]
    corners = np.concatenate([np.zeros((0, 3, 3)), *(patch.corners for patch, _ in parts)])
    # Unit normals from the winding, as in scene_mesh; a degenerate triangle keeps a zero normal.
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    unlit = np.repeat(np.array([material.unlit for _, material in parts], dtype=bool), counts)
    albedo = np.array([material.albedo for _, material in parts]).reshape(-1, 3)
    albedo = np.repeat(albedo, counts, axis=0)
    normals = cross / np.where(length > 0.0, length, 1.0)
    at_corners = bent = None
    if is_smooth:
        of_parts = np.split(normals, np.cumsum(counts)[:-1])
        patches = [patch.corners for patch, _ in parts]
        at_corners = np.concatenate(list(map(smooth_normals, patches, of_parts)))
        bent = (at_corners != normals[:, None]).any(axis=(1, 2)) & ~unlit
    looks: dict[str, Any] = {}
    if body is not None:
        looks = _find_looks(body, len(corners))
        if at_corners is not None or body.corner_normals is not None:
            flat = [np.repeat(of[:, None], 3, axis=1) for of in (body.normals, normals)]
            own = (body.corner_normals, at_corners)
            at_corners = np.concatenate(
                [f if n is None else n for f, n in zip(flat, own, strict=True)]
            )
        corners = np.concatenate((body.corners, corners))
        normals = np.concatenate((body.normals, normals))
        albedo = np.concatenate((body.albedo, albedo))
        unlit = np.concatenate((body.unlit, unlit))
        if at_corners is not None:
            bent = (at_corners != normals[:, None]).any(axis=(1, 2)) & ~unlit
    # The box's centre, a closed form; the smallest sphere has another.
    centre: Floats = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
    mesh = ObjectMesh(
        corners=corners,
        normals=normals,
        albedo=albedo,
        unlit=unlit,
        centre=centre,
        radius_m=float(np.linalg.norm(corners - centre, axis=-1).max()),
        half_size_m=np.abs(corners - centre).max(axis=(0, 1)),
        corner_normals=at_corners,
        bent=bent,
        **looks,
    )
    shared = (mesh.corners, mesh.normals, mesh.albedo, mesh.unlit, mesh.centre, mesh.half_size_m)
    smooth = () if at_corners is None or bent is None else (at_corners, bent)
    for array in (*shared, *smooth):
        # Shared by all objects of a class and by caches that are keyed by the mesh.
        array.setflags(write=False)
    return mesh


@lru_cache(maxsize=64)
def find_body(mesh: ObjectMesh) -> tuple[float, ...]:
    """Centre and half sides of the box about what is massive of an object, in its frame, metres.

    A mast is not: along each axis a twentieth of the surface is beyond either end.
    """
    first, second, third = np.moveaxis(mesh.corners, 1, 0)
    area = np.linalg.norm(np.cross(second - first, third - first), axis=-1)
    ends = []
    for values in mesh.corners.mean(axis=1).T:
        order = np.argsort(values, kind="stable")
        covered = np.cumsum(area[order]) / area.sum()
        ends.append(values[order[np.searchsorted(covered, _MASSIVE)]])
    low, high = np.array(ends).T
    return (*(0.5 * (low + high)).tolist(), *(0.5 * (high - low)).tolist())


def _find_looks(body: SceneMesh, num_others: int) -> dict[str, Any]:
    """Members of an object's textures, of a body before other triangles; none without textures."""
    if not body.textures:
        return {}
    others = np.full(num_others, -1, dtype=np.int32)
    return {
        "uv": np.concatenate((body.uv, no_texture_coordinates(num_others))),
        "texture_index": np.concatenate((body.texture_index, others)),
        "textures": body.textures,
        "samplings": body.samplings,
    }


class OrientedBox(NamedTuple):
    """Box centred on its pose."""

    world_from_box: Pose
    size_m: tuple[float, float, float]


def box_distances(boxes: Sequence[OrientedBox], origins: Floats, directions: Floats) -> Floats:
    """Distance along rays to the nearest box, world frame.

    Args:
        origins: (n, 3) points.
        directions: (n, 3) unit directions.

    Returns:
        (n,) metres; inf for a ray that misses, 0 for an origin inside a box.
    """
    if not boxes:
        return np.full(len(directions), np.inf)
    nearest: Floats = _distances_by_box(boxes, origins, directions).min(axis=0)
    return nearest


def closest_box_hits(
    boxes: Sequence[OrientedBox], origins: Floats, directions: Floats
) -> tuple[Floats, Floats]:
    """Distance as by `box_distances`, and the (n, 3) unit normals at the hits; 0 for a miss.

    From inside a box the normal faces the ray.
    """
    normals = np.zeros(directions.shape)
    if not boxes:
        return np.full(len(directions), np.inf), normals
    distances = _distances_by_box(boxes, origins, directions)
    nearest: Floats = distances.min(axis=0)
    # Box by box: few boxes are the nearest one of any ray.
    nearest_box = np.where(np.isfinite(nearest), distances.argmin(axis=0), -1)
    for index in np.unique(nearest_box[nearest_box >= 0]):
        rays = nearest_box == index
        normals[rays] = _box_normals(boxes[index], origins[rays], directions[rays])
    return nearest, normals


# Replaces a direction component of 0: the slab is then crossed at +-1e200 times a length, behind
# every distance and still finite.
_MIN_DIRECTION_COMPONENT = 1e-200


def _distances_by_box(boxes: Sequence[OrientedBox], origins: Floats, directions: Floats) -> Floats:
    """(k, n) distances along n rays to k boxes; see `box_distances`."""
    rotations = np.stack([box.world_from_box.rotation for box in boxes])
    centres = np.stack([box.world_from_box.translation for box in boxes])
    half = 0.5 * np.array([box.size_m for box in boxes]).T[..., None]
    # (3, k, n), components first, all boxes at once: 0.2 ms for 400 rays and 7 boxes, 0.5 ms box by
    # box; measured in tests/measurements/sensor_times.py.
    start = (
        _components_in_boxes(rotations, origins)
        - einsum("ki,kij->jk", centres, rotations)[..., None]
    )
    along = _components_in_boxes(rotations, directions)
    return _slab_hits(
        start,
        np.where(np.abs(along) < _MIN_DIRECTION_COMPONENT, _MIN_DIRECTION_COMPONENT, along),
        half,
    )


def _box_normals(box: OrientedBox, origins: Floats, directions: Floats) -> Floats:
    """(n, 3) normals of the faces through which rays enter a box."""
    rotation = box.world_from_box.rotation
    start = matmul(origins - box.world_from_box.translation, rotation)
    along = matmul(directions, rotation)
    along = np.where(np.abs(along) < _MIN_DIRECTION_COMPONENT, _MIN_DIRECTION_COMPONENT, along)
    enter = (-np.copysign(0.5 * np.array(box.size_m), along) - start) / along
    face = enter.argmax(axis=1)
    rows = np.arange(len(directions))
    normals: Floats = -np.sign(along[rows, face])[:, None] * rotation.T[face]
    return np.where(enter[rows, face, None] > 0.0, normals, -directions)


def _components_in_boxes(rotations: Floats, vectors: Floats) -> Floats:
    """(3, k, n) components of (n, 3) vectors along the axes of k boxes."""
    count = len(rotations)
    columns = rotations.transpose(1, 2, 0).reshape(3, 3 * count)
    return np.ascontiguousarray(matmul(vectors, columns).T).reshape(3, count, -1)


def _slab_hits(start: Floats, along: Floats, half: Floats) -> Floats:
    """(k, n) distances to k boxes, each the intersection of three slabs."""
    first, second = (-half - start) / along, (half - start) / along
    enter = np.minimum(first, second).max(axis=0)
    leave = np.maximum(first, second).min(axis=0)
    is_hit: Bools = (enter <= leave) & (leave >= 0.0)
    return np.where(is_hit, np.maximum(enter, 0.0), np.inf)


@dataclass(frozen=True, slots=True)
class NoiseSeed:
    """Key of a camera and of an exposure, for counter-based random numbers."""

    camera_key: tuple[int, int] = (0, 0)
    """Two 32-bit words that identify the camera."""
    tick: int = 0
    """Tick of the robot at the exposure; not a count of frames."""

    @classmethod
    def from_source(cls, source: RandomSource, tick: int) -> NoiseSeed:
        """Seed of the exposure at a tick, of the camera that a random source belongs to."""
        word = source.key[0]
        return cls((word & 0xFFFFFFFF, word >> 32), tick)


ZERO_SEED = NoiseSeed()


@dataclass(frozen=True, slots=True, eq=False)
class CameraState:
    """State of a camera in one exposure."""

    world_from_mirror: Pose
    """Mirror frame of an omnidirectional camera, its origin the effective viewpoint; the camera
    frame (x ahead, y right, z down) of a perspective camera."""
    objects: tuple[DynamicObject, ...] = ()
    """Dynamic objects in view beside the scene, without the robot that carries the camera."""
    noise_seed: NoiseSeed = ZERO_SEED
    """Seed of the image noise, read only by effects that draw random numbers."""
    twist: Twist = AT_REST
    """Motion of the frame in the world, referred to the frame's origin."""
    ego_body: DynamicObject | None = None
    """Robot that carries the camera; in view only after the effect `SelfView` has added this body
    to `objects`."""
    has_shadows: bool = False
    """Whether surfaces occlude directional and point lights."""
    has_gloss: bool = False
    """Whether glossy surfaces show what they mirror."""
    has_baked_light: bool = True
    """Whether baked light differs between the points of a surface, where a world has any."""
    has_sky: bool = True
    """Whether the sky differs by direction, where a world has one."""
    fog: FogMedium | None = None
    """Air between camera and surfaces; None for clear air."""
    shutter: Shutter | None = None
    """Exposure and readout times; None for an exposure too short for any motion to show."""


def scene_twist_in_mirror(camera_state: CameraState) -> Twist:
    """Motion of the static scene as the camera sees it: in the mirror frame, at the viewpoint."""
    if camera_state.twist is AT_REST:
        return AT_REST
    # Plain floats: computed for every frame, and a tenth of the time of arrays of three.
    axes = camera_state.world_from_mirror.rotation.T.tolist()
    linear, angular = (
        tuple(-(a * x + b * y + c * z) for a, b, c in axes)
        for x, y, z in (camera_state.twist.linear_m_s, camera_state.twist.angular_rad_s)
    )
    return Twist(linear, angular)


@dataclass(frozen=True, slots=True)
class FogMedium:
    """Homogeneous fog of one density and colour."""

    density_per_m: float
    """Extinction beta; above 0."""
    airlight: tuple[float, float, float]
    """Linear radiance of an infinite depth of fog."""

    @np.errstate(under="ignore")  # exp of a large optical depth is 0, as intended
    def transmittance(self, range_m: Floats) -> Floats:
        """(...) fraction of light that passes (...) ranges, metres or inf."""
        return np.asarray(exp(-self.density_per_m * range_m))

    def mix(self, radiance: Floats, range_m: Floats) -> Floats:
        """(..., 3) linear radiance behind fog, of radiance at (...) ranges, metres or inf."""
        transmittance = self.transmittance(range_m)[..., None]
        mixed: Floats = radiance * transmittance + np.asarray(self.airlight) * (1.0 - transmittance)
        return mixed


# One time sample alone would be a sharp image, however far objects move.
_MIN_TIME_SAMPLES, MAX_TIME_SAMPLES = 2, 64
# Pixels between time samples; a quarter for rows with one slot alone (see above).
_MAX_STEP_PX, _MAX_ROW_STEP_PX = 1.0, 0.25

RowWeights = npt.NDArray[np.float32]  # (rows,)


@dataclass(frozen=True, slots=True)
class Shutter:
    """Exposure and readout times, with the displacement that the time samples have to resolve."""

    exposure_s: float
    """Exposure time of a row."""
    readout_s: float
    """Time between the exposures of the first row and of a row after the last; 0: all at once."""
    num_steps: float
    """Displacement during both times, in steps that a slot may have; any number."""
    max_time_samples: int = MAX_TIME_SAMPLES
    """Limit of the number of slots; fewer than there are steps blur the image in steps."""

    def add_exposure(self, exposure_s: float, displacement_px: float) -> Shutter:
        """Shutter with an exposure time, for the largest displacement in that time."""
        num_steps = self.num_steps + displacement_px / _MAX_STEP_PX
        return replace(self, exposure_s=exposure_s, num_steps=num_steps)

    def add_readout(self, readout_s: float, displacement_px: float) -> Shutter:
        """Shutter with a readout time, for the displacement from the first row to the last."""
        num_steps = self.num_steps + displacement_px / _MAX_ROW_STEP_PX
        return replace(self, readout_s=readout_s, num_steps=num_steps)

    @property
    def num_time_samples(self) -> int:
        """Number of slots, each one rendering."""
        # Rounded here and not in each step: two effects that need 1.5 slots each need 3, not 4.
        return max(math.ceil(min(self.num_steps, self.max_time_samples)), _MIN_TIME_SAMPLES)

    @property
    def times_s(self) -> tuple[float, ...]:
        """Centres of the slots, seconds from the pose."""
        total_s, count = self.exposure_s + self.readout_s, self.num_time_samples
        return tuple(((i + 0.5) / count - 0.5) * total_s for i in range(count))

    def row_weights(self, num_rows: int) -> npt.NDArray[np.float32]:
        """(num_time_samples, num_rows) weight of each slot in each row."""
        total_s, count = self.exposure_s + self.readout_s, self.num_time_samples
        centre_s = self.readout_s * ((np.arange(num_rows) + 0.5) / num_rows - 0.5)
        edges_s = (np.arange(count + 1) / count - 0.5) * total_s
        # A row of no duration shows exactly one slot; the fraction below would be 0 / 0.
        if self.exposure_s == 0.0:
            slot = np.searchsorted(edges_s[1:-1], centre_s, side="right")
            return np.equal.outer(np.arange(count), slot).astype(np.float32)
        begin_s, end_s = centre_s - 0.5 * self.exposure_s, centre_s + 0.5 * self.exposure_s
        within_s = np.diff(np.clip(edges_s[:, None], begin_s, end_s), axis=0)
        fractions: npt.NDArray[np.float32] = (within_s / self.exposure_s).astype(np.float32)
        return fractions


# Start of the effects that lengthen an exposure: neither time lasts yet.
INSTANTANEOUS = Shutter(0.0, 0.0, 0.0)
