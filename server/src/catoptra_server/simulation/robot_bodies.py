"""Bodies of robots: the meshes that cameras show, built from the numbers of a robot's file.

USARSim's own meshes are not public, so the shapes between the reported dimensions are ours. A plain
body is a box with a deck on discs, with an omnidirectional camera's tower: the paper's camera sees
itself on one. Every other body is made of parts: hull, deck, wheels with tread or tracks, a castor,
and what the file says of sensors, cameras and joints. A file's own shapes take the place of either,
beside the tower. Sonars stand where their beams leave the hull; a laser scanner whose place is
within the hull is a window in its nose.

Links that joints turn are objects of their own, with the robot's number: one object in labels,
whose box is the body's. A robot's own mirror shows them at rest. Wheels do not turn.

Collisions, sensors and ground contact have shapes of their own (`chassis`). Frame: robot (SAE,
origin in the chassis).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.elementary import cos, power, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.configurations import CHASSIS_MOUNT
from catoptra_server.simulation.robot_description import (
    LinkDescription,
    PerspectiveCameraDescription,
    RobotDescription,
)
from catoptra_server.world.lofts import (
    belt,
    block,
    distance_out,
    loft,
    octagon,
    plate,
    prism,
    revolve,
    transform,
    tube,
)
from catoptra_server.world.objects import ObjectMesh, build_object_mesh
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shapes import Patch, box, build_shape, concatenate, grid
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
    items: SceneMesh | None = None
    """What is shown in place of chassis and wheels."""


@dataclass(frozen=True, slots=True, eq=False)
class OmniCameraTower:
    """Omnidirectional camera on a robot."""

    camera: OmniCamera
    robot_from_mirror: Pose
    """Mirror frame on the robot; its origin is the effective viewpoint."""


def build_robot_mesh(shape: RobotDimensions, tower: OmniCameraTower | None = None) -> ObjectMesh:
    """Build the mesh of a class of robots; `tower` None: without an omnidirectional camera."""
    return _build_plain(shape, _tower_parts(tower, deck_z=_deck_z(shape)) if tower else ())


def build_ego_body_mesh(shape: RobotDimensions, tower: OmniCameraTower) -> ObjectMesh:
    """Build the mesh of a robot as its own mirror sees the robot.

    The mirror and the glass that carries the mirror are left out: neither is in the mirror's view.
    """
    return _build_plain(shape, _capture_camera_parts(tower, deck_z=_deck_z(shape)))


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


def _build_plain(shape: RobotDimensions, carried: Iterable[_MaterialPatch]) -> ObjectMesh:
    own = [*_chassis_parts(shape), *_wheel_parts(shape)] if shape.items is None else []
    return build_object_mesh([*own, *carried], is_smooth=shape.is_smooth, body=shape.items)


def _chassis_parts(shape: RobotDimensions) -> Iterator[_MaterialPatch]:
    """Yield a box between the wheels, from half their radius above the floor, and the deck."""
    length, width, _ = shape.dimensions_m
    inner = width - 2.0 * _TYRE_WIDTH_RATIO * shape.wheel_radius_m
    deck, bottom = _deck_z(shape), shape.ride_height_m - 0.5 * shape.wheel_radius_m
    top = deck + _DECK_THICKNESS_M
    for low, high, material in ((bottom, top, _CHASSIS_MATERIAL), (top, deck, _DECK_MATERIAL)):
        slab = box(Box((length, inner, low - high)))
        yield slab.translate((0.0, 0.0, 0.5 * (low + high))), material


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
            yield transform(tyre, lying), _TYRE_MATERIAL


def _tower_parts(tower: OmniCameraTower, *, deck_z: float) -> Iterator[_MaterialPatch]:
    """Yield the pillar up to the capture camera, the mirror above, and the mirror's support.

    An orthographic capture camera has no position: its pillar ends at the deck.
    """
    mirror, lens_z = _mirror_patch(tower), _lens_z(tower, deck_z)
    yield mirror, _MIRROR_MATERIAL
    apex_z = float(mirror.corners[..., 2].max())
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


def _mirror_patch(tower: OmniCameraTower) -> Patch:
    """Mirror surface up to the rim, and the disc that closes the back."""
    camera = tower.camera
    # A cone reflects nothing nearer to its axis than its apex does.
    t = np.linspace(camera.projection.t_min, camera.rim_t, _RINGS + 1)
    r, z = camera.mirror.surface_point(t)
    azimuth = -2.0 * math.pi * np.arange(_SECTORS + 1) / _SECTORS
    # Profile from the axis outward along the mirror, then back to the axis at the rim's height.
    radius, height = np.append(r, 0.0)[:, None], np.append(z, z[-1])[:, None]
    points = np.stack(
        (radius * cos(azimuth), radius * sin(azimuth), height + 0.0 * azimuth), axis=-1
    )
    return transform(grid(points, np.zeros((*points.shape[:2], 2))), tower.robot_from_mirror)


# Materials of bodies of parts.
_PAINT_MATERIAL = Material((0.50, 0.035, 0.025))  # ActivMedia's red, a coat of gloss brighter
_PLATE_MATERIAL = Material((0.045, 0.047, 0.05))  # black anodized aluminium
_PLASTIC_MATERIAL = Material((0.02, 0.02, 0.022))
_RUBBER_MATERIAL = Material((0.022, 0.021, 0.02))
_RIM_MATERIAL = Material((0.62, 0.62, 0.60))
_STEEL_MATERIAL = Material((0.42, 0.42, 0.43))
_SONAR_MATERIAL = Material((0.52, 0.38, 0.16))  # the gold foil of an electrostatic transducer
_SCANNER_MATERIAL = Material((0.04, 0.11, 0.30))
_ARM_MATERIAL = Material((0.75, 0.21, 0.02))

_TREAD_RATIO = 0.6  # a tyre's width of parts over its radius: 78 mm on a P2AT, 57 on a P2DX
_LUGS, _TYRE_SECTORS, _RIM_SECTORS = 15, 24, 18
_CASTOR_RADIUS_M = 0.0375
_FLIPPER_REACH = 3.8  # distance of a flipper's axles over its larger radius
_POST_M = 0.06  # a camera's mast stands as far behind it
_SONAR_RADIUS_M, _SONAR_BAND_M = 0.019, 0.026
_ROD_RADIUS_M, _NUM_RODS = 0.004, 3  # hold the mirror; the paper's has a glass tube


class _Base:
    """Measures that the parts of a base share; metres, chassis frame."""

    def __init__(self, description: RobotDescription) -> None:
        drive, joints = description.drive, description.chassis_joints
        self.kind, self.drive, self.description = description.body, drive, description
        length, width, height = drive.collision_size_m
        self.half_length, self.half_width = 0.5 * length, 0.5 * width
        self.radius, self.floor_z = drive.wheel_radius_m, drive.ride_height_m
        # Whatever a file says, there is a hull between the wheels, and one above their axles.
        self.deck_z = self.floor_z - max(height, self.radius + 0.02)
        self.tyre = min(_TREAD_RATIO * self.radius, 0.4 * self.half_width)
        self.hull_y = self.half_width - 1.17 * self.tyre
        self.links = joints.links if joints else ()
        if self.kind == "tracks":
            beside = (abs(one.position_m[1]) - 0.006 for one in self.links if _is_flipper(one))
            self.hull_y = max(min(beside, default=self.half_width), 0.3 * self.half_width)
        self.hull = self.outline(self.hull_y, 0.88 if self.kind == "tracks" else 1.0)

    def outline(self, half_y: float, scale: float) -> Floats:
        """(n, 2) outline from above, of a half width."""
        x = scale * self.half_length
        if self.kind != "castor":
            return octagon(x, half_y, 0.3 * x, 0.5 * half_y)
        angle = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
        c, s = cos(angle), sin(angle)
        round_x, round_y = (np.sign(v) * power(np.abs(v), 0.7) for v in (c, s))
        return np.stack((x * round_x, half_y * round_y), axis=-1)


def _is_flipper(link: LinkDescription) -> bool:
    return link.name.lower().endswith("flipper")


def _body_parts(description: RobotDescription, *, is_own: bool) -> Iterator[_MaterialPatch]:
    """Yield all that no joint turns; without what carries mirror or lens as these see it."""
    base = _Base(description)
    if description.drive.max_speed_rad_s == 0.0:
        top = min((link.position_m[2] for link in base.links), default=base.deck_z)
        r = min(base.half_length, base.half_width)
        foot = [(r, base.floor_z), (r, base.floor_z - 0.05), (0.6 * r, top + 0.05), (0.6 * r, top)]
        yield revolve(foot, 32), _PLATE_MATERIAL
    elif base.kind == "tracks":
        yield from _tracked_parts(base)
    else:
        yield from _wheeled_parts(base)
    yield from _sensor_parts(base)
    for omni in description.omni_cameras:
        if omni.camera.has_mirror:
            tower = OmniCameraTower(omni.camera, omni.robot_from_mirror)
            yield from _fine_tower_parts(tower, base.deck_z, is_own=is_own)
        elif omni.parent == CHASSIS_MOUNT and not is_own:
            pose = omni.robot_from_mirror
            axis = pose.rotate_directions(np.array(omni.camera.optical_axis))
            yield from _housing_parts(pose.translation, axis, base.deck_z)
    for camera in description.perspective_cameras:
        if camera.mount.parent == CHASSIS_MOUNT:
            pose = camera.mount.parent_from_item()
            yield from _housing_parts(pose.translation, pose.rotation[:, 0], base.deck_z)
    for package in description.mission_packages:
        x, y, z = package.links[0].position_m
        if z < base.deck_z:
            profile = [(0.045, base.deck_z), (0.045, z + 0.03), (0.038, z + 0.02), (0.038, z)]
            yield revolve(profile, 24).translate((x, y, 0.0)), _PLASTIC_MATERIAL


def _wheeled_parts(base: _Base) -> Iterator[_MaterialPatch]:
    """Yield hull and deck between and above the wheels, and these."""
    drive, deck_z, radius = base.drive, base.deck_z, base.radius
    bottom_z = base.floor_z - 0.5 * radius
    hull_z, edge = deck_z + _DECK_THICKNESS_M, 0.12 * (bottom_z - deck_z)
    levels = [(bottom_z, edge), (bottom_z - edge, 0.0), (hull_z + 0.3 * edge, 0.0)]
    yield prism(base.hull, [*levels, (hull_z, 0.3 * edge)]), _PAINT_MATERIAL
    # The deck reaches over wheels that end below it.
    is_above = base.floor_z - 2.0 * radius > hull_z
    deck = base.outline(0.8 * base.half_width if is_above else base.hull_y, 1.01)
    yield plate(deck, deck_z, hull_z, 0.003), _PLATE_MATERIAL
    bolt = revolve([(0.006, deck_z), (0.006, deck_z - 0.003)], 6)
    for x, y in (0.92 * deck[:: len(deck) // 8]).tolist():
        yield bolt.translate((x, y, 0.0)), _STEEL_MATERIAL
    y = base.half_width - 0.5 * base.tyre
    if drive.wheels_m:
        places = drive.wheels_m
    elif base.kind == "castor":
        # The base turns about the middle of its driven axle.
        places = ((0.0, -y), (0.0, y), (-drive.wheel_base_m, 0.0))
    else:
        x = 0.5 * drive.wheel_base_m
        places = tuple((at, side) for at in sorted({-x, x}) for side in (-y, y))
    wheel = tuple(_wheel(radius, base.tyre))
    for x, y in places:
        if abs(y) < base.tyre:
            yield from _castor_parts(x, y, base.floor_z, bottom_z)
            continue
        roll = math.copysign(0.5 * math.pi, -y)  # z of a wheel points outwards
        pose = Pose.from_rpy((x, y, base.floor_z - radius), (roll, 0.0, 0.0))
        yield from ((transform(patch, pose), material) for patch, material in wheel)


def _wheel(radius: float, width: float) -> Iterator[_MaterialPatch]:
    """Yield a tyre with two rows of lugs, its rim and hub; axle along z, outside towards +z."""
    r, w = radius, 0.5 * width
    around = np.linspace(-1.9, 1.9, 8)
    c, s = cos(around), sin(around)
    round_r, round_z = (np.sign(v) * power(np.abs(v), 0.75) for v in (c, s))
    arc = zip((r * (0.745 + 0.205 * round_r)).tolist(), (w * round_z).tolist(), strict=True)
    profile = [(0.6 * r, -0.2 * w), *arc, (0.6 * r, 0.2 * w)]
    yield revolve(profile, _TYRE_SECTORS), _RUBBER_MATERIAL
    yield concatenate(list(_lugs(r, w))), _RUBBER_MATERIAL
    rim = [(0.62, 0.2), (0.67, 0.92), (0.62, 0.98), (0.58, 0.66), (0.32, 0.5), (0.26, 0.78)]
    yield revolve([(r * a, w * b) for a, b in rim], _RIM_SECTORS), _RIM_MATERIAL
    hub = [(0.15, 0.7), (0.15, 0.95), (0.10, 1.0)]
    yield revolve([(r * a, w * b) for a, b in hub], 12), _STEEL_MATERIAL
    for angle in (2.0 * math.pi / 5 * np.arange(5)).tolist():
        hole = revolve([(0.075 * r, 0.3 * w), (0.075 * r, 0.585 * w)], 8)
        x, y = 0.455 * r * cos(angle), 0.455 * r * sin(angle)
        yield hole.translate((x, y, 0.0)), _RUBBER_MATERIAL


def _lugs(radius: float, w: float) -> Iterator[Patch]:
    """Yield the lugs of a tyre of half width w."""
    step = 2.0 * math.pi / _LUGS
    for number in range(2 * _LUGS):
        side = -1.0 if number % 2 else 1.0
        # Corners from the middle outwards and back; lugs slant, and taper towards the road.
        z = side * w * np.array((0.04, 0.88, 0.88, 0.04))
        slant = np.array((0.0, 0.3, 0.78, 0.48)) + 0.5 * number
        middle = slant.mean()
        yield loft(
            [
                np.stack((at * cos(angle), at * sin(angle), z), axis=-1)
                for at, narrow in ((0.9 * radius, 1.1), (radius, 0.8))
                for angle in [step * (middle + narrow * (slant - middle))]
            ]
        )


def _castor_parts(x: float, y: float, floor_z: float, bottom_z: float) -> Iterator[_MaterialPatch]:
    """Yield a small wheel in a fork under a plate."""
    r = min(_CASTOR_RADIUS_M, 0.45 * (floor_z - bottom_z) + 0.015)
    lying = Pose.from_rpy((x, y, floor_z - r), (0.5 * math.pi, 0.0, 0.0))
    profile = [(0.5 * r, -0.011), (0.93 * r, -0.011), (r, -0.006), (r, 0.006), (0.93 * r, 0.011)]
    yield transform(revolve([*profile, (0.5 * r, 0.011)], 24), lying), _RUBBER_MATERIAL
    yield transform(revolve([(0.3 * r, -0.018), (0.3 * r, 0.018)], 12), lying), _STEEL_MATERIAL
    top = bottom_z + 0.004
    for side in (-1.0, 1.0):
        leg = block((0.022, 0.003, floor_z - r - top + 0.01), 0.001)
        middle = 0.5 * (floor_z - r + top)
        yield leg.translate((x, y + side * 0.0155, middle)), _STEEL_MATERIAL
    swivel = revolve([(0.03, top + 0.006), (0.03, bottom_z - 0.02)], 16)
    yield swivel.translate((x, y, 0.0)), _STEEL_MATERIAL


def _tracked_parts(base: _Base) -> Iterator[_MaterialPatch]:
    """Yield hull and deck over two tracks."""
    radius, deck_z = base.radius, base.deck_z
    axle_z, inner = base.floor_z - radius, 0.15 * base.hull_y
    width = base.hull_y - inner
    for side in (-1.0, 1.0):
        x = 0.5 * base.drive.wheel_base_m
        place = (-x, side * (inner + 0.5 * width), axle_z)
        yield from _track(2.0 * x, (radius, radius), width, place)
    edge_z, cut = axle_z - 1.1 * radius, 0.25 * base.hull_y
    levels = [(axle_z, 0.4 * cut), (edge_z, 0.0), (0.5 * (edge_z + deck_z), 0.0), (deck_z, cut)]
    yield prism(base.hull, levels), _PAINT_MATERIAL
    lid = [(deck_z + 0.002, 1.3 * cut), (deck_z - 0.004, 1.4 * cut)]
    yield prism(base.hull, lid), _PLATE_MATERIAL


def _track(
    length: float, radii: tuple[float, float], width: float, place: tuple[float, float, float]
) -> Iterator[_MaterialPatch]:
    """Yield a track around two wheels, the first at a place, the second ahead of it."""
    pose = Pose.from_rpy(place, (0.5 * math.pi, 0.0, 0.0))
    lug = 0.12 * radii[0]
    yield transform(belt(length, radii, width, lug, 0.36 * radii[0]), pose), _RUBBER_MATERIAL
    inside = (0.72 * radii[0], 0.72 * radii[1])
    frame = belt(length, inside, width + 0.004, 0.0, length)
    yield transform(frame, pose), _PLATE_MATERIAL
    for x, radius in ((0.0, inside[0]), (length, inside[1])):
        half, r = 0.5 * width + 0.006, 0.8 * radius
        profile = [(0.7 * r, -half), (r, 0.005 - half), (r, half - 0.005), (0.7 * r, half)]
        yield transform(revolve(profile, 20).translate((x, 0.0, 0.0)), pose), _STEEL_MATERIAL


def _sensor_parts(base: _Base) -> Iterator[_MaterialPatch]:
    """Yield sonars in their band, and laser scanners."""
    # Loaded with the robots that have them.
    from catoptra_server.simulation.sensors.range_scanner import RangeScannerDescription
    from catoptra_server.simulation.sensors.sonar import SonarDescription

    sensors = [one for one in base.description.sensors if one.mount.parent == CHASSIS_MOUNT]
    sonars = [one.mount for one in sensors if isinstance(one, SonarDescription)]
    low_z = base.floor_z - 0.5 * base.radius
    for z in sorted({mount.position_m[2] for mount in sonars}):
        if base.deck_z + _SONAR_BAND_M < z < low_z - _SONAR_BAND_M:
            levels = [(z + _SONAR_BAND_M, -0.003), (z - _SONAR_BAND_M, -0.003)]
            yield prism(base.hull, levels), _PLASTIC_MATERIAL
    disc = revolve([(_SONAR_RADIUS_M, -0.01), (_SONAR_RADIUS_M, 0.007)], 12)
    for mount in sonars:
        pose = mount.parent_from_item()
        ahead = pose.rotation[:, 0]
        start = pose.translation + distance_out(base.hull, pose.translation, ahead) * ahead
        _, pitch, yaw = mount.rotation_rad
        facing = Pose.from_rpy(start, (0.0, 0.5 * math.pi + pitch, yaw))
        yield transform(disc, facing), _SONAR_MATERIAL
    for one in sensors:
        if isinstance(one, RangeScannerDescription):
            yield from _scanner_parts(base, one.mount.position_m)


def _scanner_parts(base: _Base, place: tuple[float, float, float]) -> Iterator[_MaterialPatch]:
    """Yield a scanner on the deck, or the window of one within the hull."""
    x, y, z = place
    if z > base.deck_z - 0.02:
        nose = distance_out(base.hull, np.array(place), np.array((1.0, 0.0, 0.0)))
        window = block((0.012, 0.9 * base.hull_y, 0.03), 0.004)
        yield window.translate((x + nose, y, z)), _LENS_MATERIAL
        return
    size = min(max(2.5 * (base.deck_z - z), 0.05), 0.155)
    foot, cap = base.deck_z - z - 0.12 * size, 0.32 * size
    lower = block((size, size, foot), 0.05 * size)
    yield lower.translate((x - 0.1 * size, y, base.deck_z - 0.5 * foot)), _SCANNER_MATERIAL
    window = revolve([(0.42 * size, z + 0.13 * size), (0.42 * size, z - 0.13 * size)], 20)
    yield window.translate((x, y, 0.0)), _LENS_MATERIAL
    upper = block((size, size, cap), 0.05 * size)
    yield upper.translate((x - 0.1 * size, y, z - 0.12 * size - 0.5 * cap)), _SCANNER_MATERIAL


def _housing_parts(pinhole: Floats, axis: Floats, deck_z: float) -> Iterator[_MaterialPatch]:
    """Yield a camera that looks along an axis, and what holds it above the deck."""
    back = pinhole - 0.012 * axis
    end = back - 0.05 * axis
    yield tube(end.tolist(), back.tolist(), 0.028, 20), _HOUSING_MATERIAL
    yield tube(back.tolist(), pinhole.tolist(), 0.016, 16), _LENS_MATERIAL
    if end[2] < deck_z:
        # Behind the camera: ahead is what it looks at, or the ground below it.
        x, y, z = (end - (_POST_M, 0.0, 0.0)).tolist()
        yield tube((x, y, deck_z), (x, y, z), 0.008), _STEEL_MATERIAL
        yield tube((x, y, z), end.tolist(), 0.008), _STEEL_MATERIAL
        yield tube((x, y, deck_z), (x, y, deck_z - 0.006), 0.03, 16), _PLATE_MATERIAL


def _fine_tower_parts(
    tower: OmniCameraTower, deck_z: float, *, is_own: bool
) -> Iterator[_MaterialPatch]:
    """Yield the capture camera on its foot, and, for others, the mirror on rods."""
    x, y, _ = tower.robot_from_mirror.translation.tolist()
    lens_z = _lens_z(tower, deck_z)
    top = min(lens_z + LENS_LENGTH_M, deck_z)
    foot = min(top + CAMERA_LENGTH_M, deck_z)

    def turn(profile: list[tuple[float, float]], sectors: int = 24) -> Patch:
        return revolve(profile, sectors).translate((x, y, 0.0))

    if foot < deck_z:
        profile = [(0.05, deck_z), (0.05, deck_z - 0.004), (0.024, deck_z - 0.012), (0.024, foot)]
        yield turn([(r, max(z, foot)) for r, z in profile]), _PLATE_MATERIAL
    if top < deck_z:
        r = CAMERA_RADIUS_M
        yield turn([(r, foot), (r, top + 0.003), (r - 0.003, top)]), _HOUSING_MATERIAL
        yield turn([(LENS_RADIUS_M, top), (LENS_RADIUS_M, lens_z)], 16), _LENS_MATERIAL
    if is_own:
        return
    mirror = _mirror_patch(tower)
    yield mirror, _MIRROR_MATERIAL
    corners = mirror.corners - (x, y, 0.0)
    rim_z = float(corners[..., 2].min())
    rim = float(np.linalg.norm(corners[..., :2], axis=-1).max())
    back = [(rim + 0.008, rim_z), (rim + 0.008, rim_z - 0.004), (rim, rim_z - 0.009)]
    yield turn(back), _PLATE_MATERIAL
    for angle in (2.0 * math.pi / _NUM_RODS * (np.arange(_NUM_RODS) + 0.5)).tolist():
        at = (x + (rim + 0.004) * cos(angle), y + (rim + 0.004) * sin(angle))
        yield tube((*at, deck_z), (*at, rim_z), _ROD_RADIUS_M), _STEEL_MATERIAL


def _moving_parts(description: RobotDescription) -> dict[str, list[_MaterialPatch]]:
    """Parts that joints turn, in the frames of items on the links, by these in lower case."""
    base, parts = _Base(description), dict[str, list[_MaterialPatch]]()
    for number, link in enumerate(base.links, 1):
        if _is_flipper(link):
            parts[link.name.lower()] = list(_flipper_parts(base, link))
        else:
            child = next((one.name for one in base.links if one.parent == number), link.name)
            start, end = (
                description.robot_from_part(name, {}).translation for name in (link.name, child)
            )
            parts[link.name.lower()] = list(_arm_parts(end - start, 0.09 * 0.88**number))
    for camera in description.perspective_cameras:
        if camera.mount.parent != CHASSIS_MOUNT:
            parts.setdefault(camera.mount.parent.lower(), []).extend(_head_parts(camera))
    return parts


def _flipper_parts(base: _Base, link: LinkDescription) -> Iterator[_MaterialPatch]:
    """Yield a flipper, which points away from the robot's middle."""
    x, y, _ = link.position_m
    width = max(min(base.half_width - abs(y), 0.09), 0.03)
    aside = (0.0, math.copysign(0.5 * width, y), 0.0)
    turned = Pose.from_rpy(aside, (0.0, 0.0, 0.0 if x > 0.0 else math.pi))
    length, radii = _FLIPPER_REACH * base.radius, (base.radius, 0.6 * base.radius)
    for patch, material in _track(length, radii, width - 0.012, (0.0, 0.0, 0.0)):
        yield transform(patch, turned), material


def _arm_parts(to_child: Floats, radius: float) -> Iterator[_MaterialPatch]:
    """Yield a link of an arm: a joint's housing, and a rod to the next joint."""
    ball = [(radius * cos(a), radius * sin(a)) for a in np.linspace(-1.5, 1.5, 9).tolist()]
    yield revolve(ball, 20), _ARM_MATERIAL
    if to_child.any():
        yield tube((0.0, 0.0, 0.0), to_child.tolist(), 0.75 * radius, 20), _ARM_MATERIAL


def _head_parts(camera: PerspectiveCameraDescription) -> Iterator[_MaterialPatch]:
    """Yield the head of a pan-tilt camera: its lens ends at the pinhole."""
    pose = camera.mount.parent_from_item()
    head = block((0.085, 0.1, 0.072), 0.012).translate((-0.0555, 0.0, 0.0))
    yield transform(head, pose), _HOUSING_MATERIAL
    yield transform(tube((-0.02, 0.0, 0.0), (0.0, 0.0, 0.0), 0.025, 20), pose), _LENS_MATERIAL


def build_outer_meshes(description: RobotDescription) -> Mapping[str, ObjectMesh]:
    """Meshes of a class as others see it, by the links that carry them.

    The chassis is last, since labels describe the last object of a number. A tripod has none.
    """
    if description.drive.is_tripod:
        return {}
    if description.body == "plain" or description.items:
        return {CHASSIS_MOUNT: build_robot_mesh(_dimensions(description), _tower(description))}
    body = _body_parts(description, is_own=False)
    return {
        link: build_object_mesh(parts, is_smooth=True)
        for link, parts in (*_moving_parts(description).items(), (CHASSIS_MOUNT, body))
    }


def build_ego_mesh(description: RobotDescription) -> ObjectMesh | None:
    """Mesh of a class as its own mirror shows the body; None unless the effect is configured."""
    omni = description.mirror_camera
    if omni is None or description.drive.is_tripod:
        return None
    is_configured = any(setting.effect.name == "SelfView" for setting in omni.effects.settings)
    # Only where configured: a mesh that no effect shows is never built.
    return build_carrier_mesh(description) if is_configured else None


def build_carrier_mesh(description: RobotDescription) -> ObjectMesh:
    """Mesh of the body below an omnidirectional camera, without what carries mirror or lens."""
    if description.body == "plain" or description.items:
        shape, tower = _dimensions(description), _tower(description)
        return build_robot_mesh(shape) if tower is None else build_ego_body_mesh(shape, tower)
    parts = list(_body_parts(description, is_own=True))
    for link, moving in _moving_parts(description).items():
        at_rest = description.robot_from_part(link, {})
        parts += [(transform(patch, at_rest), material) for patch, material in moving]
    return build_object_mesh(parts, is_smooth=True)


def _dimensions(description: RobotDescription) -> RobotDimensions:
    drive = description.drive
    size = (drive.dimensions_m, drive.ride_height_m, drive.wheel_radius_m, drive.wheel_base_m)
    return RobotDimensions(*size, description.is_smooth, _build_items(description))


# A class has two meshes, of one body.
@lru_cache(maxsize=4)
def _build_items(description: RobotDescription) -> SceneMesh | None:
    """Body of a class whose file has items; raises ConfigError as `build_scene`."""
    if not description.items:
        return None
    return build_scene(World(description.class_name, description.items))


def _tower(description: RobotDescription) -> OmniCameraTower | None:
    omni = description.mirror_camera
    return OmniCameraTower(omni.camera, omni.robot_from_mirror) if omni else None
