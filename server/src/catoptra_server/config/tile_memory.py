"""Memory of cameras that the image port renders at another size than their own.

A tile or viewport has the size of the layout, whatever the camera's: a camera of 100 px with 16 x
16 samples would take gigabytes in a tile of 2000 px. Clients switch viewports at any time, so all
cameras are checked at start.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from catoptra_protocol.errors import SourceLocation
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.frames.multi_view import (
    Tile,
    TileLayout,
    ViewportConfig,
    fit_omni_camera,
    viewport_layout,
)
from catoptra_server.frames.plan.plans import omni_view_size, perspective_view_size
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MemoryBudget, ViewSize
from catoptra_server.simulation.robot_description import RobotDescription


def require_tiles_fit(
    robots: Sequence[RobotDescription],
    layout: TileLayout | None,
    *,
    limit_bytes: int = DEFAULT_LIMIT_BYTES,
) -> None:
    """Check that each camera fits into memory at the sizes of tile and viewport.

    Args:
        robots: all robots.
        layout: tiles of the image port; None for viewports, a quarter of the largest camera each.
        limit_bytes: memory that a view may take.

    Raises:
        ConfigError: for the first camera that does not fit.
    """
    for robot in robots:
        tile = layout.first_tile if layout else _viewport_tile(robot)
        for name, size in _view_sizes(robot, tile):
            MemoryBudget(limit_bytes).reserve(
                size.num_bytes,
                where=SourceLocation(robot.class_name),
                key=name,
                value=f"a tile of {tile.width_px} x {tile.height_px} px",
                remedy="smaller tiles, or fewer Samples or texels of the camera",
            )


def _viewport_tile(robot: RobotDescription) -> Tile:
    """Largest viewport of a robot's quad view."""
    sizes = [(camera.width_px, camera.height_px) for camera in robot.perspective_cameras]
    sizes.extend((omni.camera.width_px, omni.camera.height_px) for omni in robot.omni_cameras)
    # A camera of one pixel has no viewport; a tile has at least one pixel.
    width = max((width for width, _ in sizes), default=2)
    height = max((height for _, height in sizes), default=2)
    quad = ViewportConfig.QUAD_VIEW
    return viewport_layout(quad, width_px=max(width, 2), height_px=max(height, 2)).first_tile


def _view_sizes(robot: RobotDescription, tile: Tile) -> Iterable[tuple[str, ViewSize]]:
    """Yield name and size in memory of each camera of a robot in a tile."""
    for omni in robot.omni_cameras:
        camera = fit_omni_camera(tile, omni.camera)
        has_effects = bool(omni.effects.settings)
        yield omni.name, omni_view_size(camera, omni.render_settings, has_effects=has_effects)
    for perspective in robot.perspective_cameras:
        yield (
            perspective.name,
            perspective_view_size(
                PerspectiveCamera(tile.width_px, tile.height_px, perspective.fov_rad),
                has_effects=bool(perspective.effects.settings),
            ),
        )
