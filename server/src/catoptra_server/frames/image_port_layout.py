"""What the image port shows of which robots: the tiles of a multi-view, or one robot's viewports.

Without a multi-view it is the robot with a camera that is there longest, as it set its viewports.
With one, each camera has a tile from its robot's coming to its leaving: the first that is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from catoptra_server.frames.frame_request import (
    FrameComposition,
    FrameMetadata,
    OmniCameraSpec,
    ViewRequest,
)
from catoptra_server.frames.multi_view import Tile, TileLayout, ViewportConfig, viewport_layout
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.sensors.camera import RobotCamera
from catoptra_server.simulation.robot import Robot


@dataclass(frozen=True, slots=True, eq=False)
class VisibleObjects:
    """What a robot's cameras see beside the scene: others, and its own body where that is asked."""

    objects: tuple[DynamicObject, ...]
    ego_body: DynamicObject | None = None


VisibleObjectsLookup = Callable[[Robot], VisibleObjects]


@dataclass(frozen=True, slots=True, eq=False)
class _MountedCamera:
    """A camera and the robot that carries it."""

    robot: Robot
    camera: RobotCamera


class ImagePortLayout:
    """The screen of one server. blank_size_px: width and height while there is nothing to show."""

    def __init__(self, multi_view: TileLayout | None, *, blank_size_px: tuple[int, int]) -> None:
        self._layout = multi_view
        self._tiles = multi_view.tiles if multi_view else ()
        self._blank_size_px = blank_size_px
        self._tile_cameras: list[_MountedCamera | None] = [None] * len(self._tiles)

    def assign_tiles(self, robot: Robot) -> None:
        """Give each camera of a new robot a tile, as long as there are free ones."""
        for camera in robot.all_cameras:
            if None not in self._tile_cameras:
                return
            index = self._tile_cameras.index(None)
            self._tile_cameras[index] = _MountedCamera(robot, camera)
            camera.tile = self._tiles[index]
            robot.tile_index = index if robot.tile_index < 0 else robot.tile_index

    def release(self, robot: Robot) -> None:
        """Free the tiles of a robot that leaves."""
        self._tile_cameras = [m if m and m.robot is not robot else None for m in self._tile_cameras]

    def compose_frame(
        self,
        robots: Sequence[Robot],
        visible_objects_of: VisibleObjectsLookup,
        *,
        tile: int | None = None,
    ) -> FrameComposition:
        """Return what is shown now: all of the screen, or one tile of a multi-view."""
        if self._layout is None:
            return self._compose_viewports(robots, visible_objects_of)
        if tile is None:
            return _compose(self._layout, self._tile_cameras, visible_objects_of)
        mounted = self._tile_cameras[tile] if tile < len(self._tile_cameras) else None
        return _compose(_single_tile_layout(self._tiles[0]), [mounted], visible_objects_of)

    def _compose_viewports(
        self, robots: Sequence[Robot], visible_objects_of: VisibleObjectsLookup
    ) -> FrameComposition:
        """Return the viewports of the robot that is there longest; black without one."""
        robot = find_displayed_robot(robots)
        if robot is None:
            layout = viewport_layout(
                ViewportConfig.SINGLE_VIEW, **_layout_size(self._blank_size_px)
            )
            return _compose(layout, [None], visible_objects_of)
        shown = [robot.find_camera(name) for name in robot.viewports.camera_names]
        first = shown[0] or robot.all_cameras[0]
        single = robot.viewports.config is ViewportConfig.SINGLE_VIEW
        whole = first if single else robot.all_cameras[0]
        layout = viewport_layout(robot.viewports.config, **_layout_size(whole.size_px))
        mounted = [_MountedCamera(robot, c) if c else None for c in shown[: len(layout)]]
        return _compose(layout, mounted, visible_objects_of)


def find_displayed_robot(robots: Sequence[Robot]) -> Robot | None:
    """Return the robot that is watched: the one with a camera that is there longest."""
    return next((robot for robot in robots if robot.all_cameras), None)


def compose_camera_frame(
    robot: Robot, camera: RobotCamera, visible_objects_of: VisibleObjectsLookup
) -> FrameComposition:
    """Return one camera's own picture at its own size."""
    layout = viewport_layout(ViewportConfig.SINGLE_VIEW, **_layout_size(camera.size_px))
    return _compose(layout, [_MountedCamera(robot, camera)], visible_objects_of)


def _compose(
    layout: TileLayout,
    cameras: Sequence[_MountedCamera | None],
    visible_objects_of: VisibleObjectsLookup,
) -> FrameComposition:
    place = layout.tiles[0]
    takes = tuple(_view_request(m, place, visible_objects_of) if m else None for m in cameras)
    intervals = [mounted.camera.min_frame_interval_s for mounted in cameras if mounted]
    return FrameComposition(
        layout, takes, _frame_metadata(cameras, place), min(intervals, default=0.0)
    )


def _view_request(
    mounted: _MountedCamera, tile: Tile, visible_objects_of: VisibleObjectsLookup
) -> ViewRequest:
    robot = mounted.robot
    around = visible_objects_of(robot)
    camera = mounted.camera
    robot_pose = robot.world_from_robot
    take = camera.view_request(
        robot_pose, around.objects, joint_angles_rad=robot.joint_angles_rad, tile=tile
    )
    way = take.camera_state.world_from_mirror.translation - robot_pose.translation
    exposure = replace(
        take.camera_state,
        noise_seed=robot.noise_seed_for(camera.name),
        twist=robot.twist.at_offset(way),
        ego_body=around.ego_body if isinstance(take.camera, OmniCameraSpec) else None,
    )
    return replace(take, camera_state=exposure)


def _frame_metadata(cameras: Sequence[_MountedCamera | None], tile: Tile) -> FrameMetadata:
    """Return whose picture it is: a camera's, one robot's, or nobody's in particular."""
    present = [mounted for mounted in cameras if mounted]
    robots = {mounted.robot for mounted in present}
    if len(robots) != 1:
        return FrameMetadata()
    robot = robots.pop()
    whose = (robot.name, robot.description.class_name)
    if len(cameras) > 1:
        return FrameMetadata(*whose, world_from_robot=robot.world_from_robot)
    camera = present[0].camera
    mount = camera.robot_from_camera(robot.joint_angles_rad)
    return FrameMetadata(
        *whose, camera.name, robot.world_from_robot, mount, camera.camera_model(tile)
    )


def _single_tile_layout(tile: Tile) -> TileLayout:
    """Return the layout of one tile on its own."""
    size = (tile.width_px, tile.height_px)
    return TileLayout(1, 1, *size, *size)


def _layout_size(size_px: tuple[int, int]) -> dict[str, int]:
    return {"width_px": size_px[0], "height_px": size_px[1]}
