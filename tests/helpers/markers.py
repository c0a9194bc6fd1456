"""Bright discs around the viewpoint, and their positions in an image.

The common measure of geometric accuracy: a disc's intensity centroid in the image lies at the pixel
that the camera model gives for the disc's centre.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import Image
from catoptra_server.world.world_description import Item, Material, Ring, World, linear_from_srgb


def marker_directions(incidence_deg: tuple[float, ...], bearings_deg: tuple[float, ...]) -> Floats:
    """(n, 3) unit directions in the mirror frame: every incidence at every bearing."""
    theta, gamma = np.meshgrid(np.radians(incidence_deg), np.radians(bearings_deg), indexing="ij")
    ring = np.sin(theta)
    directions = (ring * np.cos(gamma), ring * np.sin(gamma), np.cos(theta))
    return np.stack(directions, axis=-1).reshape(-1, 3)


def marker_world(
    directions: Floats,
    *,
    world_from_mirror: Pose | None = None,
    diameter_rad: float = math.radians(1.2),
    distance_m: float = 2.0,
) -> World:
    """A black world with a white, unlit disc facing the viewpoint in each direction.

    directions: (n, 3) unit, in the mirror frame.
    """
    world_from_mirror = world_from_mirror or Pose.identity()
    disc = Ring(0.0, distance_m * math.tan(0.5 * diameter_rad), sectors=48)
    white = Material((1.0, 1.0, 1.0), unlit=True)
    items = tuple(
        Item(f"marker {index}", disc, world_from_mirror @ disc_pose(direction, distance_m), white)
        for index, direction in enumerate(directions)
    )
    return World("markers", items)


def disc_pose(direction: Floats, distance_m: float) -> Pose:
    """Pose, in the mirror frame, of a ring that faces back along a (3,) direction."""
    least_axis = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(least_axis, direction)
    x /= np.linalg.norm(x)
    rotation = np.stack((x, np.cross(direction, x), direction), axis=-1)
    return Pose(rotation, distance_m * direction)


def marker_centroid(image: Image, near_px: Floats, *, window_px: float = 5.0) -> Floats:
    """(2,) centroid (u, v) of the light within a square around a (2,) pixel position.

    Light is linear: sRGB levels would overweight the dim pixels of a disc's edge. Raises
    AssertionError where the square is dark.
    """
    rows, columns = (_window(centre, window_px, size) for centre, size in _axes(image, near_px))
    light = linear_from_srgb(image[rows, columns] / 255.0).sum(axis=-1)
    assert light.sum() > 0.0, f"no marker within {window_px} px of {near_px}"
    v, u = np.mgrid[rows, columns] + 0.5
    return np.array(((u * light).sum(), (v * light).sum())) / light.sum()


def _axes(image: Image, position_px: Floats) -> tuple[tuple[float, int], tuple[float, int]]:
    return (float(position_px[1]), image.shape[0]), (float(position_px[0]), image.shape[1])


def _window(centre: float, reach: float, size: int) -> slice:
    return slice(max(math.floor(centre - reach), 0), min(math.ceil(centre + reach), size))
