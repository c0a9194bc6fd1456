"""Boxes and cones on the sphere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.labels.masks import find_masks
from catoptra_protocol.labels.spherical_box import (
    PixelSphere,
    SphericalBox,
    angles_of,
    enclose_directions,
)
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from helpers.labelled_rooms import CAMERAS, SIDE_PX


def cap(half_angle_rad: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random axis, and directions within an angle of it, a third of them at the border."""
    random = np.random.default_rng(seed)
    axis = random.standard_normal(3)
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, random.standard_normal(3))
    across /= np.linalg.norm(across)
    other = np.cross(axis, across)
    angle = half_angle_rad * np.where(random.random(count) < 0.33, 1.0, random.random(count))
    turn = random.uniform(0.0, 2.0 * math.pi, count)
    side = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * other
    return axis, np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * side


@pytest.mark.parametrize("half_angle_deg", [0.01, 1.0, 20.0, 60.0, 85.0])
@pytest.mark.parametrize("seed", range(5))
def test_cone_of_less_than_a_half_space_is_the_smallest(half_angle_deg: float, seed: int) -> None:
    half_angle = math.radians(half_angle_deg)
    axis, directions = cap(half_angle, 400, seed)
    cone = enclose_directions(directions)
    assert cone.contains(directions, 1e-9)
    # A hundred directions at the border, so that no smaller cone is much smaller.
    assert 0.98 * half_angle < cone.half_angle_rad <= half_angle * (1.0 + 1e-6)
    assert math.acos(min(1.0, float(cone.axis @ axis))) < 0.2 * half_angle


@pytest.mark.parametrize("half_angle_deg", [100.0, 140.0, 165.0])
def test_cone_of_more_than_a_half_space_holds_all(half_angle_deg: float) -> None:
    half_angle = math.radians(half_angle_deg)
    _, directions = cap(half_angle, 3000, 4)
    cone = enclose_directions(directions)
    assert cone.contains(directions, 1e-9)
    assert cone.half_angle_rad < half_angle + 0.02


def test_cones_of_one_and_of_two_directions() -> None:
    one = np.array(((0.0, 0.6, 0.8),))
    cone = enclose_directions(one)
    assert cone.half_angle_rad < 1e-7
    two = enclose_directions(np.array(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))))
    np.testing.assert_allclose(two.axis, (math.sqrt(0.5), math.sqrt(0.5), 0.0), atol=1e-12)
    assert two.half_angle_rad == pytest.approx(0.25 * math.pi)


def test_opposite_directions_have_a_cone() -> None:
    both = np.array(((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)))
    cone = enclose_directions(both)
    assert cone.contains(both, 1e-9)
    assert cone.half_angle_rad < 0.5 * math.pi + 0.05


TILTED = Pose.from_rpy((0.0, 0.0, 0.0), (0.3, -0.5, 1.0)).rotation
HANGING = np.eye(3)


@pytest.fixture(scope="module", params=CAMERAS)
def camera(request: pytest.FixtureRequest) -> OmniCamera:
    return CAMERAS[request.param]


def draw_blob(camera: OmniCamera, row: float, column: float, radius: float) -> np.ndarray:
    """A disc of pixels, within the camera's domain."""
    rows, columns = np.mgrid[:SIDE_PX, :SIDE_PX] + 0.5
    _, _, valid = ray_from_pixel(camera, np.stack((columns, rows), axis=-1))
    return ((np.hypot(rows - row, columns - column) < radius) & valid).astype(np.uint16)


def enclose(
    camera: OmniCamera, ids: np.ndarray, level_from_camera: np.ndarray
) -> tuple[SphericalBox, np.ndarray]:
    """Box of the only object, and directions of random points of its pixels."""
    (mask,) = find_masks(ids)
    sphere = PixelSphere(camera, level_from_camera)
    random = np.random.default_rng(5)
    points = np.argwhere(mask.to_array())[:, None, ::-1] + random.random((1, 12, 2))
    _, directions, valid = ray_from_pixel(camera, points.reshape(-1, 2))
    return sphere.enclose(ids)[mask.number], directions[valid] @ level_from_camera.T


def assert_tight(box: SphericalBox, directions: np.ndarray) -> None:
    """All directions inside; each side of the box near one of them."""
    pixel_rad = 0.12  # the largest angle that a pixel of these small cameras spans
    assert box.contains(directions, 2e-3 * pixel_rad).all()
    assert box.cone.contains(directions, 2e-3 * pixel_rad)
    azimuth, elevation = angles_of(directions)
    assert elevation.min() - box.elevation_from_rad < pixel_rad
    assert box.elevation_to_rad - elevation.max() < pixel_rad
    offset = np.mod(azimuth - box.azimuth_from_rad + 1e-3, 2.0 * math.pi)
    if box.azimuth_width_rad < 2.0 * math.pi:
        level = np.cos(elevation)
        assert (offset * level)[offset < 1.0].min(initial=9.0) < pixel_rad
        assert ((box.azimuth_width_rad - offset) * level).min() < pixel_rad


@pytest.mark.parametrize("rotation", [HANGING, TILTED], ids=["hanging", "tilted"])
@pytest.mark.parametrize("seed", range(12))
def test_boxes_of_random_blobs_hold_every_pixel_tightly(
    camera: OmniCamera, rotation: np.ndarray, seed: int
) -> None:
    random = np.random.default_rng(seed)
    angle, distance = random.uniform(0, 2 * math.pi), random.uniform(0.0, 45.0)
    centre = 0.5 * SIDE_PX
    ids = draw_blob(
        camera,
        centre + distance * math.sin(angle),
        centre + distance * math.cos(angle),
        random.uniform(0.8, 18.0),
    )
    if not ids.any():
        ids = draw_blob(camera, centre, centre + 20.0, 3.0)
    assert_tight(*enclose(camera, ids, rotation))


def test_box_behind_the_camera_wraps() -> None:
    camera = CAMERAS["paper"]
    # The image's upper side is ahead, its lower side behind.
    ids = draw_blob(camera, 80.0, 48.0, 6.0)
    box, directions = enclose(camera, ids, HANGING)
    assert box.azimuth_from_rad > 2.0
    assert box.azimuth_from_rad + box.azimuth_width_rad > math.pi
    assert box.azimuth_width_rad < 1.0
    assert_tight(box, directions)


def test_object_straight_below_has_all_azimuths() -> None:
    camera = CAMERAS["paper"]
    box, directions = enclose(camera, draw_blob(camera, 49.0, 47.0, 9.0), HANGING)
    assert (box.azimuth_width_rad, box.elevation_from_rad) == (2.0 * math.pi, -0.5 * math.pi)
    assert_tight(box, directions)


def test_object_straight_above_a_tilted_camera_has_all_azimuths() -> None:
    camera = CAMERAS["fish-eye"]
    upward = Pose.from_rpy((0.0, 0.0, 0.0), (math.pi, 0.0, 0.3)).rotation
    box, directions = enclose(camera, draw_blob(camera, 47.0, 48.0, 5.0), upward)
    assert (box.azimuth_width_rad, box.elevation_to_rad) == (2.0 * math.pi, 0.5 * math.pi)
    assert_tight(box, directions)


def test_object_all_around_the_camera_has_all_azimuths_and_its_own_elevations() -> None:
    camera = CAMERAS["paper"]
    ids = draw_blob(camera, 48.0, 48.0, 40.0) - draw_blob(camera, 48.0, 48.0, 34.0)
    box, directions = enclose(camera, ids, HANGING)
    assert box.azimuth_width_rad == 2.0 * math.pi
    assert box.elevation_from_rad > -0.4 * math.pi
    assert_tight(box, directions)
    assert box.cone.half_angle_rad > 1.0


def test_object_around_with_a_gap_has_an_interval_with_the_gap() -> None:
    camera = CAMERAS["paper"]
    ids = draw_blob(camera, 48.0, 48.0, 40.0) - draw_blob(camera, 48.0, 48.0, 34.0)
    # Cut away to the right of the image, which a mirror shows from the left: azimuth -90 degrees.
    ids[40:56, 60:] = 0
    box, directions = enclose(camera, ids, HANGING)
    assert box.azimuth_width_rad < 2.0 * math.pi - 0.3
    assert not box.contains(np.array(((0.0, -1.0, 0.3),)))[0]
    assert_tight(box, directions)


def draw_thing(kind: str, seed: int) -> np.ndarray:
    """Ids of a thing: a blob, a ring around the image's middle, a quarter or three of a disc that
    end there, a large disc, or a few pixels next to the middle, where the paper's camera has a
    pole."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[:SIDE_PX, :SIDE_PX] + 0.5 - 0.5 * SIDE_PX
    distance = np.hypot(rows, columns)
    inner = random.uniform(5.0, 38.0)
    away = np.hypot(*(rows - random.uniform(-3, 3), columns - random.uniform(-3, 3)))
    thing = {
        "blob": np.hypot(rows - random.uniform(-30, 30), columns - random.uniform(-30, 30))
        < random.uniform(0.8, 15.0),
        "ring": (distance > inner) & (distance < inner + random.uniform(2.0, 9.0)),
        "quarter": (rows < 0) & (columns < 0) & (distance < inner),
        "three quarters": ~((rows < 0) & (columns < 0)) & (distance < inner),
        "large": np.hypot(rows - random.uniform(-9, 9), columns) < random.uniform(25, 48),
        "near": away < random.uniform(0.7, 3.0),
    }[kind]
    return thing.astype(np.uint16)


def sample_squares(
    camera: OmniCamera, ids: np.ndarray, rotation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Directions of 9 x 9 points of each pixel at the outline and of all centres, and the angle of
    a pixel there."""
    inside = np.pad(ids, 1)
    inner = inside[2:, 1:-1] & inside[:-2, 1:-1] & inside[1:-1, 2:] & inside[1:-1, :-2]
    grid = np.stack(np.meshgrid(*2 * (np.linspace(0.0, 1.0, 9),)), axis=-1).reshape(-1, 2)
    border = np.argwhere((ids > 0) & (inner == 0))[:, None, ::-1] + grid
    points = np.concatenate((border.reshape(-1, 2), np.argwhere(ids)[:, ::-1] + 0.5))
    _, directions, valid = ray_from_pixel(camera, points)
    points, directions = points[valid], directions[valid]
    angles = []
    for step in ((0.01, 0.0), (0.0, 0.01)):
        ends = [ray_from_pixel(camera, points + np.array(step) * sign) for sign in (1.0, -1.0)]
        sizes = [np.linalg.norm(end - directions, axis=-1) / 0.01 for _, end, _ in ends]
        angles.append(np.where(ends[0][2], *sizes))
    return directions @ rotation.T, np.maximum(*angles)


@pytest.mark.parametrize("kind", ["blob", "ring", "quarter", "three quarters", "large", "near"])
@pytest.mark.parametrize("rotation", [HANGING, TILTED], ids=["hanging", "tilted"])
def test_boxes_are_within_a_pixel_of_all_points_of_the_squares(
    camera: OmniCamera, rotation: np.ndarray, kind: str
) -> None:
    sphere = PixelSphere(camera, rotation)
    rows, columns = np.mgrid[:SIDE_PX, :SIDE_PX] + 0.5
    shown = ray_from_pixel(camera, np.stack((columns, rows), axis=-1))[2]
    for seed in range(4):
        ids = draw_thing(kind, seed) * shown.astype(np.uint16)
        if not ids.any():
            continue
        box = sphere.enclose(ids)[1]
        directions, pixel_rad = sample_squares(camera, ids, rotation)
        azimuth, elevation = angles_of(directions)
        low, high = np.argmin(elevation), np.argmax(elevation)
        assert -0.02 < (elevation[low] - box.elevation_from_rad) / pixel_rad[low] < 1.0
        assert -0.02 < (box.elevation_to_rad - elevation[high]) / pixel_rad[high] < 1.0
        assert_azimuths_within_a_pixel(box, azimuth, pixel_rad / np.cos(elevation))
        assert box.cone.contains(directions, 0.02 * float(pixel_rad.max()))
        smallest = smallest_cone(directions, box)
        # Points of a grid come as near to the rim as that.
        assert box.cone.half_angle_rad < smallest + 0.05 * float(pixel_rad.max())


def assert_azimuths_within_a_pixel(
    box: SphericalBox, azimuth: np.ndarray, pixel_rad: np.ndarray
) -> None:
    """Sides of a box within a pixel of the interval that the widest gap leaves."""
    order = np.argsort(azimuth)
    along = azimuth[order]
    gaps = np.append(along[1:], along[0] + 2.0 * math.pi) - along
    widest = int(np.argmax(gaps))
    end, begin = order[widest], order[(widest + 1) % len(order)]
    if box.azimuth_width_rad == 2.0 * math.pi:
        assert gaps[widest] < pixel_rad[begin] + pixel_rad[end]
        return
    sides = (
        (azimuth[begin] - box.azimuth_from_rad, begin),
        (box.azimuth_from_rad + box.azimuth_width_rad - azimuth[end], end),
    )
    for side, place in sides:
        loose_px = math.remainder(side, 2.0 * math.pi) / pixel_rad[place]
        assert -0.05 < loose_px < 1.0


def smallest_cone(directions: np.ndarray, box: SphericalBox) -> float:
    """Half angle of the best of many axes, most of them next to the box's."""
    random = np.random.default_rng(1)
    near = box.cone.axis + random.standard_normal((200, 3)) * 10.0 ** -random.uniform(
        1, 5, (200, 1)
    )
    axes = np.concatenate((near, random.standard_normal((400, 3))))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return float(np.arccos(np.clip((axes @ directions.T).min(axis=1), -1.0, 1.0)).min())
