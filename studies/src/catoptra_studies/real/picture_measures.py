"""What a picture of a board measures: widths of edges, noise, shading, colours.

All from the pixels as coded (encoded grey levels of 255) and from the pose of the board, by the
same functions for photographs and for twins. The board's own coordinates say what a pixel shows.

* Edges between a black and a white square: levels over the distance from the edge, in pixels, from
  the pixels themselves (no interpolation, which would blur); a step behind a Gaussian is fitted,
  and its rise from 10 to 90 % is the width: 2.563 standard deviations.
* Noise: what is left of a patch inside of a square after a quadratic surface, which light and the
  tails of edges make. The degrees of freedom are counted.
* Shading: relative light of white squares over the square of the image radius, within a picture, as
  the loss at the rim. It holds the lens's vignetting and the gradient of the room's light alike.
* Colours: Eq. 3's histograms of board black, board white and room.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from catoptra_client.landmarks.classifier import Histogram, histogram_from_pixels
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel_grid
from catoptra_protocol.optics.transforms import Pose
from catoptra_studies.plot_style import Image
from catoptra_studies.real.photographs import Board, refine_corners

Illumination = Callable[[Floats], Floats]
"""Relative illumination of a lens, by the image radius over the rim's."""

CLASSES = ("black", "white", "room")
"""Classes whose truth follows from the board's pose."""
_WIDTH_PER_SIGMA = 2.5631
"""10 to 90 % of a normal distribution."""
_MAX_SIGMA_PX, _MIN_SIGMA_PX = 4.0, 0.12
# Half side of the window around an edge's middle, and the part of a square on either side.
_WINDOW_PX, _REACH = 8, 0.42
_ALONG = 0.3
_MIN_EDGE_PIXELS, _MIN_CONTRAST, _MAX_EDGE_RMS = 24, 20.0, 0.12
_EDGE_STEPS = 12
# Patches: distance from the square's border in squares and px, and pixels at least.
_INSET, _INSET_PX, _MIN_PATCH_PIXELS = 0.22, 2.5, 16
# Beyond its squares a board has a margin, a frame and hands: no room.
_MARGIN = 2.0
BINS = 16
_ROOM_DEG = (50.0, 118.0)
"""Angles of the room: beyond, the photographs show the lens and the mirror's rim."""


@dataclass(frozen=True, slots=True, eq=False)
class PictureMeasures:
    """Measures of one picture."""

    edge_widths_px: Floats
    """(n,) 10 to 90 %."""
    edge_incidence_rad: Floats
    patch_levels: Floats
    """(m,) mean grey level."""
    patch_noise: Floats
    """(m,) standard deviation, grey levels."""
    patch_radius: Floats
    """(m,) image radius over the rim's."""
    patch_colours: Floats
    """(m, 3) mean RGB levels."""
    patch_is_white: Bools
    black_parity: int
    """Of column + row of the black squares, counted from the first inner corner."""
    room_colour: Floats
    """(3,) RGB level of the mean light."""
    room_radius: Floats
    """(k,) image radii of its pixels, over the rim's."""
    histograms: dict[str, Histogram]
    """Of each of CLASSES."""

    @property
    def edge_width_px(self) -> float:
        """Median width of the edges; NaN without one."""
        return _median(self.edge_widths_px)

    def noise(self, is_white: bool) -> float:
        """Median noise of white or of black patches, grey levels; NaN without one."""
        return _median(self.patch_noise[self.patch_is_white == is_white])

    def colour(self, is_white: bool, illumination: Illumination = np.ones_like) -> Floats:
        """(3,) median RGB of white or of black patches, without a lens's shading of them."""
        chosen = self.patch_is_white == is_white
        light = linear_light(self.patch_colours[chosen])
        return np.asarray(
            np.median(
                encoded_level(light / illumination(self.patch_radius[chosen])[:, None]), axis=0
            )
        )

    def room(self, illumination: Illumination = np.ones_like) -> Floats:
        """(3,) RGB of the room, likewise."""
        mean = illumination(self.room_radius).mean()
        return encoded_level(linear_light(self.room_colour) / mean)

    @property
    def shading_sums(self) -> tuple[float, float]:
        """Sums of products and of squares, of which the quotient is the slope of log light over
        the square of the radius.
        """
        radius, light = self._white_light()
        x = np.square(radius)
        x = x - x.mean()
        return float(x @ np.log(light)), float(x @ x)

    def _white_light(self) -> tuple[Floats, Floats]:
        is_used = self.patch_is_white & (self.patch_levels < 250.0)
        return self.patch_radius[is_used], linear_light(self.patch_levels[is_used])


def shading_loss(sums: Floats) -> Floats:
    """Part of the light that is lost at the rim, by (..., 2) sums of pictures or their mean."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(1.0 - np.exp(sums[..., 0] / sums[..., 1]))


def linear_light(levels: Floats) -> Floats:
    """Linear light of sRGB levels of 255. Source: IEC 61966-2-1."""
    c = levels / 255.0
    return np.asarray(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4))


def encoded_level(light: Floats) -> Floats:
    """sRGB levels of 255 of linear light."""
    light = np.clip(light, 0.0, 1.0)
    return np.asarray(
        255.0 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    )


def measure_picture(rgb: Image, camera: OmniCamera, pose: Pose, board: Board) -> PictureMeasures:
    """Measure a picture in which a board has a pose, the mirror frame's from the board's."""
    grey = rgb.astype(np.float64) @ (0.299, 0.587, 0.114)
    place = board_coordinates(camera, pose, board)
    widths, incidence = _measure_edges(grey, place, camera, pose, board)
    patches = _measure_patches(rgb, grey, place, camera, board)
    levels, noise, radius, colours, parity = patches
    # Which of the two colours is black is a matter of the print and of where counting began.
    even, odd = (float(levels[parity == each].sum()) for each in (0, 1))
    black_parity = 0 if odd > even else 1
    masks = class_masks(camera, place, board, black_parity=black_parity)
    room = encoded_level(linear_light(rgb[masks["room"]].astype(np.float64)).mean(axis=0))
    v, u = np.nonzero(masks["room"])
    room_radius = np.hypot(u + 0.5 - camera.centre_px[0], v + 0.5 - camera.centre_px[1])
    histograms = {name: histogram_from_pixels(rgb[mask], BINS) for name, mask in masks.items()}
    return PictureMeasures(
        widths, incidence, levels, noise, radius, colours, parity != black_parity, black_parity,
        room, room_radius[::50] / camera.rim_radius_px, histograms,
    )  # fmt: skip


def board_coordinates(camera: OmniCamera, pose: Pose, board: Board) -> Floats:
    """(h, w, 2) place on the board's plane that each pixel shows, in squares from the first corner.

    NaN where a pixel shows nothing or its ray does not meet the plane.
    """
    directions, is_seen = pixel_directions(camera)
    normal = pose.rotation[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (pose.translation @ normal) / (directions @ normal)
        points = directions * distance[..., None] - pose.translation
        place = points @ pose.rotation[:, :2] / board.square_m
    place[~(is_seen & (distance > 0.0))] = np.nan
    return np.asarray(place)


def class_masks(
    camera: OmniCamera, place: Floats, board: Board, *, black_parity: int
) -> dict[str, Bools]:
    """(h, w) pixels that show a black square, a white one, or the room; borders show none."""
    x, y = place[..., 0], place[..., 1]
    with np.errstate(invalid="ignore"):
        column, row = np.floor(x), np.floor(y)
        inside = np.minimum(
            np.minimum(x - column, column + 1 - x), np.minimum(y - row, row + 1 - y)
        )
        is_on = (x > -1) & (x < board.columns) & (y > -1) & (y < board.rows) & (inside > _INSET)
        is_white = (column + row) % 2 != black_parity
        outside = (x < -1 - _MARGIN) | (x > board.columns + _MARGIN)
        outside |= (y < -1 - _MARGIN) | (y > board.rows + _MARGIN) | np.isnan(x)
    directions, is_seen = pixel_directions(camera)
    angle_deg = np.degrees(np.arccos(np.clip(directions[..., 2], -1.0, 1.0)))
    is_room = is_seen & (angle_deg > _ROOM_DEG[0]) & (angle_deg < _ROOM_DEG[1])
    return {"black": is_on & ~is_white, "white": is_on & is_white, "room": outside & is_room}


def measure_lateral_colour(rgb: Image, corners_px: Floats, camera: OmniCamera) -> tuple[float, ...]:
    """Magnifications of red and of blue over green, by corners found again in each colour."""
    red, green, blue = (refine_corners(rgb[..., c], corners_px) for c in range(3))
    arm = green - camera.centre_px
    scale = float(np.square(arm).sum())
    return tuple(1.0 + float(((one - green) * arm).sum()) / scale for one in (red, blue))


@lru_cache(maxsize=4)
def pixel_directions(camera: OmniCamera) -> tuple[Floats, Bools]:
    """(h, w, 3) unit directions of pixels, and (h, w) whether they are in view."""
    u, v = (np.arange(side, dtype=np.float64) + 0.5 for side in (camera.width_px, camera.height_px))
    return direction_from_pixel_grid(camera, u, v)


def _measure_edges(
    grey: Floats, place: Floats, camera: OmniCamera, pose: Pose, board: Board
) -> tuple[Floats, Floats]:
    """Widths of all edges between neighbouring corners that can be fitted, and their angles."""
    columns, rows = board.columns, board.rows
    across_x = [(x, y + 0.5) for x in range(columns) for y in range(rows - 1)]
    across_y = [(x + 0.5, y) for x in range(columns - 1) for y in range(rows)]
    middle = np.array((*across_x, *across_y))
    # Which coordinate crosses the edge.
    axis = np.repeat((0, 1), (len(across_x), len(across_y)))
    # Across the edge and along it: an oblique board's sides are no right angle in the picture, and
    # the distance from an edge is that to its line.
    across_px, along_px = (
        np.subtract(*(_project(camera, pose, board, middle + sign * step)[0] for sign in (1, -1)))
        for step in (0.3 * np.eye(2)[axis], 0.3 * np.eye(2)[1 - axis])
    )
    area = across_px[:, 0] * along_px[:, 1] - across_px[:, 1] * along_px[:, 0]
    px_per_square = np.abs(area) / np.linalg.norm(along_px, axis=1) / 0.6
    centre, incidence = _project(camera, pose, board, middle)
    window = np.arange(-_WINDOW_PX, _WINDOW_PX + 1)
    column = np.floor(centre[:, 0]).astype(int)[:, None, None] + window[None, None, :]
    row = np.floor(centre[:, 1]).astype(int)[:, None, None] + window[None, :, None]
    is_in = (column >= 0) & (column < camera.width_px) & (row >= 0) & (row < camera.height_px)
    column, row = np.clip(column, 0, camera.width_px - 1), np.clip(row, 0, camera.height_px - 1)
    local = place[row, column] - middle[:, None, None]
    each = np.arange(len(middle))
    across, along = local[each, ..., axis], local[each, ..., 1 - axis]
    with np.errstate(invalid="ignore"):
        used = is_in & (np.abs(along) < _ALONG) & (np.abs(across) < _REACH)
    distance = np.where(used, across * px_per_square[:, None, None], 0.0)
    count = len(middle)
    sigma, is_good = _fit_steps(
        distance.reshape(count, -1), grey[row, column].reshape(count, -1), used.reshape(count, -1)
    )
    return _WIDTH_PER_SIGMA * sigma[is_good], incidence[is_good]


def _project(camera: OmniCamera, pose: Pose, board: Board, places: Floats) -> tuple[Floats, Floats]:
    """Pixels and angles of places on a board, in squares."""
    points = np.pad(board.square_m * places, ((0, 0), (0, 1)))
    points = pose.transform_points(points)
    angle = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    return camera.pixel_from_direction(points)[0], np.asarray(angle)


def _fit_steps(distance: Floats, levels: Floats, used: Bools) -> tuple[Floats, Bools]:
    """Standard deviations of steps behind a Gaussian, (n,) of (n, k) levels, and which are good."""
    weight = used.astype(np.float64)
    high = _masked_mean(levels, used & (distance > 0.0))
    low = _masked_mean(levels, used & (distance < 0.0))
    # Level before, rise, place, logarithm of the deviation: it stays positive.
    x = np.stack((low, high - low, 0.0 * low, np.full_like(low, math.log(0.8))), axis=-1)
    for _ in range(_EDGE_STEPS):
        sigma = np.exp(x[:, 3:])
        z = (distance - x[:, 2:3]) / sigma
        step = _normal_cdf(z)
        bell = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        rise = x[:, 1:2]
        columns = np.stack((np.ones_like(z), step, -rise * bell / sigma, -rise * bell * z), -1)
        columns = columns * weight[..., None]
        left = (x[:, :1] + rise * step - levels) * weight
        normal = np.einsum("nki,nkj->nij", columns, columns)
        normal += 1e-3 * np.eye(4) * np.einsum("nii->n", normal)[:, None, None] / 4.0 + 1e-9
        move = np.linalg.solve(normal, np.einsum("nki,nk->ni", columns, left)[..., None])[..., 0]
        x = x - np.clip(move, (-60.0, -60.0, -0.5, -0.4), (60.0, 60.0, 0.5, 0.4))
        x[:, 3] = np.clip(x[:, 3], math.log(_MIN_SIGMA_PX), math.log(_MAX_SIGMA_PX))
    count = weight.sum(axis=1)
    deviation = np.sqrt(np.square(left).sum(axis=1) / np.maximum(count, 1.0))
    is_good = (count >= _MIN_EDGE_PIXELS) & (np.abs(x[:, 1]) >= _MIN_CONTRAST)
    is_good &= deviation <= _MAX_EDGE_RMS * np.abs(x[:, 1])
    return np.exp(x[:, 3]), is_good


def _masked_mean(values: Floats, mask: Bools) -> Floats:
    return np.asarray((values * mask).sum(axis=1) / np.maximum(mask.sum(axis=1), 1))


def _normal_cdf(z: Floats) -> Floats:
    """Abramowitz & Stegun 26.2.17, to 7.5e-8."""
    t = 1.0 / (1.0 + 0.2316419 * np.abs(z))
    powers = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (
        -1.821255978 + t * 1.330274429))))  # fmt: skip
    tail = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) * powers
    return np.asarray(np.where(z > 0.0, 1.0 - tail, tail))


def _measure_patches(
    rgb: Image, grey: Floats, place: Floats, camera: OmniCamera, board: Board
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Level, noise, relative radius, colour and parity of the inside of each square."""
    x, y = place[..., 0], place[..., 1]
    with np.errstate(invalid="ignore"):
        is_on = (x > -1) & (x < board.columns) & (y > -1) & (y < board.rows)
    v, u = np.nonzero(is_on)
    column, row = np.floor(x[v, u]), np.floor(y[v, u])
    inset = np.minimum(np.abs(x[v, u] - np.rint(x[v, u])), np.abs(y[v, u] - np.rint(y[v, u])))
    number = ((column + 1) * (board.rows + 1) + row + 1).astype(int)
    size_px = np.sqrt(np.bincount(number))
    inner = inset > np.maximum(_INSET, _INSET_PX / size_px[number])
    rows: list[tuple[float, ...]] = []
    order = np.flatnonzero(inner)[np.argsort(number[inner], kind="stable")]
    starts = np.flatnonzero(np.diff(number[order], prepend=-1))
    for chosen in np.split(order, starts[1:]):
        if len(chosen) < _MIN_PATCH_PIXELS:
            continue
        values = grey[v[chosen], u[chosen]]
        a, b = u[chosen] - u[chosen].mean(), v[chosen] - v[chosen].mean()
        surface = np.stack((np.ones_like(a), a, b, a * a, a * b, b * b), axis=-1)
        left = values - surface @ np.linalg.lstsq(surface, values, rcond=None)[0]
        noise = math.sqrt(float(left @ left) / (len(left) - surface.shape[1]))
        off = (
            u[chosen].mean() + 0.5 - camera.centre_px[0],
            v[chosen].mean() + 0.5 - (camera.centre_px[1]),
        )
        colour = rgb[v[chosen], u[chosen]].mean(axis=0)
        parity = float((column[chosen[0]] + row[chosen[0]]) % 2)
        radius = math.hypot(*off) / camera.rim_radius_px
        rows.append((float(values.mean()), noise, radius, *colour, parity))
    table = np.array(rows).reshape(-1, 7)
    return table[:, 0], table[:, 1], table[:, 2], table[:, 3:6], table[:, 6]


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else math.nan
