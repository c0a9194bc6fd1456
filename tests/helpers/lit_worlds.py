"""Worlds that lamps light: a tunnel whose shadows hardly show, and a hall brighter than white."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    World,
)

TUNNEL_CAMERA = Pose.from_rpy((0.3, 0.2, -0.6), (0.0, 0.0, 0.2))
CONCRETE = Material((0.35, 0.35, 0.33))


def _shell(length_m: float, width_m: float, height_m: float, walls: Material) -> list[Item]:
    """Floor, roof and four walls around the origin of the floor."""
    side, end = Box((length_m, 0.2, height_m)), Box((0.2, width_m, height_m))
    places = {
        "floor": (Rectangle((length_m, width_m)), (0.0, 0.0, 0.0)),
        "roof": (Box((length_m, width_m, 0.2)), (0.0, 0.0, -height_m - 0.1)),
        "left": (side, (0.0, -0.5 * width_m - 0.1, -0.5 * height_m)),
        "right": (side, (0.0, 0.5 * width_m + 0.1, -0.5 * height_m)),
        "begin": (end, (-0.5 * length_m - 0.1, 0.0, -0.5 * height_m)),
        "end": (end, (0.5 * length_m + 0.1, 0.0, -0.5 * height_m)),
    }
    return [
        Item(name, shape, Pose.from_rpy(at), CONCRETE if name in ("floor", "roof") else walls)
        for name, (shape, at) in places.items()
    ]


def make_tunnel(intensity: float = 0.012, *, texture: Path | None = None) -> World:
    """A tunnel of 40 m under eight dim lamps, with pipes, niches and crates along its walls."""
    items = _shell(40.0, 4.0, 3.0, Material((0.4, 0.38, 0.36), texture))
    for n in range(16):
        x, side = -18.75 + 2.5 * n, 1.7 if n % 2 else -1.7
        items += [
            Item(
                f"crate {n}",
                Box((0.5, 0.4, 0.6)),
                Pose.from_rpy((x, side, -0.3), (0, 0, 0.1 * n)),
                Material((0.5, 0.35, 0.2)),
            ),
            Item(
                f"rib {n}",
                Box((0.15, 0.1, 3.0)),
                Pose.from_rpy((x + 1.25, -side, -1.5)),
                Material((0.25, 0.25, 0.28)),
            ),
            Item(
                f"drum {n}",
                Cylinder(0.2, 0.8),
                Pose.from_rpy((x + 0.6, side, -0.4)),
                Material((0.15, 0.3, 0.5)),
            ),
        ]
    pipe = Box((40.0, 0.12, 0.12))
    items += [Item(f"pipe {s}", pipe, Pose.from_rpy((0, s * 1.6, -2.6)), CONCRETE) for s in (-1, 1)]
    lamps = (
        PointLight((-17.5 + 5.0 * n, 0.3, -2.8), (intensity, 0.9 * intensity, 0.8 * intensity))
        for n in range(8)
    )
    lights: tuple[Light, ...] = (HemisphereLight((0.5, 0.5, 0.5), (0.4, 0.4, 0.4)), *lamps)
    return World("tunnel", tuple(items), lights=lights, background=(0.0, 0.0, 0.0))


def make_hall(texture: Path | None = None) -> World:
    """A hall with surfaces of up to twice the radiance of white, under four lamps."""
    items = _shell(16.0, 10.0, 4.0, Material((0.9, 0.9, 0.9), texture))
    for n in range(12):
        x, y = -6.0 + 4.0 * (n % 4), -3.0 + 3.0 * (n // 4)
        items.append(
            Item(
                f"rack {n}",
                Box((0.6, 0.3, 1.6)),
                Pose.from_rpy((x, y, -0.8), (0, 0, 0.4 * n)),
                Material((0.05 + 0.07 * n, 0.4, 0.9 - 0.07 * n)),
            )
        )
    lamps = (PointLight((x, y, -3.7), (14.0, 14.0, 12.6)) for x in (-4.0, 4.0) for y in (-2.5, 2.5))
    lights: tuple[Light, ...] = (HemisphereLight((0.9, 0.9, 0.9), (0.7, 0.7, 0.7)), *lamps)
    return World("hall", tuple(items), lights=lights, background=(0.0, 0.0, 0.0))
