"""Worlds of printed boards around a camera, and their corners in rendered pictures.

A board's frame: x right and y down on the print, z away from who reads it; metres. Boards are
mosaics of flat cells, so that their edges are as sharp as the renderer's samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import Image, PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, Rectangle, World

Cells = npt.NDArray[np.bool_]

_INK = Material((0.02, 0.02, 0.02), unlit=True)
_PAPER = Material((0.9, 0.9, 0.9), unlit=True)
_WALL = (0.25, 0.25, 0.25)


def chessboard_cells(columns: int, rows: int) -> Cells:
    """(rows + 1, columns + 1) cells of a chessboard with inner corners, True for ink, in a margin
    of one cell."""
    row, column = np.indices((rows + 1, columns + 1))
    return np.pad((row + column) % 2 == 0, 1)


def place_board(
    incidence_deg: float,
    azimuth_deg: float,
    distance_m: float,
    *,
    tilt_rpy: Sequence[float] = (0.0, 0.0, 0.0),
) -> Pose:
    """Pose in the mirror frame of a board that faces the viewpoint, upright, then turned."""
    theta, azimuth = math.radians(incidence_deg), math.radians(azimuth_deg)
    away = np.array(
        (math.sin(theta) * math.cos(azimuth), math.sin(theta) * math.sin(azimuth), math.cos(theta))
    )
    # y down: the mirror's axis points down on a robot.
    right = np.cross((0.0, 0.0, 1.0), away)
    right /= np.linalg.norm(right)
    facing = Pose(np.stack((right, np.cross(away, right), away), axis=-1), distance_m * away)
    return facing @ Pose.from_rpy((0.0, 0.0, 0.0), (tilt_rpy[0], tilt_rpy[1], tilt_rpy[2]))


def board_items(name: str, cells: Cells, cell_m: float, pose: Pose) -> list[Item]:
    """A rectangle for each cell; the board's origin is the outer corner of its first cell."""
    items = []
    for row, column in np.ndindex(cells.shape):
        centre = Pose(np.eye(3), np.array(((column + 0.5) * cell_m, (row + 0.5) * cell_m, 0.0)))
        material = _INK if cells[row, column] else _PAPER
        items.append(
            Item(f"{name} {row} {column}", Rectangle((cell_m, cell_m)), pose @ centre, material)
        )
    return items


def centre_board(pose: Pose, cells: Cells, cell_m: float) -> Pose:
    """Pose of a board's origin whose middle is to be at a pose."""
    rows, columns = cells.shape
    half = np.array((0.5 * columns * cell_m, 0.5 * rows * cell_m, 0.0))
    return pose @ Pose(np.eye(3), -half)


def render_boards(camera: OmniCamera, items: Sequence[Item], *, samples: int = 8) -> Image:
    """RGB picture of a world of boards, from the origin."""
    world = World("boards", tuple(items), background=_WALL)
    renderer = TraceRenderer(build_scene(world), world, threads=2)
    settings = RenderSettings(PerPixel(), samples=samples)
    plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="test")
    view = renderer.prepare(camera, plan)
    image = view.render(CameraState(Pose.identity())).rgb
    view.close()
    renderer.close()
    return image
