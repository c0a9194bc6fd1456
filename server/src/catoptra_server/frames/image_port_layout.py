"""Cameras that the image port shows: the tiles of a multi-view, or the viewports of one robot.

Without a multi-view the image port displays the first robot with a camera, in the viewports that
the robot's client has set. With one, each camera keeps a tile from the spawn of the robot to the
removal: the first free tile.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

from catoptra_protocol.camera_conf import omni_camera_from_pairs, pairs_from_omni_camera
from catoptra_protocol.errors import DomainError
from catoptra_server.frames.frame_request import FrameComposition, FrameMetadata
from catoptra_server.frames.mounted_camera import MountedCamera
from catoptra_server.frames.multi_view import Tile, TileLayout, ViewportConfig, viewport_layout
from catoptra_server.frames.robot_camera import CameraRobot, RobotCamera, VisibleObjectsLookup
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.camera_variant import CameraVariant


class ImagePortLayout:
    """Assignment of cameras to the tiles of the image port."""

    def __init__(self, multi_view: TileLayout | None, *, blank_size_px: tuple[int, int]) -> None:
        """Start without cameras.

        Args:
            multi_view: Tiles of the image; None for the viewports of one robot.
            blank_size_px: Width and height of the black image while no robot has a camera.
        """
        self._layout = multi_view
        self._tiles = multi_view.tiles if multi_view else ()
        self._blank_size_px = blank_size_px
        self._tile_cameras: list[MountedCamera | None] = [None] * len(self._tiles)

    def assign_tiles(self, robot: CameraRobot) -> None:
        """Assign a free tile to each camera of a new robot, as long as tiles are free."""
        for camera in robot.all_cameras:
            if None not in self._tile_cameras:
                return
            index = self._tile_cameras.index(None)
            self._tile_cameras[index] = MountedCamera(robot, camera)
            camera.tile = self._tiles[index]
            # STA reports one tile for a robot: the tile of the first camera.
            robot.tile_index = index if robot.tile_index < 0 else robot.tile_index

    def release(self, robot: CameraRobot) -> None:
        """Free the tiles of a robot that is removed."""
        self._tile_cameras = [m if m and m.robot is not robot else None for m in self._tile_cameras]

    def compose_frame(
        self,
        robots: Iterable[CameraRobot],
        visible_objects_of: VisibleObjectsLookup,
        *,
        tile: int | None = None,
    ) -> FrameComposition:
        """Compose the whole image, or one tile of a multi-view.

        Args:
            robots: All robots, the one that was spawned first in front.
            visible_objects_of: Objects that a robot's cameras can show: other robots, ego body.
            tile: Index of the tile; ignored without a multi-view, which has no tiles.
        """
        if self._layout is None:
            return self._compose_viewports(robots, visible_objects_of)
        if tile is None:
            return _compose(self._layout, self._tile_cameras, visible_objects_of)
        mounted = self._tile_cameras[tile] if tile < len(self._tile_cameras) else None
        layout = _single_tile_layout((self._tiles[0].width_px, self._tiles[0].height_px))
        return _compose(layout, [mounted], visible_objects_of)

    def _compose_viewports(
        self, robots: Iterable[CameraRobot], visible_objects_of: VisibleObjectsLookup
    ) -> FrameComposition:
        """Compose the viewports of the displayed robot; black without a robot."""
        robot = find_displayed_robot(robots)
        if robot is None:
            return _compose(_single_tile_layout(self._blank_size_px), [None], visible_objects_of)
        config, names = robot.viewports.config, robot.viewports.camera_names
        # The image has the size of the camera that fills a single view. Four viewports share the
        # size of the first camera, so that switching one of them off does not resize the image.
        single = robot.find_camera(names[0]) if config is ViewportConfig.SINGLE_VIEW else None
        width_px, height_px = (single or robot.all_cameras[0]).size_px
        layout = viewport_layout(config, width_px=width_px, height_px=height_px)
        cameras = [single] if single else [robot.find_camera(name) for name in names[: len(layout)]]
        mounted = [MountedCamera(robot, camera) if camera else None for camera in cameras]
        return _compose(layout, mounted, visible_objects_of)


_RobotT = TypeVar("_RobotT", bound=CameraRobot)


def find_displayed_robot(robots: Iterable[_RobotT]) -> _RobotT | None:
    """Robot that the image port displays: the first one with a camera."""
    return next((robot for robot in robots if robot.all_cameras), None)


def compose_camera_frame(
    robot: CameraRobot, camera: RobotCamera, visible_objects_of: VisibleObjectsLookup
) -> FrameComposition:
    """Compose the image of one camera at the camera's own size."""
    layout = _single_tile_layout(camera.size_px)
    return _compose(layout, [MountedCamera(robot, camera)], visible_objects_of)


def compose_variant(composition: FrameComposition, variant: CameraVariant) -> FrameComposition:
    """Composition of one camera by other settings, with the reference that these ask for.

    Raises:
        DomainError: The camera is no omnidirectional one, or has no effect of a name.
    """
    (view,) = composition.views
    composition = replace(composition, channels=variant.channels)
    if variant.channels and not variant.changes_picture:
        return composition
    if view is None or not isinstance(view.camera, OmniCameraSpec):
        raise DomainError("only omnidirectional cameras have variants")
    reference = variant.make_reference(view.camera)
    own = view.camera.camera
    shown = own if variant.picture is None else own.with_picture(variant.picture)
    metadata = composition.metadata
    if shown is not own and metadata.camera_model is not None:
        _, height_m = omni_camera_from_pairs(metadata.camera_model)
        metadata = replace(metadata, camera_model=pairs_from_omni_camera(shown, height_m))
    return replace(
        composition,
        views=(replace(view, camera=variant.apply_to(view.camera)),),
        reference=None if reference is None else replace(view, camera=reference),
        metadata=metadata,
        is_turned=shown is not own,
    )


def _compose(
    layout: TileLayout,
    cameras: Sequence[MountedCamera | None],
    visible_objects_of: VisibleObjectsLookup,
) -> FrameComposition:
    # All tiles of a layout have the size of the first, and a layout has at least one.
    tile = layout.first_tile
    views = tuple(
        mounted.request_view(tile, visible_objects_of) if mounted else None for mounted in cameras
    )
    # The fastest camera sets the pace of a frame of several.
    intervals = [mounted.camera.min_frame_interval_s for mounted in cameras if mounted]
    metadata = _frame_metadata(cameras, tile)
    return FrameComposition(layout, views, metadata, min(intervals, default=0.0))


def _frame_metadata(cameras: Sequence[MountedCamera | None], tile: Tile) -> FrameMetadata:
    """Metadata of a frame: of its camera, else of its robot, else empty."""
    mounted_cameras = [mounted for mounted in cameras if mounted]
    robots = {mounted.robot for mounted in mounted_cameras}
    if len(robots) != 1:
        return FrameMetadata()
    robot = robots.pop()
    if len(cameras) > 1:  # four viewports: one robot, no camera model for the whole image
        return FrameMetadata(robot.name, robot.class_name, world_from_robot=robot.world_from_robot)
    camera = mounted_cameras[0].camera
    return FrameMetadata(
        robot.name,
        robot.class_name,
        camera.name,
        robot.world_from_robot,
        camera.robot_from_camera(robot.joint_angles_rad),
        camera.camera_model(tile),
    )


def _single_tile_layout(size_px: tuple[int, int]) -> TileLayout:
    return TileLayout(1, 1, *size_px, *size_px)
