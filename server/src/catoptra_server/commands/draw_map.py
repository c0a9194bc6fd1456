"""`catoptra-server map WORLD --out PLAN.png`: a world from above, as a robot meets it.

The plan of `simulation/floor_plan.py` with marks. x runs to the right, y down, as seen from above.
Drawn at twice the size, so that edges are smooth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catoptra_protocol.command_line import CommandParser, int_within
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.elementary import cos, sin
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.simulation.floor_plan import (
    FREE,
    OBSTACLE,
    PAPER,
    FloorPlan,
    draw_floor_plan,
    measure_robot,
)
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World, srgb_from_linear

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

_Rgb = tuple[int, int, int]
_Point = tuple[float, float]
# Of the finished picture; all lengths below, too.
_SIZE_PX, _TEXT_PX, _FOOT_PX = 1000, 15, 92
_SCALE = 2
_INK: _Rgb = (40, 44, 52)
_START: _Rgb = (204, 72, 16)


def main(arguments: Sequence[str]) -> int:
    """Draw the plan."""
    parser = CommandParser(
        "catoptra-server map",
        "Draw a world from above: starts, landmarks, obstacles at the robot's height, "
        "free floor, axes and a scale.",
    )
    parser.add_argument("world", metavar="WORLD", type=partial(find_configuration, "worlds"),
        help="world file, mesh file, or the name of a bundled world")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="PLAN.png",
        help="picture to write, in the format of its suffix")  # fmt: skip
    parser.add_argument("--robot", default="p2at_omni", metavar="FILE",
        type=partial(find_configuration, "robots"),
        help="robot file, or the name of a bundled one, whose heights and base count "
        "(default: p2at_omni)")  # fmt: skip
    parser.add_argument("--size", type=int_within("a size", 200, 4000), default=_SIZE_PX,
        metavar="PX", help="longer side of the plan")  # fmt: skip
    parsed = parser.parse_args(arguments)
    robot, _ = read_robot(parsed.robot)
    world, _ = read_world(parsed.world)
    try:
        _draw_map(world, build_scene(world), robot, parsed.out, size_px=parsed.size)
    except ValueError as error:  # Pillow knows no format of the name.
        raise CatoptraError(str(error)) from error
    print(parsed.out)
    return 0


def _draw_map(
    world: World, scene: SceneMesh, robot: RobotDescription, path: Path, *, size_px: int
) -> None:
    from PIL import Image, ImageDraw

    marks = [start.location_m[:2] for start in world.starts]
    marks += [(landmark.x_m, landmark.y_m) for landmark in world.landmarks]
    height_m, radius_m = measure_robot(robot)
    plan = draw_floor_plan(
        scene,
        height_m=height_m,
        points_m=np.array(marks or [(0.0, 0.0)]),
        size_px=_SCALE * size_px,
        radius_m=radius_m,
    )
    pixels = plan.colour(scene, radius_m)
    height, width = pixels.shape[:2]
    size = max(width, _SCALE * 420), height + _SCALE * _FOOT_PX
    image = Image.new("RGB", size, PAPER)
    image.paste(Image.fromarray(pixels), (0, 0))
    sheet = _Sheet(ImageDraw.Draw(image), plan, (size[0], height))
    sheet.draw_axes()
    for landmark in world.landmarks:
        sheet.draw_landmark(landmark, world)
    for start in world.starts:
        sheet.draw_start(start.name, start.location_m[:2], start.rotation_rad[2])
    sheet.draw_names()
    sheet.draw_foot(
        f"{world.name}: free for {robot.class_name} to turn, {2 * radius_m:.2f} m wide and "
        f"{height_m:.2f} m high"
    )
    image.reduce(_SCALE).save(path)


class _Sheet:
    """Marks on a plan."""

    def __init__(self, draw: ImageDraw, plan: FloorPlan, size_px: tuple[int, int]) -> None:
        from PIL import ImageFont

        self._draw = draw
        self._plan = plan
        self._size = size_px
        self._font = ImageFont.load_default(_SCALE * _TEXT_PX)
        self._names: list[tuple[str, _Point, _Rgb]] = []
        # Boxes that names stay clear of: left, top, right, bottom.
        self._boxes: list[tuple[float, float, float, float]] = []

    def _place(self, point_m: _Point) -> _Point:
        x, y = self._plan.pixels(np.array([point_m]))[0].tolist()
        return x, y

    def _add_name(self, name: str, at: _Point, colour: _Rgb) -> None:
        self._names.append((name, at, colour))
        x, y = at
        reach = 10.0 * _SCALE
        self._boxes.append((x - reach, y - reach, x + reach, y + reach))

    def draw_axes(self) -> None:
        """Draw the world's axes at its origin, or in a corner where that is outside."""
        x, y = self._place((0.0, 0.0))
        width, height = self._size
        is_inside = 0 < x < width and 0 < y < height
        x, y = (x, y) if is_inside else (24.0 * _SCALE, 24.0 * _SCALE)
        length = 56.0 * _SCALE
        for name, (across, down) in (("x", (1.0, 0.0)), ("y", (0.0, 1.0))):
            tip = x + across * length, y + down * length
            self._draw.line((x, y, *tip), fill=_INK, width=2 * _SCALE)
            self._boxes.append((x, y, tip[0] + _SCALE, tip[1] + _SCALE))
            self._draw.polygon(_arrow(tip, (across, down), 7.0 * _SCALE), fill=_INK)
            self._add_name(name, tip, _INK)

    def draw_landmark(self, landmark: Landmark, world: World) -> None:
        """Draw a dot in the two colours of a landmark, as wide as that or wide enough to see."""
        x, y = self._place((landmark.x_m, landmark.y_m))
        radius = max(0.5 * landmark.width_m * self._plan.px_per_m, 7.0 * _SCALE)
        if landmark.kind != "beacon":
            radius = 7.0 * _SCALE
        colours = [
            tuple(round(255.0 * value) for value in srgb_from_linear(np.array(albedo)).tolist())
            for albedo in (
                world.landmark_albedos[landmark.lower_colour],
                world.landmark_albedos[landmark.upper_colour],
            )
        ]
        box = x - radius, y - radius, x + radius, y + radius
        self._draw.pieslice(box, 90, 270, fill=colours[0])
        self._draw.pieslice(box, 270, 90, fill=colours[1])
        self._draw.ellipse(box, outline=_INK, width=_SCALE)
        self._add_name(landmark.name, (x, y), _INK)

    def draw_start(self, name: str, place_m: _Point, yaw_rad: float) -> None:
        """Draw an arrow along the heading of a start."""
        x, y = self._place(place_m)
        ahead = cos(yaw_rad), sin(yaw_rad)
        tip = x + 13.0 * _SCALE * ahead[0], y + 13.0 * _SCALE * ahead[1]
        points = _arrow(tip, ahead, 24.0 * _SCALE)
        self._draw.polygon(points, fill=_START, outline=PAPER, width=_SCALE)
        self._add_name(name, (x, y), _START)

    def draw_names(self) -> None:
        """Draw the names beside their marks, where they cover nothing if there is such a place."""
        for name, (x, y), colour in self._names:
            left, top, right, bottom = self._draw.textbbox((0, 0), name, font=self._font)
            width, height = right - left, bottom - top
            places = [*_name_places(x, y, width, height)]
            free = (box for box in places if self._is_clear(box))
            box = next(free, places[0])
            self._boxes.append(box)
            self._draw.text((box[0] - left, box[1] - top), name, font=self._font, fill=colour,
                stroke_width=2 * _SCALE, stroke_fill=PAPER)  # fmt: skip

    def _is_clear(self, box: tuple[float, float, float, float]) -> bool:
        left, top, right, bottom = box
        width, height = self._size
        is_inside = left > 0 and top > 0 and right < width and bottom < height
        return is_inside and not any(
            left < other[2] and right > other[0] and top < other[3] and bottom > other[1]
            for other in self._boxes
        )

    def draw_foot(self, text: str) -> None:
        """Draw the scale bar and the meaning of the colours below the plan."""
        left, line = 16.0 * _SCALE, 22.0 * _SCALE
        y = self._size[1] + 18.0 * _SCALE
        metres = _round_length(0.25 * self._size[0] / self._plan.px_per_m)
        right = left + metres * self._plan.px_per_m
        self._draw.line((left, y, right, y), fill=_INK, width=3 * _SCALE)
        for x in (left, right):
            self._draw.line((x, y - 5 * _SCALE, x, y + 5 * _SCALE), fill=_INK, width=2 * _SCALE)
        self._write(f"{metres:g} m", right + 10 * _SCALE, y)
        self._write(text, left, y + line)
        x, y = left, y + 2 * line
        for colour, name in ((FREE, "free"), (OBSTACLE, "obstacle"), (_START, "start")):
            side = 6 * _SCALE
            self._draw.rectangle((x, y - side, x + 2 * side, y + side), fill=colour)
            self._write(name, x + 3 * side, y)
            x += 4 * side + self._draw.textlength(name, font=self._font) + 12 * _SCALE

    def _write(self, text: str, x: float, y: float) -> None:
        self._draw.text((x, y), text, font=self._font, fill=_INK, anchor="lm")


def _arrow(tip: _Point, ahead: _Point, length: float) -> list[_Point]:
    """Corners of an arrow head with a notch."""
    (x, y), (along, across) = tip, ahead
    return [
        (x - length * (back * along + side * across), y - length * (back * across - side * along))
        for back, side in ((0.0, 0.0), (1.0, 0.4), (0.75, 0.0), (1.0, -0.4))
    ]


def _name_places(
    x: float, y: float, width: float, height: float
) -> Iterator[tuple[float, float, float, float]]:
    """Yield boxes of a name around a mark: right, left, above, below, and farther off."""
    for gap in (13.0 * _SCALE, 26.0 * _SCALE):
        for left, top in (
            (x + gap, y - 0.5 * height),
            (x - gap - width, y - 0.5 * height),
            (x - 0.5 * width, y - gap - height),
            (x - 0.5 * width, y + gap),
            (x + gap, y - gap - height),
            (x + gap, y + gap),
        ):
            yield left, top, left + width, top + height


def _round_length(length_m: float) -> float:
    """Largest length of 1, 2 or 5 times a power of ten up to a length."""
    power = 10.0 ** math.floor(math.log10(length_m))
    return next(factor * power for factor in (5.0, 2.0, 1.0) if factor * power <= length_m)
