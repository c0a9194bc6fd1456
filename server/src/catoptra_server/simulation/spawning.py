"""Class, place, name and shape of a new robot, from the parameters of INIT.

A robot is spawned where it touches nothing: a base in contact could hardly move, and robots inside
each other fill each other's images. A place that is not free is replaced by the nearest free one of
the same heading, within 8 m.

Other robots see a chassis on wheels, and an omnidirectional camera's tower. These are built from
the dimensions that the robot reports itself; USARSim's own meshes are not public, so the shapes in
between are ours. Frame: robot (SAE, origin in the chassis).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.names import list_names
from catoptra_protocol.optics.elementary import cos, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats, wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.commands import Init
from catoptra_protocol.usarsim.reports import StartPose
from catoptra_server.frames.image_port import CameraRobot
from catoptra_server.simulation.drive import RobotBody
from catoptra_server.simulation.ground import NoStandError
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from catoptra_server.world.objects import DynamicObject, ObjectMesh, build_object_mesh
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shapes import Patch, box, build_shape, grid
from catoptra_server.world.world_description import Box, Cylinder, Material, World


@dataclass(frozen=True, slots=True)
class RobotDimensions:
    """Outer dimensions of a robot."""

    dimensions_m: tuple[float, float, float]
    """Length, width, height."""
    ride_height_m: float
    wheel_radius_m: float
    wheel_base_m: float
    """Distance of the axles; 0 for one pair of wheels, in the centre."""
    is_smooth: bool = False
    """Whether round parts are lit as such, and not facet by facet."""
    body: SceneMesh | None = None
    """What is shown in place of chassis and wheels."""


@dataclass(frozen=True, slots=True, eq=False)
class OmniCameraTower:
    """Omnidirectional camera on a robot."""

    camera: OmniCamera
    robot_from_mirror: Pose
    """Mirror frame on the robot; its origin is the effective viewpoint."""


def build_robot_mesh(shape: RobotDimensions, tower: OmniCameraTower | None = None) -> ObjectMesh:
    """Build the mesh of a class of robots; `tower` None: without an omnidirectional camera."""
    parts = _body_parts(shape)
    if tower is not None:
        parts += _tower_parts(tower, deck_z=_deck_z(shape))
    return build_object_mesh(parts, is_smooth=shape.is_smooth, body=shape.body)


def build_ego_body_mesh(shape: RobotDimensions, tower: OmniCameraTower) -> ObjectMesh:
    """Build the mesh of a robot as its own mirror sees the robot.

    The mirror and the glass that carries the mirror are left out: neither is in the mirror's view.
    """
    return build_object_mesh(
        [
            *_body_parts(shape),
            *_capture_camera_parts(tower, deck_z=_deck_z(shape)),
        ],
        is_smooth=shape.is_smooth,
        body=shape.body,
    )


_CHASSIS_MATERIAL = Material((0.45, 0.04, 0.03))  # ActivMedia's red paint
_DECK_MATERIAL = Material((0.04, 0.04, 0.04))
_TYRE_MATERIAL = Material((0.03, 0.03, 0.03))
_MIRROR_MATERIAL = Material((0.55, 0.55, 0.55))
_HOUSING_MATERIAL = Material((0.12, 0.12, 0.12))
_LENS_MATERIAL = Material((0.01, 0.01, 0.015))

_DECK_THICKNESS_M = 0.01  # the black top plate
_PILLAR_RADIUS_M = 0.03
# Housing of a board camera, with the lens ahead; the lens ends at the pinhole.
CAMERA_RADIUS_M, CAMERA_LENGTH_M = 0.025, 0.05
LENS_RADIUS_M, LENS_LENGTH_M = 0.012, 0.003
_SUPPORT_RADIUS_M = 0.005  # a rod in place of the glass tube
# A tyre's width as a fraction of the wheel's radius: 50 mm on a P2AT, so that tyres end with the
# robot's side.
_TYRE_WIDTH_RATIO = 0.4
# Facets around a wheel and a mirror, and rings down the mirror: round from two metres at 640 px.
_SECTORS, _RINGS = 20, 5

_MaterialPatch = tuple[Patch, Material]


def _deck_z(shape: RobotDimensions) -> float:
    """z of the deck."""
    # The UDK's P3AT reports no height: its wheels' then.
    height = shape.dimensions_m[2] or 2.0 * shape.wheel_radius_m
    return shape.ride_height_m - height


def _body_parts(shape: RobotDimensions) -> list[_MaterialPatch]:
    return [*_chassis_parts(shape), *_wheel_parts(shape)] if shape.body is None else []


def _chassis_parts(shape: RobotDimensions) -> Iterator[_MaterialPatch]:
    """Yield a box between the wheels, from half their radius above the floor, and the deck."""
    length, width, _ = shape.dimensions_m
    inner = width - 2.0 * _TYRE_WIDTH_RATIO * shape.wheel_radius_m
    top, bottom = _deck_z(shape), shape.ride_height_m - 0.5 * shape.wheel_radius_m
    centre_z = 0.5 * (top + _DECK_THICKNESS_M + bottom)
    hull = box(Box((length, inner, bottom - top - _DECK_THICKNESS_M)))
    yield hull.translate((0.0, 0.0, centre_z)), _CHASSIS_MATERIAL
    plate = box(Box((length, inner, _DECK_THICKNESS_M)))
    yield plate.translate((0.0, 0.0, top + 0.5 * _DECK_THICKNESS_M)), _DECK_MATERIAL


def _wheel_parts(shape: RobotDimensions) -> Iterator[_MaterialPatch]:
    """Yield wheels on the floor whose outer sides are the robot's."""
    width = _TYRE_WIDTH_RATIO * shape.wheel_radius_m
    tyre = build_shape(Cylinder(shape.wheel_radius_m, width, _SECTORS))
    lateral = 0.5 * (shape.dimensions_m[1] - width)
    z = shape.ride_height_m - shape.wheel_radius_m
    # A set: a wheel base of 0 gives one pair, not two in one another.
    for x in sorted({-0.5 * shape.wheel_base_m, 0.5 * shape.wheel_base_m}):
        for y in (-lateral, lateral):
            lying = Pose.from_rpy((x, y, z), (0.5 * math.pi, 0.0, 0.0))
            yield Patch(lying.transform_points(tyre.corners), tyre.uv), _TYRE_MATERIAL


def _tower_parts(tower: OmniCameraTower, *, deck_z: float) -> Iterator[_MaterialPatch]:
    """Yield the pillar up to the capture camera, the mirror above, and the mirror's support.

    An orthographic capture camera has no position: its pillar ends at the deck.
    """
    surface = _mirror_patch(tower.camera)
    patch = Patch(tower.robot_from_mirror.transform_points(surface.corners), surface.uv)
    yield patch, _MIRROR_MATERIAL
    lens_z = _lens_z(tower, deck_z)
    apex_z = float(patch.corners[..., 2].max())
    yield from _cylinder_parts(tower, _PILLAR_RADIUS_M, deck_z, lens_z, _DECK_MATERIAL)
    yield from _cylinder_parts(tower, _SUPPORT_RADIUS_M, lens_z, apex_z, _DECK_MATERIAL)


def _capture_camera_parts(tower: OmniCameraTower, *, deck_z: float) -> Iterator[_MaterialPatch]:
    """Yield the pillar, the capture camera's housing on top, and the lens up to the pinhole.

    A pinhole near the deck sinks the camera into the robot.
    """
    lens_z = _lens_z(tower, deck_z)
    top_z = min(lens_z + LENS_LENGTH_M, deck_z)
    foot_z = min(top_z + CAMERA_LENGTH_M, deck_z)
    yield from _cylinder_parts(tower, _PILLAR_RADIUS_M, deck_z, foot_z, _DECK_MATERIAL)
    yield from _cylinder_parts(tower, CAMERA_RADIUS_M, foot_z, top_z, _HOUSING_MATERIAL)
    yield from _cylinder_parts(tower, LENS_RADIUS_M, top_z, lens_z, _LENS_MATERIAL)


def _lens_z(tower: OmniCameraTower, deck_z: float) -> float:
    """z of the pinhole; z of the deck for a pinhole below the deck or at infinity."""
    viewpoint_z = float(tower.robot_from_mirror.translation[2])
    return min(viewpoint_z + tower.camera.mirror.pinhole_distance_m, deck_z)


def _cylinder_parts(
    tower: OmniCameraTower, radius_m: float, low_z: float, high_z: float, material: Material
) -> Iterator[_MaterialPatch]:
    """Yield an upright cylinder under the viewpoint, if of positive length; z grows downwards."""
    if low_z > high_z:
        x, y, _ = tower.robot_from_mirror.translation.tolist()
        post = build_shape(Cylinder(radius_m, low_z - high_z, _SECTORS))
        yield post.translate((x, y, 0.5 * (low_z + high_z))), material


def _mirror_patch(camera: OmniCamera) -> Patch:
    """Mirror surface up to the rim, and the disc that closes the back; mirror frame."""
    # A cone reflects nothing nearer to its axis than its apex does.
    t = np.linspace(camera.projection.t_min, camera.rim_t, _RINGS + 1)
    r, z = camera.mirror.surface_point(t)
    azimuth = -2.0 * math.pi * np.arange(_SECTORS + 1) / _SECTORS
    # Profile from the axis outward along the mirror, then back to the axis at the rim's height.
    radius, height = np.append(r, 0.0)[:, None], np.append(z, z[-1])[:, None]
    points = np.stack(
        (radius * cos(azimuth), radius * sin(azimuth), height + 0.0 * azimuth), axis=-1
    )
    return grid(points, np.zeros((*points.shape[:2], 2)))


class Places(Protocol):
    """Where robots of a class stand, among the present ones."""

    def place(
        self,
        description: RobotDescription,
        pose: PlanarPose,
        z_m: float = 0.0,
        *,
        clearance_m: float = 0.0,
        robots: Iterable[Robot] = (),
    ) -> RobotBody:
        """Base at rest at a place; raises NoStandError."""

    def may_stand(
        self,
        description: RobotDescription,
        places: Floats,
        yaw_rad: float,
        z_m: float,
        clearance_m: float,
        robots: Iterable[Robot],
    ) -> Bools:
        """(n,) whether a test of places, (n, 2), is worth while."""


class SpawnError(CatoptraError):
    """INIT spawns no robot; the message is the reason, in words for the client."""


def place_robot(
    init: Init,
    classes: Sequence[RobotDescription],
    starts: Sequence[StartPose],
    ground: Places,
    robots: Collection[Robot],
) -> tuple[RobotDescription, RobotBody, bool]:
    """Class of a new robot, its base, and whether that stands elsewhere than requested.

    The base stands at the requested place if it can, else at the nearest one with room within 8 m.

    Args:
        init: The request.
        classes: Classes that it may name.
        starts: Start places that it may name.
        ground: What robots stand on.
        robots: Present robots.

    Raises:
        SpawnError: No class, start or free place answers to INIT.
    """
    description = find_class(classes, init.class_name)
    requested, z_m = _spawn_pose(init, starts)
    try:
        body = ground.place(description, requested, z_m, robots=robots)
    except NoStandError as error:
        return description, _find_place(description, requested, z_m, ground, robots, error), True
    wheels_m = float(body.world_from_robot.translation[2]) + description.drive.ride_height_m
    return description, body, not -_NEAR_M <= wheels_m - z_m <= _FAR_BELOW_M


def find_class(classes: Sequence[RobotDescription], name: str) -> RobotDescription:
    """First class of a name in any case, with or without the package.

    Raises:
        SpawnError: There is none.
    """
    for known in classes:
        if name.lower() in (known.class_name.lower(), known.model_name.lower()):
            return known
    names = list_names(name, (known.class_name for known in classes))
    raise SpawnError(f"there is no class {name!r}: this server has {names}")


def unique_name(requested: str, existing: Collection[str]) -> str:
    """Requested name, followed by the smallest number from 2 that makes the name unique."""
    if requested not in existing:
        return requested
    # Among n + 1 candidates at least one is not among n existing names.
    numbered = (f"{requested}{number}" for number in range(2, len(existing) + 3))
    return next(name for name in numbered if name not in existing)


class RobotMeshes:
    """The meshes of a fleet's classes, built once."""

    def __init__(self, descriptions: Sequence[RobotDescription]) -> None:
        # Renderers recognize a mesh by identity: a mesh built anew would be uploaded anew.
        self._meshes = {
            d.class_name: build_robot_mesh(_dimensions(d), _tower(d)) for d in descriptions
        }
        self._ego_meshes = {d.class_name: build_ego_mesh(d) for d in descriptions}
        # Forgotten with its robot.
        self._objects: WeakKeyDictionary[CameraRobot, DynamicObject] = WeakKeyDictionary()

    def dynamic_objects(self, robots: Iterable[CameraRobot]) -> tuple[DynamicObject, ...]:
        """Robots as dynamic objects, at their present poses; the same in all views of a tick."""
        return tuple(map(self._find_object, robots))

    def _find_object(self, robot: CameraRobot) -> DynamicObject:
        found = self._objects.get(robot)
        if (
            found is None
            or found.world_from_object is not robot.world_from_robot
            or found.twist is not robot.twist
        ):
            found = self._objects[robot] = _place_mesh(self._meshes[robot.class_name], robot)
        return found

    def ego_body(self, robot: CameraRobot) -> DynamicObject | None:
        """Parts of a robot that its own mirror may show; None unless the effect is configured."""
        mesh = self._ego_meshes[robot.class_name]
        if mesh is None:
            return None
        return _place_mesh(mesh, robot)


def build_ego_mesh(description: RobotDescription) -> ObjectMesh | None:
    """Mesh of a class as its own mirror shows the body; None unless the effect is configured."""
    omni = description.mirror_camera
    if omni is None:
        return None
    is_configured = any(setting.effect.name == "SelfView" for setting in omni.effects.settings)
    # Only where configured: a mesh that no effect shows is never built.
    return build_carrier_mesh(description) if is_configured else None


def build_carrier_mesh(description: RobotDescription) -> ObjectMesh:
    """Mesh of the body below an omnidirectional camera, without what carries mirror or lens."""
    shape, tower = _dimensions(description), _tower(description)
    return build_robot_mesh(shape) if tower is None else build_ego_body_mesh(shape, tower)


# As far as landmarks may lie. The scene is drawn in float32, which rounds coordinates of 1e5 m to
# 8 mm; a place beyond 1e18 m has no cell number in 64 bits.
_MAX_COORDINATE_M = 1e5
# Far above any number of turns that a client could mean, and still wrapped to 1e-10 rad.
_MAX_ANGLE_RAD = 1e6


def _spawn_pose(init: Init, starts: Sequence[StartPose]) -> tuple[PlanarPose, float]:
    """Requested pose of a new robot, and z; the location precedes the start.

    Roll and pitch of either are ignored: they follow from what the base stands on.

    Raises:
        SpawnError: There is no such start, or the place is out of limits.
    """
    if init.location_m is not None:
        location_m, rotation_rad = init.location_m, init.rotation_rad
    else:
        start = _find_start(init.start, starts)
        location_m, rotation_rad = start.location_m, start.rotation_rad
    _check_limits("Location", location_m, _MAX_COORDINATE_M)
    _check_limits("Rotation", rotation_rad, _MAX_ANGLE_RAD)
    x_m, y_m, z_m = location_m
    return PlanarPose(x_m, y_m, wrap_angle(rotation_rad[2])), z_m


def _find_start(name: str | None, starts: Sequence[StartPose]) -> StartPose:
    # The first start of the name wins, as for classes.
    for start in starts:
        if name is not None and start.name.lower() == name.lower():
            return start
    names = list_names(name or "", (start.name for start in starts))
    what = "a robot needs a start or a Location" if name is None else f"there is no start {name!r}"
    raise SpawnError(f"{what}: this world has {names}")


def _check_limits(key: str, values: tuple[float, float, float], limit: float) -> None:
    # A comparison with NaN is false: it is out of limits, too.
    if not all(abs(value) <= limit for value in values):
        text = ",".join(f"{value:g}" for value in values)
        raise SpawnError(f"{key} {text} is out of limits: each number is at most {limit:g}")


# Radius and step of two grids. Sixteen robots of half a metre find places about one in the first,
# side by side, by steps of a fifth of a base. Around 62 of another client only the second has room.
_SEARCH_GRIDS_M = ((2.0, 0.1), (8.0, 0.4))
# Places that are tried in earnest, 0.3 ms each, of those that may have room.
_MAX_TRIES = 100
# How far below the requested height a floor is, and how far above, without being another place.
_FAR_BELOW_M, _NEAR_M = 2.1, 0.1
# Left on all sides of a robot that is moved: room to turn a little, and to drive off.
_CLEARANCE_M = 0.02


def _find_place(
    description: RobotDescription,
    requested: PlanarPose,
    z_m: float,
    ground: Places,
    robots: Collection[Robot],
    reason: NoStandError,
) -> RobotBody:
    """Base at the nearest place where it stands, of the requested heading.

    Raises:
        SpawnError: There is none.
    """
    cosine, sine = cos(requested.yaw_rad), sin(requested.yaw_rad)
    here = np.array([[requested.x_m, requested.y_m]])
    places = here + matmul(_search_offsets_m(), np.array([[cosine, sine], [-sine, cosine]]))
    may_stand = ground.may_stand(description, places, requested.yaw_rad, z_m, _CLEARANCE_M, robots)
    # No INIT takes the time of more than two ticks.
    for x, y in places[may_stand][:_MAX_TRIES].tolist():
        pose = replace(requested, x_m=x, y_m=y)
        with suppress(NoStandError):
            return ground.place(description, pose, z_m, clearance_m=_CLEARANCE_M, robots=robots)
    raise SpawnError(
        f"there is no free place within {_SEARCH_GRIDS_M[-1][0]:g} m of "
        f"{requested.x_m:g},{requested.y_m:g}, where {reason}"
    )


# At the first occupied place: 2 ms of a start, which few starts need.
@lru_cache(maxsize=1)
def _search_offsets_m() -> Floats:
    """(n, 2) offsets of the grids along the heading, the nearest of each first."""
    offsets: list[Floats] = []
    inner_m = 0.0
    for radius_m, step_m in _SEARCH_GRIDS_M:
        # Along the heading, so that bases of equal heading fit side by side.
        num_steps = round(radius_m / step_m)
        steps = range(-num_steps, num_steps + 1)
        # Squares of whole numbers: equal distances are equal, and ties have a fixed order.
        ranked = sorted((i * i + j * j, i, j) for i in steps for j in steps)
        first = np.square(inner_m / step_m)
        near = [(i, j) for square, i, j in ranked if first < square <= num_steps**2]
        offsets.append(step_m * np.array(near, dtype=float))
        inner_m = radius_m
    return np.concatenate(offsets)


def _place_mesh(mesh: ObjectMesh, robot: CameraRobot) -> DynamicObject:
    return DynamicObject(mesh, robot.world_from_robot, robot.twist, robot.name, robot.number)


def _dimensions(description: RobotDescription) -> RobotDimensions:
    drive = description.drive
    return RobotDimensions(
        drive.dimensions_m,
        drive.ride_height_m,
        drive.wheel_radius_m,
        drive.wheel_base_m,
        description.is_smooth,
        _build_body(description),
    )


# A class has two meshes, of one body.
@lru_cache(maxsize=4)
def _build_body(description: RobotDescription) -> SceneMesh | None:
    """Body of a class whose file has items; raises ConfigError as `build_scene`."""
    if not description.items:
        return None
    return build_scene(World(description.class_name, description.items))


def _tower(description: RobotDescription) -> OmniCameraTower | None:
    omni = description.mirror_camera
    return OmniCameraTower(omni.camera, omni.robot_from_mirror) if omni else None
