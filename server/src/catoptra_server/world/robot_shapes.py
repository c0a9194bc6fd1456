"""Shapes of robots as other robots see them: a chassis on wheels, and an omnidirectional camera's
tower.

Built from the dimensions that the robot reports itself; USARSim's own meshes are not public, so the
shapes in between are ours. Frame: robot (SAE, origin in the chassis).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.objects import ObjectMesh, build_object_mesh
from catoptra_server.world.shapes import Patch, box, build_shape, grid
from catoptra_server.world.world_description import Box, Cylinder, Material


@dataclass(frozen=True, slots=True)
class RobotDimensions:
    """Outer dimensions of a robot."""

    dimensions_m: tuple[float, float, float]
    """Length, width, height."""
    ride_height_m: float
    wheel_radius_m: float
    wheel_base_m: float
    """Distance of the axles; 0 for one pair of wheels, in the centre."""


@dataclass(frozen=True, slots=True, eq=False)
class OmniCameraTower:
    """Omnidirectional camera on a robot."""

    camera: OmniCamera
    robot_from_mirror: Pose
    """Mirror frame on the robot; its origin is the effective viewpoint."""


def build_robot_mesh(shape: RobotDimensions, tower: OmniCameraTower | None = None) -> ObjectMesh:
    """Build the mesh of a class of robots; `tower` None: without an omnidirectional camera."""
    parts = [*_chassis_parts(shape), *_wheel_parts(shape)]
    if tower is not None:
        parts += _tower_parts(tower, deck_z=_deck_z(shape))
    return build_object_mesh(parts)


def build_ego_body_mesh(shape: RobotDimensions, tower: OmniCameraTower) -> ObjectMesh:
    """Build the mesh of a robot as its own mirror sees the robot.

    The mirror and the glass that carries the mirror are left out: neither is in the mirror's view.
    """
    return build_object_mesh(
        [
            *_chassis_parts(shape),
            *_wheel_parts(shape),
            *_capture_camera_parts(tower, deck_z=_deck_z(shape)),
        ]
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
        (radius * np.cos(azimuth), radius * np.sin(azimuth), height + 0.0 * azimuth), axis=-1
    )
    return grid(points, np.zeros((*points.shape[:2], 2)))
