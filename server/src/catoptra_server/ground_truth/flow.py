"""Optical flow: where the point that a pixel shows is in the image of another exposure.

The point moves with its object; its pixel there is that of the exact camera model; it is unknown
where the point is outside that image, or where the ray of that pixel meets something else first.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.medium.misalignment import lookup_offset_map
from catoptra_server.ground_truth.label_rays import LabelCamera, RaySource
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, RayTable
from catoptra_server.render.trace.trace_engine import FlowRays, FlowTables, TracedRays
from catoptra_server.world.camera_state import CameraState

Flow = npt.NDArray[np.float32]

# A point is visible if the ray of its pixel ends as far away, up to float32 and to the slope of its
# facet: a pixel's ray passes the point by a few hundred thousandths of the distance.
_SAME_RANGE = 2e-3
_SAME_RANGE_M = 2e-3
_DISPLACEMENT_STEPS = 3
# Between two nodes the image bends by 1e-5 px, the origin of a ray by less than a micrometre. 0.2 m
# from a mirror of 3 cm each step leaves a sixth of the error.
_TABLE_NODES = 4096
_AIM_STEPS = 9
_MIN_PLACE = 1e-300


def find_flow(
    renderer: TraceRenderer,
    rays: TracedRays,
    source: RaySource,
    other: CameraState,
    points: npt.NDArray[np.float32],
    ids: npt.NDArray[np.uint16],
    motions: Mapping[int, Pose],
    gone: Collection[int],
) -> Flow:
    """(h, w, 2) displacement of each pixel's point from here to the other image, px.

    Args:
        renderer: Traces the rays that tell whether a point is visible.
        rays: Rays of the pixels' centres.
        source: Camera of both images.
        other: State of the other exposure; its middle counts.
        points: (h, w, 3) points that the pixels show, world frame; nan where they show none.
        ids: (h, w) numbers of the objects that these belong to.
        motions: Motion of each moving object by number, world there from world here.
        gone: Numbers of objects that the other exposure lacks.
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


def project_points(camera: LabelCamera, in_mirror: Floats) -> tuple[Floats, Bools]:
    """(n, 2) pixels of (n, 3) points in the mirror frame, and validity, within the image alone."""
    if isinstance(camera, PerspectiveCamera):
        pixel, valid = camera.pixel_from_direction(in_mirror)
    elif camera.is_central:
        pixel, valid = pixel_from_direction(camera, in_mirror)
    else:
        pixel, valid = pixel_from_direction(camera, _aim_rays(camera, in_mirror))
    size = (camera.width_px, camera.height_px)
    inside = ((pixel >= 0.0) & (pixel < size)).all(axis=-1)
    return pixel, valid & inside


def _sharp(other: CameraState) -> CameraState:
    """The middle of an exposure, without light and air."""
    return replace(other, shutter=None, has_shadows=False, fog=None)


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
    return _CameraTable(places, 2.0 * np.arctan(t), radius_px, *origins)


@lru_cache(maxsize=4)
def _image_axes(camera: OmniCamera) -> Floats:
    """(2, 2) unit displacements in the image, columns, of the azimuths of x and of y."""
    angle = 0.5 * (2.0 * math.atan(camera.projection.t_min) + camera.rim_rad)
    level, height = math.sin(angle), math.cos(angle)
    along = np.array(((level, 0.0, height), (0.0, level, height)))
    offsets = pixel_from_direction(camera, along)[0] - camera.centre_px
    return np.asarray((offsets / np.linalg.norm(offsets, axis=-1, keepdims=True)).T)


def _aim_rays(camera: OmniCamera, in_mirror: Floats) -> Floats:
    """Directions of the rays that meet (n, 3) points, of a mirror without a viewpoint.

    A ray's origin depends on its direction: a step for one shortens the error of the other by the
    origin's change per radian over the point's distance. `pixel_from_point` finds the same root by
    bisection, of each point alone.
    """
    table = _tabulate_camera(camera)
    theta, r, z = table.angles_rad, table.origin_r, table.origin_z
    assert r is not None, "a mirror without a viewpoint"
    assert z is not None
    rho, height = np.hypot(in_mirror[:, 0], in_mirror[:, 1]), in_mirror[:, 2]
    angle = np.arctan2(rho, height)
    for _ in range(_AIM_STEPS):
        angle = np.arctan2(rho - np.interp(angle, theta, r), height - np.interp(angle, theta, z))
    level = np.sin(angle) / np.where(rho > 0.0, rho, 1.0)
    return np.column_stack((in_mirror[:, :2] * level[:, None], np.cos(angle)))


def _displace(source: RaySource, pixel: Floats) -> Floats:
    """Pixels of a displaced capture camera that look up (n, 2) pixels of the aligned one."""
    if source.misalignment is None or not isinstance(source.camera, OmniCamera):
        return pixel
    lookup = lookup_offset_map(source.misalignment, source.camera)
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
