"""Textures by name: seeded, tileable, made from noise, courses and cells.

A world writes `Texture=catoptra:brick`. Each texture has the size of its tile in metres, which
`Repeat` replaces. They are made once and kept on disk (`runtime/array_cache.py`): 0.1 s each. Only
sums, products, roots and uniform random numbers: the same bytes on every processor. Brightness is
even over a tile, so that a large floor shows no pattern from afar. A new texture is a line of
`NAMED_TEXTURES`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
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
_Tone = Callable[[_Random], Floats]
_Y, _X = (np.indices((SIDE_PX, SIDE_PX)) + 0.5) / SIDE_PX


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
    image = np.rint(np.clip(NAMED_TEXTURES[name].make(random), 0.0, 255.0)).astype(np.uint8)
    image.setflags(write=False)
    return image


def _noise(random: _Random, rows: int, columns: int, octaves: int = 4) -> Floats:
    """(h, w) noise about 0, within 1: a grid of random numbers, then finer and weaker ones."""
    total = np.zeros((SIDE_PX, SIDE_PX))
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
    return total / (2.0 - 0.5 ** (octaves - 1))


def _blend(amount: Floats, *colours: _Colour) -> Floats:
    """(h, w, 3) colours between evenly spaced ones, at (h, w) amounts in [0, 1]."""
    place = np.clip(amount, 0.0, 1.0) * (len(colours) - 1)
    first = np.minimum(place.astype(np.intp), len(colours) - 2)
    table, part = np.array(colours, dtype=np.float64), (place - first)[..., None]
    return np.asarray((1.0 - part) * table[first] + part * table[first + 1])


def _ramp(values: Floats, low: float, high: float) -> Floats:
    """Values mapped from [low, high] to [0, 1], clipped."""
    return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))


def _mottle(
    *noises: tuple[float, int, int, int], waves: tuple[tuple[float, int, int], ...] = ()
) -> _Tone:
    """(h, w) brightness about a half by sums of noise (amplitude, rows, columns, octaves) and of
    sine waves (amplitude, number along the rows, along the columns)."""

    def make(random: _Random) -> Floats:
        tone = np.full_like(_X, 0.5)
        for amplitude, *size in noises:
            tone += amplitude * _noise(random, *size)
        for amplitude, along, down in waves:
            tone += amplitude * sin(2.0 * np.pi * (along * _X + down * _Y))
        return np.asarray(tone)

    return make


def _paint(tone: _Tone, *colours: _Colour) -> _Tone:
    return lambda random: _blend(tone(random), *colours)


def _shade(colours: Floats, factor: Floats) -> Floats:
    return np.asarray(colours * factor[..., None])


class _Courses(NamedTuple):
    """Bricks, boards or slabs of a tile."""

    tone: Floats
    """(h, w) random number in [0, 1) of each piece."""
    gap: Floats
    """(h, w) distance to the piece's edge, of the tile's side."""
    along: Floats
    """(h, w) place along each piece from 0 to 1, and the same `across`."""
    across: Floats


def _courses(random: _Random, rows: int, columns: int, shift: float = 0.5) -> _Courses:
    """Courses of pieces, each shifted against the one below; shift 0: by a random length."""
    row = np.floor(_Y * rows).astype(np.intp)
    offsets = np.arange(rows) * shift if shift else random.random(rows)
    u, across = _X * columns + offsets[row], _Y * rows - row
    column = np.floor(u)
    tone = random.random((rows, columns))[row, column.astype(np.intp) % columns]
    along = u - column
    side = np.minimum(
        np.minimum(along, 1.0 - along) / columns, np.minimum(across, 1 - across) / rows
    )
    return _Courses(tone, side, along, across)


class _Cells(NamedTuple):
    """Stones or leaves of a tile."""

    tone: Floats
    """(h, w) random number in [0, 1) of each cell."""
    near: Floats
    """(h, w) distance to the cell's point, of a cell's width."""
    gap: Floats
    """(h, w) how much farther the next point is."""


def _cells(random: _Random, count: int) -> _Cells:
    """Cells around a random point in each of count x count squares."""
    tones, points = random.random((count, count)), random.random((count, count, 2))
    row, column = np.floor(_Y * count).astype(np.intp), np.floor(_X * count).astype(np.intp)
    near, gap, tone = np.full_like(_X, 9.0), np.full_like(_X, 9.0), np.zeros_like(_X)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            place = (row + i) % count, (column + j) % count
            at = points[place]
            y, x = row + i + at[..., 0] - _Y * count, column + j + at[..., 1] - _X * count
            distance = np.sqrt(x * x + y * y)
            is_nearer = distance < near
            gap = np.where(is_nearer, near, np.minimum(gap, distance))
            tone = np.where(is_nearer, tones[place], tone)
            near = np.minimum(near, distance)
    return _Cells(tone, near, gap - near)


def _lay_boards(rows: int, columns: int, gap: float, dark: _Colour, light: _Colour) -> _Tone:
    """Boards with a grain of their own."""

    def make(random: _Random) -> Floats:
        board, grain = _courses(random, rows, columns, 0.0), _noise(random, 128, 4, 3)
        rings = sin(26.0 * _noise(random, 24, 2, 2))
        # Another piece of the grain for each board.
        row, column = np.indices(_X.shape)
        row = (row + (board.tone * 4099).astype(np.intp) * 37) % SIDE_PX
        column = (column + (board.tone * 8191).astype(np.intp)) % SIDE_PX
        tone = 0.5 * board.tone + 0.25 + 0.45 * grain[row, column] + 0.2 * rings[row, column]
        return _shade(_blend(tone, dark, light), 0.55 + 0.45 * _ramp(board.gap, 0.0, gap))

    return make


def _make_brick(random: _Random) -> Floats:
    brick, rough = _courses(random, 12, 4), _noise(random, 32, 32)
    clay = _blend(brick.tone + 0.3 * rough, (118, 52, 40), (160, 76, 56), (186, 104, 78))
    clay = _shade(clay, 1.0 + 0.22 * _noise(random, 128, 128, 2))
    mortar = _blend(0.5 + 0.8 * _noise(random, 64, 64, 3), (150, 144, 134), (188, 182, 170))
    is_clay = _ramp(brick.gap + 0.004 * rough, 0.005, 0.008)[..., None]
    return mortar + is_clay * (clay - mortar)


def _make_tiles(random: _Random) -> Floats:
    slab = _courses(random, 4, 4, 1.0)
    tone = 0.5 + 0.35 * (slab.tone - 0.5) + 0.25 * _noise(random, 8, 8)
    glaze = _blend(tone, (196, 194, 186), (228, 226, 218))
    is_glaze = _ramp(slab.gap, 0.004, 0.007)[..., None]
    return np.array([126.0, 122.0, 116.0]) + is_glaze * (glaze - (126.0, 122.0, 116.0))


def _make_concrete(random: _Random) -> Floats:
    tone = _mottle((0.5, 7, 7, 6), (0.3, 128, 128, 2))(random)
    pores = _ramp(_noise(random, 90, 90, 1), -0.92, -0.7)
    return _shade(_blend(tone, (112, 110, 106), (166, 164, 158)), 0.72 + 0.28 * pores)


def _make_gravel(random: _Random) -> Floats:
    stone = _cells(random, 36)
    tone = 0.15 + 0.7 * stone.tone + 0.3 * _noise(random, 128, 128, 2)
    colours = _blend(tone, (92, 84, 76), (142, 134, 122), (186, 178, 164))
    lit = _ramp(stone.gap, 0.0, 0.35) * (1.15 - 0.35 * stone.near)
    return _shade(colours, 0.52 + 0.48 * lit)


def _make_asphalt(random: _Random) -> Floats:
    stone = _cells(random, 96)
    tone = 0.35 + 0.45 * (stone.tone - 0.5) + 0.25 * _noise(random, 8, 8, 5)
    colours = _blend(tone, (48, 48, 50), (92, 92, 92), (130, 128, 124))
    return _shade(colours, 0.7 + 0.3 * _ramp(stone.gap, 0.0, 0.3))


def _make_sheet_steel(random: _Random) -> Floats:
    tone = _mottle((0.12, 6, 24, 5), waves=((0.4, 8, 0),))(random)
    rust = _ramp(_noise(random, 5, 10, 6), 0.32, 0.6)[..., None]
    steel = _blend(tone, (84, 92, 100), (138, 146, 152), (188, 194, 198))
    return steel + rust * (_blend(tone, (74, 46, 30), (140, 92, 58)) - steel)


def _make_bark(random: _Random) -> Floats:
    bent = _X + 0.05 * _noise(random, 4, 4, 3)
    ridge = np.abs(_noise(random, 10, 24, 4)) + 0.12 * sin(2.0 * np.pi * 14.0 * bent)
    tone = _ramp(ridge, -0.05, 0.42) + 0.2 * _noise(random, 64, 128, 2)
    return _blend(tone, (38, 27, 19), (88, 68, 50), (132, 112, 90))


def _make_leaves(random: _Random) -> Floats:
    colours = np.zeros((SIDE_PX, SIDE_PX, 3))
    # Three layers of foliage, the upper ones brighter and with gaps.
    for layer, count in enumerate((26, 20, 16)):
        leaf = _cells(random, count)
        tone = 0.25 * layer + 0.5 * leaf.tone + 0.25 * _noise(random, 64, 64, 2)
        green = _blend(tone, (16, 34, 12), (44, 84, 28), (98, 136, 54))
        green = _shade(green, 0.5 + 0.5 * _ramp(leaf.gap, 0.0, 0.3))
        shows = (leaf.near < 0.62 - 0.12 * layer) & (leaf.tone > 0.25 * layer)
        colours = np.where((shows | (layer == 0))[..., None], green, 0.97 * colours)
    return colours


def _make_marble(random: _Random) -> Floats:
    vein = np.abs(_noise(random, 3, 3, 6)) + 0.04 * _noise(random, 48, 48, 2)
    tone = _ramp(vein, 0.0, 0.09) * 0.55 + 0.45 + 0.15 * _noise(random, 8, 8)
    return _blend(tone, (112, 112, 118), (206, 205, 206), (240, 239, 236))


def _fill(image: Floats, area: tuple[float, ...], colour: _Colour) -> None:
    """Colour a rectangle from left, top to right, bottom, in shares of the tile."""
    left, top, right, bottom = (round(at * SIDE_PX) for at in area)
    image[top:bottom, left:right] = colour


def _make_books(random: _Random) -> Floats:
    """Two rows of spines, one above the other, each half a tile high."""
    image = np.full((SIDE_PX, SIDE_PX, 3), 26.0)
    cloth: tuple[_Colour, ...] = (
        (146, 40, 36),
        (32, 64, 116),
        (52, 96, 60),
        (214, 196, 150),
        (60, 58, 62),
    )
    cloth = (*cloth, (196, 120, 44), (232, 230, 222), (92, 44, 84), (28, 108, 124))
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
    return _shade(np.roll(image, 5, axis=1), 1.0 + 0.25 * _noise(random, 64, 64, 2))


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


def _make_posters(random: _Random) -> Floats:
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


def _make_screens(random: _Random) -> Floats:
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


def _make_whiteboard(random: _Random) -> Floats:
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
    wiped = _noise(random, 6, 6, 3)
    return _shade(image, 0.97 + 0.03 * wiped)


def _make_roof(random: _Random) -> Floats:
    tile = _courses(random, 6, 5)
    tone = 0.4 + 0.4 * (tile.tone - 0.5) + 0.3 * _noise(random, 24, 24)
    clay = _blend(tone, (82, 34, 28), (132, 62, 46), (168, 92, 68))
    lit = 0.62 + 0.38 * _ramp(tile.across, 0.0, 0.5) * _ramp(1.0 - tile.across, 0.0, 0.12)
    return _shade(clay, lit * (0.7 + 0.3 * _ramp(tile.gap, 0.0, 0.012)))


class NamedTexture(NamedTuple):
    """One texture."""

    tile_m: float
    """Side of its tile; 0: a picture, which covers each face once."""
    make: _Tone
    """(h, w, 3) sRGB, 0 to 255."""


_CARDBOARD = _mottle((0.3, 4, 32, 4), (0.25, 160, 160, 1), waves=((0.1, 80, 0),))
_FABRIC = _mottle((0.3, 128, 128, 1), (0.15, 6, 6, 4), waves=((0.15, 64, 0), (0.15, 0, 64)))
_GRASS = _mottle((0.5, 128, 256, 2), (0.35, 64, 160, 2), (0.25, 6, 6, 4))
_GREY = (204, 204, 204), (250, 250, 250)
_WEAVE = _mottle((0.55, 256, 256, 1), (0.2, 8, 8, 4))
_BRUSHED = _mottle((0.3, 256, 3, 1), (0.3, 4, 4, 5))
_TROWELLED = _mottle((0.35, 6, 6, 5), (0.25, 128, 128, 2))

NAMED_TEXTURES = {
    "asphalt": NamedTexture(1.5, _make_asphalt),
    "bark": NamedTexture(0.8, _make_bark),
    "books": NamedTexture(0.0, _make_books),
    "brick": NamedTexture(1.0, _make_brick),
    "cardboard": NamedTexture(0.6, _paint(_CARDBOARD, (156, 114, 70), (194, 152, 104))),
    "carpet": NamedTexture(1.0, _paint(_WEAVE, (34, 46, 78), (64, 82, 122))),
    "concrete": NamedTexture(2.0, _make_concrete),
    "corrugated": NamedTexture(1.0, _make_sheet_steel),
    "fabric": NamedTexture(0.25, _paint(_FABRIC, (96, 42, 40), (156, 84, 76))),
    "felt": NamedTexture(1.0, _paint(_WEAVE, *_GREY)),
    "grass": NamedTexture(1.5, _paint(_GRASS, (28, 56, 16), (66, 108, 34), (120, 150, 62))),
    "gravel": NamedTexture(1.0, _make_gravel),
    "leaves": NamedTexture(1.0, _make_leaves),
    "marble": NamedTexture(1.5, _make_marble),
    "metal": NamedTexture(1.0, _paint(_BRUSHED, (136, 142, 150), (176, 182, 190))),
    "planks": NamedTexture(1.2, _lay_boards(8, 1, 0.005, (108, 82, 56), (176, 142, 102))),
    "plaster": NamedTexture(2.0, _paint(_TROWELLED, (204, 200, 190), (236, 233, 224))),
    "posters": NamedTexture(0.0, _make_posters),
    "roof": NamedTexture(1.5, _make_roof),
    "screens": NamedTexture(0.0, _make_screens),
    "tiles": NamedTexture(1.2, _make_tiles),
    "whiteboard": NamedTexture(0.0, _make_whiteboard),
    "wood": NamedTexture(1.0, _lay_boards(1, 1, 1e-6, (150, 112, 76), (200, 160, 116))),
    "wood_floor": NamedTexture(2.0, _lay_boards(16, 2, 0.002, (148, 98, 54), (208, 158, 104))),
}
