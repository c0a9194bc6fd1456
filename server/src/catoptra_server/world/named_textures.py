"""Textures by name: seeded, tileable, made from noise, courses and cells.

A world writes `Texture=catoptra:brick`. Each texture has the size of its tile in metres, which
`Repeat` replaces. They are made once and kept on disk (`runtime/array_cache.py`): 0.1 s each. Only
sums, products, roots and uniform random numbers: the same bytes on every processor. Brightness is
even over a tile, so that a large floor shows no pattern from afar. A new texture is a row of
`NAMED_TEXTURES`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.runtime.array_cache import ArrayCache, find_cache_folder

SIDE_PX = 512

_Random = np.random.Generator
_Colour = tuple[int, int, int]
_Y, _X = (np.indices((SIDE_PX, SIDE_PX)) + 0.5) / SIDE_PX


class NamedTexture(NamedTuple):
    """One texture, but for its pieces, veins and stains."""

    tile_m: float
    """Side of its tile; 0: a picture, which covers each face once."""
    colours: str = ""
    """Hexadecimal sRGB, evenly spaced along the brightness, which is about a half; of a picture
    none."""
    noises: tuple[tuple[float, int, int, int], ...] = ()
    """What brightness varies by: amplitude, rows, columns, octaves of noise; 0 octaves: waves."""


def load_named_texture(name: str) -> npt.NDArray[np.uint8]:
    """(h, w, 3) sRGB of a texture, from the cache of this user or made now."""
    # Of the source: an older program's cache holds other textures.
    source = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
    cache, key = ArrayCache(find_cache_folder("textures")), f"{name}-{source}"
    cached = cache.read(key, 1)
    if cached is not None and cached[0].shape == (SIDE_PX, SIDE_PX, 3):
        return cached[0].astype(np.uint8, copy=False)
    image = make_texture(name)
    cache.write(key, [image])
    return image


def make_texture(name: str) -> npt.NDArray[np.uint8]:
    """(h, w, 3) sRGB of a texture, read-only."""
    # By the name: another texture's place in the table changes nothing.
    random = np.random.default_rng(list(name.encode()))
    light = _PICTURES[name](random) if name in _PICTURES else _lay(name, random)
    image: npt.NDArray[np.uint8] = np.rint(np.clip(light, 0.0, 255.0)).astype(np.uint8)
    image.setflags(write=False)
    return image


def _lay(name: str, random: _Random) -> Floats:
    """(h, w, 3) sRGB, 0 to 255, of a surface by its rows in the tables."""
    texture = NAMED_TEXTURES[name]
    own, gap, tone = np.zeros_like(_X), np.ones_like(_X), np.full_like(_X, 0.5)
    if pieces := _PIECES.get(name):
        rows, columns, shift, spread, *_ = pieces
        own, gap = _courses(random, rows, columns, shift) if columns else _cells(random, rows)
        tone += spread * (own - 0.5)
    # Another part of the noise for each piece.
    row, column = np.indices(_X.shape)
    row = (row + (own * 4099).astype(np.intp) * 37) % SIDE_PX
    column = (column + (own * 8191).astype(np.intp)) % SIDE_PX
    for amplitude, *size in texture.noises:
        tone += amplitude * _noise(random, *size)[row, column]
    if name in _VEINS:
        amplitude, *size, width = _VEINS[name]
        lines = _ramp(np.abs(_noise(random, *size)[row, column]), 0.0, width)
        tone += amplitude * (lines - 0.5)
    colours = _colours(texture.colours)
    place = np.clip(tone, 0.0, 1.0) * (len(colours) - 1)
    first = np.minimum(place.astype(np.intp), len(colours) - 2)
    light = colours[first] + (place - first)[..., None] * (colours[first + 1] - colours[first])
    if name in _STAINS:
        colour, *size, low, high = _STAINS[name]
        light += _ramp(_noise(random, *size), low, high)[..., None] * (_colours(colour) - light)
    if pieces:
        *_, joint, low, high = pieces
        light = _colours(joint) + _ramp(gap, low, high)[..., None] * (light - _colours(joint))
    return np.asarray(light)


def _colours(text: str) -> Floats:
    return np.frombuffer(bytes.fromhex(text), np.uint8).reshape(-1, 3).astype(np.float64)


def _noise(random: _Random, rows: int, columns: int, octaves: int) -> Floats:
    """(h, w) noise about 0, within 1: a grid of random numbers, then finer and weaker ones."""
    if octaves == 0:
        return np.asarray(sin(2.0 * np.pi * (rows * _Y + columns * _X)))
    total = np.zeros_like(_X)
    for octave in range(octaves):
        values = random.random((min(rows << octave, SIDE_PX), min(columns << octave, SIDE_PX)))
        for _ in range(2):  # rows, then columns
            count = len(values)
            place = (np.arange(SIDE_PX) + 0.5) * count / SIDE_PX - 0.5
            before = np.floor(place)
            part = place - before
            part = (part * part * (3.0 - 2.0 * part))[:, None]
            first = before.astype(np.intp) % count
            values = ((1.0 - part) * values[first] + part * values[(first + 1) % count]).T
        total += 0.5**octave * (2.0 * values - 1.0)
    return np.asarray(total / (2.0 - 0.5 ** (octaves - 1)))


def _ramp(values: Floats, low: float, high: float) -> Floats:
    """Values mapped from [low, high] to [0, 1], clipped."""
    return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))


def _courses(random: _Random, rows: int, columns: int, shift: float) -> tuple[Floats, Floats]:
    """Courses of pieces: (h, w) a random number of each, and distances to its edge, of the tile's
    side."""
    row = np.floor(_Y * rows).astype(np.intp)
    offsets = np.arange(rows) * shift if shift else random.random(rows)
    along, across = _X * columns + offsets[row], _Y * rows - row
    column = np.floor(along)
    along = along - column
    gap = np.minimum(
        np.minimum(along, 1.0 - along) / columns, np.minimum(across, 1.0 - across) / rows
    )
    return random.random((rows, columns))[row, column.astype(np.intp) % columns], gap


def _cells(random: _Random, count: int) -> tuple[Floats, Floats]:
    """Cells around a random point in each of count x count squares: (h, w) a random number of each,
    and how much farther the next point is, of a cell's width."""
    tones, points = random.random((count, count)), random.random((count, count, 2))
    row, column = np.floor(_Y * count).astype(np.intp), np.floor(_X * count).astype(np.intp)
    around = [(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    places = [(y % count, x % count) for y, x in around]
    distance = np.stack(
        [
            np.sqrt(
                np.square(y + points[place][..., 0] - _Y * count)
                + np.square(x + points[place][..., 1] - _X * count)
            )
            for (y, x), place in zip(around, places, strict=True)
        ]
    )
    nearest = np.partition(distance, 1, axis=0)
    own = np.choose(distance.argmin(axis=0), [tones[place] for place in places])
    return own, nearest[1] - nearest[0]


def _fill(image: Floats, area: tuple[float, ...], colour: _Colour) -> None:
    """Colour a rectangle from left, top to right, bottom, in shares of the tile."""
    left, top, right, bottom = (round(at * SIDE_PX) for at in area)
    image[top:bottom, left:right] = colour


def _draw_books(random: _Random) -> Floats:
    """Two rows of spines, one above the other, each half a tile high."""
    image = np.full((SIDE_PX, SIDE_PX, 3), 26.0)
    cloth = [(146, 40, 36), (32, 64, 116), (52, 96, 60), (214, 196, 150), (60, 58, 62)]
    cloth += [(196, 120, 44), (232, 230, 222), (92, 44, 84), (28, 108, 124)]
    for bottom in (0.5, 1.0):
        left = 0.0
        while left < 1.0:
            right = min(left + float(random.uniform(0.022, 0.062)), 1.0)
            right = 1.0 if right > 0.97 else right
            top = bottom - float(random.uniform(0.3, 0.45))
            inks = random.permutation(len(cloth))[:2].tolist()
            _fill(image, (left, top, right - 0.004, bottom - 0.01), cloth[inks[0]])
            for _ in range(2):
                band = top + float(random.uniform(0.05, 0.2))
                size = float(random.uniform(0.01, 0.07))
                _fill(image, (left + 0.006, band, right - 0.01, band + size), cloth[inks[1]])
            left = right
    # The seam lies within a book.
    return np.asarray(
        np.roll(image, 5, axis=1) * (1.0 + 0.25 * _noise(random, 64, 64, 2))[..., None]
    )


def _write_lines(
    image: Floats, random: _Random, area: tuple[float, ...], count: int, inks: tuple[_Colour, ...]
) -> None:
    """Lines of words in a rectangle."""
    left, top, right, bottom = area
    step = (bottom - top) / count
    for line in range(count):
        at, end = left, right - float(random.uniform(0.0, 0.35)) * (right - left)
        while at < end:
            size = float(random.uniform(0.01, 0.035))
            ink = inks[int(random.integers(len(inks)))]
            y = top + line * step
            _fill(image, (at, y, min(at + size, right), y + 0.5 * step), ink)
            at += size + 0.006


def _draw_curve(
    image: Floats, random: _Random, area: tuple[float, ...], ink: _Colour, wave: float
) -> None:
    """A noisy curve in a rectangle."""
    left, top, right, bottom = area
    phase, middle = float(random.uniform(0.0, 6.0)), 0.5 * (top + bottom)
    for x in np.linspace(left, right, 200).tolist():
        part = (x - left) / (right - left)
        swing = float(sin(phase + wave * part)) * (1.0 - 0.5 * part)
        y = middle + 0.42 * (bottom - top) * swing + float(random.uniform(-0.003, 0.003))
        _fill(image, (x, y, x + 0.006, y + 0.007), ink)


def _draw_posters(random: _Random) -> Floats:
    """Four posters, two by two."""
    image = np.full((SIDE_PX, SIDE_PX, 3), 242.0)
    heads = ((24, 62, 122), (160, 44, 36), (28, 104, 76), (58, 52, 70))
    grey = ((70, 72, 76), (96, 98, 104))
    for number, head in enumerate(heads):
        x, y = 0.5 * (number % 2), 0.5 * (number // 2)
        _fill(image, (x + 0.02, y + 0.02, x + 0.48, y + 0.09), head)
        _write_lines(image, random, (x + 0.05, y + 0.04, x + 0.4, y + 0.07), 1, ((240, 240, 236),))
        _write_lines(image, random, (x + 0.04, y + 0.11, x + 0.23, y + 0.28), 9, grey)
        _write_lines(image, random, (x + 0.27, y + 0.31, x + 0.46, y + 0.47), 9, grey)
        light = (214, 224, 236) if number % 2 else (236, 226, 206)
        _fill(image, (x + 0.27, y + 0.11, x + 0.46, y + 0.28), light)
        _fill(image, (x + 0.04, y + 0.31, x + 0.23, y + 0.47), (38, 44, 54))
        _draw_curve(image, random, (x + 0.28, y + 0.12, x + 0.45, y + 0.27), head, 9.0 + number)
        for ink in ((235, 180, 40), (60, 190, 210)):
            _draw_curve(image, random, (x + 0.05, y + 0.33, x + 0.22, y + 0.46), ink, 14.0)
    return image


def _draw_screens(random: _Random) -> Floats:
    """Four screens, two by two: programs and pictures of cameras."""
    image = np.full((SIDE_PX, SIDE_PX, 3), (24.0, 27.0, 34.0))
    inks = ((120, 190, 250), (240, 190, 90), (150, 220, 140), (220, 225, 230), (230, 120, 130))
    for number in range(4):
        x, y = 0.5 * (number % 2), 0.5 * (number // 2)
        _fill(image, (x + 0.02, y + 0.02, x + 0.48, y + 0.05), (52, 66, 96))
        _write_lines(image, random, (x + 0.03, y + 0.07, x + 0.26, y + 0.47), 17, inks)
        _fill(image, (x + 0.29, y + 0.08, x + 0.47, y + 0.3), (42, 96, 62))
        _draw_curve(image, random, (x + 0.3, y + 0.09, x + 0.46, y + 0.29), (240, 240, 235), 6.0)
        _draw_curve(image, random, (x + 0.29, y + 0.33, x + 0.47, y + 0.46), inks[number], 20.0)
    return image


def _draw_whiteboard(random: _Random) -> Floats:
    image = np.full((SIDE_PX, SIDE_PX, 3), (233.0, 235.0, 234.0))
    blue, red, green = (36, 60, 150), (186, 40, 36), (30, 116, 70)
    for row in range(7):
        top = 0.1 + 0.11 * row
        end = 0.2 + float(random.uniform(0.1, 0.25))
        _draw_curve(image, random, (0.08, top, end, top + 0.05), (blue, green)[row % 2], 40.0)
    for ink, wave in ((red, 3.0), (blue, 5.0), (green, 9.0)):
        _draw_curve(image, random, (0.55, 0.15, 0.93, 0.8), ink, wave)
    _fill(image, (0.55, 0.82, 0.93, 0.826), (50, 50, 54))
    _fill(image, (0.55, 0.15, 0.554, 0.826), (50, 50, 54))
    return np.asarray(image * (0.97 + 0.03 * _noise(random, 6, 6, 3))[..., None])


# fmt: off  # a row each: opened up they are 130 lines
NAMED_TEXTURES = {
    "asphalt": NamedTexture(1.5, "303032 5c5c5c 82807c", ((0.25, 8, 8, 5),)),
    "bark": NamedTexture(0.8, "261b13 584432 84705a", ((0.2, 64, 128, 2), (0.12, 0, 14, 0))),
    "books": NamedTexture(0.0),
    "brick": NamedTexture(1.0, "763428 a04c38 ba684e", ((0.3, 32, 32, 4), (0.3, 128, 128, 2))),
    "cardboard": NamedTexture(
        0.6, "9c7246 c29868", ((0.3, 4, 32, 4), (0.25, 160, 160, 1), (0.1, 0, 80, 0))
    ),
    "carpet": NamedTexture(1.0, "222e4e 40527a", ((0.55, 256, 256, 1), (0.2, 8, 8, 4))),
    "concrete": NamedTexture(2.0, "706e6a a6a49e", ((0.5, 7, 7, 6), (0.3, 128, 128, 2))),
    "corrugated": NamedTexture(1.0, "545c64 8a9298 bcc2c6", ((0.12, 6, 24, 5), (0.4, 0, 8, 0))),
    "fabric": NamedTexture(
        0.25,
        "602a28 9c544c",
        ((0.3, 128, 128, 1), (0.15, 6, 6, 4), (0.15, 0, 64, 0), (0.15, 64, 0, 0)),
    ),
    "felt": NamedTexture(1.0, "cccccc fafafa", ((0.55, 256, 256, 1), (0.2, 8, 8, 4))),
    "grass": NamedTexture(
        1.5, "1c3810 426c22 78963e", ((0.5, 128, 256, 2), (0.35, 64, 160, 2), (0.25, 6, 6, 4))
    ),
    "gravel": NamedTexture(1.0, "5c544c 8e867a bab2a4", ((0.3, 128, 128, 2),)),
    "leaves": NamedTexture(1.0, "102208 2c541c 62883a", ((0.4, 64, 64, 2),)),
    "marble": NamedTexture(1.5, "707076 cecdce f0efec", ((0.15, 8, 8, 4),)),
    "metal": NamedTexture(1.0, "888e96 b0b6be", ((0.3, 256, 3, 1), (0.3, 4, 4, 5))),
    "planks": NamedTexture(1.2, "6c5238 b08e66", ((0.45, 128, 4, 3),)),
    "plaster": NamedTexture(2.0, "ccc8be ece9e0", ((0.35, 6, 6, 5), (0.25, 128, 128, 2))),
    "posters": NamedTexture(0.0),
    "roof": NamedTexture(1.5, "52221c 843e2e a85c44", ((0.3, 24, 24, 4),)),
    "screens": NamedTexture(0.0),
    "tiles": NamedTexture(1.2, "c4c2ba e4e2da", ((0.25, 8, 8, 4),)),
    "whiteboard": NamedTexture(0.0),
    "wood": NamedTexture(1.0, "96704c c8a074", ((0.45, 128, 4, 3),)),
    "wood_floor": NamedTexture(2.0, "946236 d09e68", ((0.45, 128, 4, 3),)),
}
# Bricks, boards, slabs: rows, columns and shift of a row, 0: by random lengths; without columns
# stones, leaves. Range of their brightness, colour between them, distances in which theirs begins.
_PIECES: dict[str, tuple[int, int, float, float, str, float, float]] = {
    "asphalt": (96, 0, 0.0, 0.45, "3c3c3c", -0.2, 0.3),
    "brick": (12, 4, 0.5, 1.0, "a8a298", 0.005, 0.008),
    "gravel": (36, 0, 0.0, 0.7, "423c36", 0.0, 0.35),
    "leaves": (26, 0, 0.0, 1.1, "0a1406", -0.1, 0.4),
    "planks": (8, 1, 0.0, 0.5, "3a2c1e", 0.0, 0.005),
    "roof": (6, 5, 0.5, 0.4, "34160f", 0.0, 0.014),
    "tiles": (4, 4, 1.0, 0.35, "7e7a74", 0.004, 0.007),
    "wood_floor": (16, 2, 0.0, 0.5, "5a3a20", 0.0, 0.002),
}
# Brightness by the distance from the zeros of a noise: amplitude, the noise, range.
_VEINS = {
    "bark": (1.0, 10, 24, 4, 0.4),
    "marble": (0.7, 3, 3, 6, 0.12),
    "planks": (0.5, 56, 2, 2, 0.16),
    "wood": (0.5, 24, 2, 2, 0.16),
    "wood_floor": (0.5, 80, 2, 2, 0.16),
}
# Colour where a noise exceeds a range of values.
_STAINS = {
    "concrete": ("5a5855", 90, 90, 1, 0.75, 0.95),
    "corrugated": ("6c4630", 5, 10, 6, 0.32, 0.6),
}
# fmt: on
_PICTURES = {
    "books": _draw_books,
    "posters": _draw_posters,
    "screens": _draw_screens,
    "whiteboard": _draw_whiteboard,
}
