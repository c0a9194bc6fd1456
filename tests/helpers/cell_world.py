"""A world of walled cells, each with room for one robot's drives, and a robot with all sensors.

Robots of several clients neither see nor touch each other, so that their drives can run at once.
"""

from __future__ import annotations

import re
from pathlib import Path

from helpers.configs import ROBOTS

_NUM_CELLS = 12
_COLUMNS = 4
# A robot of half a metre drives 0.3 m ahead and turns: the walls stay a metre away.
_LENGTH_M, _WIDTH_M = 5.0, 4.0
_WALL_M = 0.1
# Half of the usual interval: a drive of tenths of seconds has enough reports.
_INTERVAL_S = 0.1
CELL_POSES = tuple(f"{{Start Cell{cell}}}" for cell in range(_NUM_CELLS))
"""Blocks of INIT with a pose in each cell."""


def write_cell_world(folder: Path) -> Path:
    """Write the world, and return the path of its file."""
    # Light for the cameras: pictures of a dark world are black.
    light = "Lights=(Type=Hemisphere,Up=(R=200,G=200,B=200),Down=(R=150,G=150,B=150))"
    lines = ["[Catoptra.World]", "Name=Cells", light]
    lines += [line for cell in range(_NUM_CELLS) for line in _cell_lines(cell)]
    path = folder / "cells.ini"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_sensor_robot(folder: Path, robot: str = "p2at_omni_full") -> Path:
    """Write a bundled robot with shorter report intervals and a small camera; return its path."""
    for name in ("p2at_omni.ini", "p2dx.ini", f"{robot}.ini"):
        text = (ROBOTS / name).read_text(encoding="utf-8")
        text = re.sub(r"(?m)^(ScanInterval|msgTimer)=[\d.]+", rf"\1={_INTERVAL_S}", text)
        text = re.sub(r"(?m)^(Resolution[XY])=360", r"\1=64", text)
        (folder / name).write_text(text, encoding="utf-8")
    return folder / f"{robot}.ini"


def _centre(cell: int) -> tuple[float, float]:
    return _LENGTH_M * (cell % _COLUMNS), _WIDTH_M * (cell // _COLUMNS)


def _cell_lines(cell: int) -> list[str]:
    """Floor, start pose, four walls, and two boxes that make the directions look different."""
    x, y = _centre(cell)
    walls = [
        _box(x + sign * _LENGTH_M / 2, y, _WALL_M, _WIDTH_M, cell, f"X{sign}") for sign in (-1, 1)
    ] + [_box(x, y + sign * _WIDTH_M / 2, _LENGTH_M, _WALL_M, cell, f"Y{sign}") for sign in (-1, 1)]
    obstacles = [
        _box(x + 1.2, y + 1.4, 0.6, 0.3, cell, "Right"),
        _box(x - 0.3, y - 1.6, 0.3, 0.5, cell, "Left"),
    ]
    floor = (
        f'Rectangles=(Name="Floor{cell}",Position=(X={x},Y={y},Z=0),'
        f"Size=(X={_LENGTH_M},Y={_WIDTH_M}),Colour=(R=120,G=120,B=120))"
    )
    start = f'PlayerStarts=(Tag="Cell{cell}",Location=(X={x - 0.5},Y={y},Z=0))'
    return [floor, start, *walls, *obstacles]


def _box(x: float, y: float, length: float, width: float, cell: int, name: str) -> str:
    return (
        f'Boxes=(Name="{name}{cell}",Position=(X={x},Y={y},Z=-0.5),'
        f"Size=(X={length},Y={width},Z=1),Colour=(R=200,G=200,B=200))"
    )
