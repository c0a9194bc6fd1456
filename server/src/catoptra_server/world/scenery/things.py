"""Parts of which scenery is built: boxes, turned and extruded shapes, rods, leaves, by material.

A `Thing` is one object, in a frame of its own: x out of its front, y to its left, z up, the floor
at z = 0. `Scenery.place` puts it into the world (SAE: y right, z down). Heights therefore are
positive here. Turned shapes have smooth normals.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.elementary import cos, matmul, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.named_textures import NAMED_TEXTURES
from catoptra_server.world.shapes import Patch, box, facet_normals, grid
from catoptra_server.world.world_description import (
    Box,
    Facets,
    Item,
    Material,
    RectangleLight,
    SurfaceGloss,
    Vector3,
    linear_from_srgb,
)

Colour = tuple[int, int, int]
WHOLE = (0.0, 0.0, 1.0, 1.0)
# Half a turn about x: from x front, y left, z up to SAE, and back.
_FLIP = np.array((1.0, -1.0, -1.0))


@lru_cache(maxsize=256)
def paint(
    red: float,
    green: float,
    blue: float,
    texture: str = "",
    *,
    tile_m: float = 0.0,
    gloss: tuple[float, float] | None = None,
    emission: float = 0.0,
) -> Material:
    """Material of a colour in sRGB bytes, times a texture by name."""
    r, g, b = linear_from_srgb(np.array((red, green, blue)) / 255.0).tolist()
    return Material(
        (r, g, b),
        texture or None,
        tile_m=tile_m or (NAMED_TEXTURES[texture].tile_m if texture else 0.0),
        emission=(emission * r, emission * g, emission * b),
        gloss=None if gloss is None else SurfaceGloss(*gloss),
    )


def shine(red: float, green: float, blue: float, texture: str = "") -> Material:
    """Material shown as it is, whatever the light, for what is far outside a window."""
    return replace(paint(red, green, blue, texture), unlit=True)


def picture(texture: str) -> Material:
    """Material of a picture."""
    return paint(255, 255, 255, texture)


class Thing:
    """One object under construction."""

    def __init__(self) -> None:
        """Begin without a part."""
        self.parts: dict[Material, list[tuple[Floats, Floats, Floats]]] = defaultdict(list)
        """Corners, texture coordinates and normals, (n, 3, k) each, by material."""

    def add(self, material: Material, patch: Patch, normals: Floats | None = None) -> None:
        """Add triangles, flat where they have no normals."""
        if normals is None:
            facets, _ = facet_normals(patch.corners)
            normals = np.repeat(facets[:, None], 3, axis=1)
        self.parts[material].append((patch.corners, patch.uv, normals))

    def box(
        self,
        material: Material,
        at: Vector3,
        size: Vector3,
        turn_deg: Vector3 = (0.0, 0.0, 0.0),
        cell: tuple[float, float, float, float] = WHOLE,
    ) -> None:
        """Box around a point; each side shows a cell (left, top, right, bottom) of a picture."""
        patch = box(Box(size))
        corners = _turn(patch.corners * _FLIP, turn_deg) + np.asarray(at)
        left, top, right, bottom = cell
        self.add(material, Patch(corners, (left, top) + patch.uv * (right - left, bottom - top)))

    def stand(self, material: Material, x: float, y: float, z: float, size: Vector3) -> None:
        """Upright box on a height z."""
        self.box(material, (x, y, z + 0.5 * size[2]), size)

    def lathe(
        self,
        material: Material,
        at: Vector3,
        profile: Sequence[tuple[float, float]],
        *,
        sectors: int = 16,
        turn_deg: Vector3 = (0.0, 0.0, 0.0),
        is_round: bool = False,
    ) -> None:
        """Shape turned about z, by (radius, height) upwards; smooth along it, too, if round."""
        angle = np.linspace(0.0, 2.0 * math.pi, sectors + 1)
        radii, heights = np.array(profile, dtype=np.float64).T
        slopes = np.stack((np.diff(heights), -np.diff(radii)), axis=1)
        slopes /= np.linalg.norm(slopes, axis=1, keepdims=True)
        ends = np.stack((slopes, slopes), axis=1)
        if is_round:
            ends[1:, 0] = ends[:-1, 1] = slopes[1:] + slopes[:-1]
        circle = np.stack((cos(angle), sin(angle)), axis=-1)
        ring = np.zeros((len(ends), 2, len(angle), 3))
        look = np.zeros((len(ends), 2, len(angle), 5))
        rows = np.arange(len(ends))[:, None] + np.arange(2)
        ring[..., :2], ring[..., 2] = (
            radii[rows][..., None, None] * circle,
            heights[rows][..., None],
        )
        look[..., 0], look[..., 1] = angle, 1.0 - heights[rows][..., None]
        look[..., 2:4], look[..., 4] = ends[..., None, :1] * circle, ends[..., 1:]
        both = grid(ring, look)
        normals = both.uv[..., 2:] / np.linalg.norm(both.uv[..., 2:], axis=-1, keepdims=True)
        patch = Patch(_turn(both.corners, turn_deg) + np.asarray(at), both.uv[..., :2])
        self.add(material, patch, _turn(normals, turn_deg))

    def rod(
        self,
        material: Material,
        at: Vector3,
        radius: float,
        height: float,
        *,
        turn_deg: Vector3 = (0.0, 0.0, 0.0),
        sectors: int = 10,
    ) -> None:
        """Closed cylinder upwards from a point, before the turn about that."""
        ends = [(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)]
        self.lathe(material, at, ends, sectors=sectors, turn_deg=turn_deg)

    def ball(self, material: Material, at: Vector3, radius: float, flat: float = 1.0) -> None:
        """Ball around a point, its height times `flat`."""
        angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 7)
        profile = zip(
            (radius * cos(angle)).tolist(), (flat * radius * sin(angle)).tolist(), strict=True
        )
        self.lathe(material, at, list(profile), sectors=12, is_round=True)

    def extrude(
        self,
        material: Material,
        at: Vector3,
        outline: Sequence[tuple[float, float]],
        width: float,
        turn_deg: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Solid along y of an outline (x, z), counter-clockwise from the right, a star's shape."""
        flat = np.array([(x, 0.0, z) for x, z in outline])
        side = np.array((0.0, 0.5 * width, 0.0))
        near, far = flat - side, flat + side
        after, beyond = np.roll(near, -1, axis=0), np.roll(far, -1, axis=0)
        caps = (
            np.broadcast_to(near.mean(axis=0), near.shape),
            np.broadcast_to(far.mean(0), far.shape),
        )
        triangles = [
            np.stack(corners, axis=1)
            for corners in (
                (caps[0], near, after),
                (caps[1], beyond, far),
                (far, beyond, after),
                (far, after, near),
            )
        ]
        corners = _turn(np.concatenate(triangles), turn_deg) + np.asarray(at)
        uv = np.tile(np.array(((0.0, 1.0), (1.0, 1.0), (1.0, 0.0))), (len(corners), 1, 1))
        self.add(material, Patch(corners, uv))

    def leaves(
        self,
        material: Material,
        random: np.random.Generator,
        at: Vector3,
        reach: Vector3,
        count: int,
        size: float,
    ) -> None:
        """Kites of leaves near the surface of an ellipsoid, which face outwards and up."""
        out = random.uniform(-1.0, 1.0, (count, 3))
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        centre = np.asarray(at) + out * reach * random.uniform(0.72, 1.04, (count, 1))
        normal = out + random.uniform(-0.5, 0.5, (count, 3)) + np.array((0.0, 0.0, 0.5))
        along = np.cross(normal, random.uniform(-1.0, 1.0, (count, 3)))
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        across = np.cross(normal, along)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        length = size * random.uniform(0.6, 1.3, (count, 1))
        tip, side = along * length, across * (0.42 * length)
        corners = np.stack((centre - tip, centre + side, centre + tip), axis=1)
        mirrored = np.stack((centre - tip, centre + tip, centre - side), axis=1)
        corners = np.concatenate((corners, mirrored))
        facets, _ = facet_normals(corners)
        corners = np.where(
            (facets * np.tile(out, (2, 1))).sum(-1)[:, None, None] < 0, corners[:, ::-1], corners
        )
        # Lit as the crown is, not each by its own normal: foliage is soft.
        soft = np.repeat((np.tile(out, (2, 1)) + np.array((0.0, 0.0, 0.35)))[:, None], 3, axis=1)
        soft /= np.linalg.norm(soft, axis=-1, keepdims=True)
        uv = random.uniform(0.0, 1.0, (len(corners), 1, 2)) + 0.1 * np.eye(3)[:, :2]
        self.add(material, Patch(corners, uv), soft)


def _turn(points: Floats, turn_deg: Vector3) -> Floats:
    """Points turned about x, then y, then z."""
    if turn_deg == (0.0, 0.0, 0.0):
        return points
    rotation = Pose.from_rpy((0.0, 0.0, 0.0), tuple(map(math.radians, turn_deg))).rotation
    turned: Floats = matmul(points.reshape(-1, 3), rotation.T).reshape(points.shape)
    return turned


class Scenery:
    """Items and lamps of a world under construction, beginning with those of its file."""

    def __init__(self, items: Iterable[Item], seed: int) -> None:
        """Begin with the items of a file."""
        self.items = list(items)
        self.lamps: list[RectangleLight] = []
        self.random = np.random.default_rng(seed)
        self._counts: Counter[str] = Counter()

    def place(
        self,
        class_name: str,
        thing: Thing,
        x: float,
        y: float,
        yaw_deg: float = 0.0,
        z: float = 0.0,
        *,
        casts_shadows: bool = True,
    ) -> None:
        """Add an object at a place in the world; z is its height above the floor."""
        self._counts[class_name] += 1
        name = f"{class_name.title().replace('_', '')}.{self._counts[class_name]}"
        pose = Pose.from_rpy((x, y, -z), (0.0, 0.0, math.radians(yaw_deg)))
        for number, (material, parts) in enumerate(thing.parts.items()):
            corners, uv, normals = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
            shape = Facets(corners * _FLIP, uv, normals * _FLIP)
            item = Item(f"{name}.{number}", shape, pose, material, casts_shadows)
            self.items.append(replace(item, object_name=name, class_name=class_name))

    def spread(self, class_name: str, make: Callable[..., Thing], table: str) -> None:
        """Place things by `x y yaw numbers; ...`; yaw in degrees or ~ for any, numbers for make."""
        for row in table.split(";"):
            x, y, yaw, *numbers = row.split()
            thing = make(*map(float, numbers))
            turn = float(self.random.uniform(0, 360)) if yaw == "~" else float(yaw)
            self.place(class_name, thing, float(x), float(y), turn)

    def dress(self, looks: dict[str, Material]) -> None:
        """Give items of the file another material, by name, without its number, or by class."""
        for index, item in enumerate(self.items):
            material = looks.get(item.name.rstrip("0123456789")) or looks.get(item.class_name)
            if material is not None:
                self.items[index] = replace(item, material=material)

    def remove(self, *classes: str) -> None:
        """Remove the file's items of some classes."""
        self.items = [item for item in self.items if item.class_name not in classes]

    def hang_lamp(
        self,
        x: float,
        y: float,
        height: float,
        size: tuple[float, float],
        brightness: float,
        drop: float = 0.0,
    ) -> None:
        """Luminous panel at a ceiling with its light; below it, a fifth of that goes up."""
        lamp = Thing()
        # No brighter than its light looks to a camera, which shows white.
        lamp.box(paint(255, 250, 238, emission=1.2), (0, 0, -drop), (*size, 0.012))
        lamp.box(paint(222, 222, 218), (0, 0, 0.02 - drop), (size[0] + 0.06, size[1] + 0.06, 0.03))
        for end in (-0.4, 0.4) if drop else ():
            lamp.rod(paint(70, 70, 74), (end * size[0], 0, -drop), 0.008, drop, sectors=6)
        self.place("lamp", lamp, x, y, 0.0, height, casts_shadows=False)
        for down, share in ((1.0, 1.0), (-1.0, 0.2))[: 2 if drop else 1]:
            red, green, blue = (share * brightness * part for part in (1.0, 0.95, 0.86))
            at = (x, y, drop - height + 0.04 * down)
            light = RectangleLight(at, (0.0, 0.0, down), size, (red, green, blue))
            self.lamps.append(light)
