"""Frames composed from the cameras of robots: multi-view, viewports, one camera, or a variant.

Robots and cameras are protocols, so that nothing here imports the simulation. Without a multi-view
the image port displays the first robot with a camera, in the viewports that the robot's client has
set. With one, each camera keeps a tile from the spawn of the robot to the removal: the first free
tile. `mounted_camera_state` is the one function that builds the state of a camera on a robot, for
frames, data sets and tools alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from catoptra_protocol.camera_conf import Pairs, omni_camera_from_pairs, pairs_from_omni_camera
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.frame import Carrier, FrameComposition, FrameMetadata, ViewRequest
from catoptra_server.frames.multi_view import (
    Tile,
    TileLayout,
    ViewportConfig,
    Viewports,
    viewport_layout,
)
from catoptra_server.frames.plan.camera import CameraSpec, CameraVariant, OmniCameraSpec
from catoptra_server.world.objects import ZERO_SEED, CameraState, DynamicObject, NoiseSeed
from catoptra_server.world.world_description import AT_REST, Twist


class CameraRobot(Protocol):
    """A robot that carries cameras."""

    name: str
    number: int
    """Number among all robots that were ever spawned, from 1."""
    tile_index: int
    """Tile of the first camera in a multi-view, -1 without one."""
    viewports: Viewports

    @property
    def class_name(self) -> str:
        """Class of the robot with its package, such as USARBot.OmniP2AT."""

    @property
    def world_from_robot(self) -> Pose:
        """Pose of the chassis frame."""

    @property
    def twist(self) -> Twist:
        """Motion in the last tick, referred to the chassis origin, in world axes."""

    @property
    def joint_angles_rad(self) -> Mapping[str, float]:
        """Angle of each joint by lower-case link name."""

    @property
    def all_cameras(self) -> Sequence[_RobotCamera]:
        """Cameras of the robot, the omnidirectional one first."""

    def find_camera(self, name: str) -> _RobotCamera | None:
        """Camera of a name in any case; the first camera for an empty name."""

    def noise_seed_for(self, camera: str) -> NoiseSeed:
        """Seed of the image noise of a camera in this tick."""


class _RobotCamera(Protocol):
    """A camera that a robot carries, of either kind."""

    name: str
    # Assigned by `ImagePortLayout`, reported by the camera in CONF.
    tile: Tile | None
    """Tile of the camera in a multi-view; None without one."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the camera's own image."""

    @property
    def min_frame_interval_s(self) -> float:
        """Shortest simulation time between two exposures; 0 sets no limit."""

    def robot_from_camera(self, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Pose of the effective viewpoint or pinhole, given joint angles by lower-case name."""

    def camera_spec(self, tile: Tile | None = None) -> CameraSpec:
        """Camera and render settings, fitted to a tile."""

    def camera_model(self, tile: Tile | None = None) -> Pairs:
        """Key-value pairs of the camera model at the size of a tile."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibleObjects:
    """Dynamic objects that the cameras of one robot can show."""

    objects: tuple[DynamicObject, ...]
    """Other robots."""
    ego_body: DynamicObject | None = None
    """The robot itself, where a camera's effects include the view of the robot's own body."""


# A function: a robot that no camera of a frame belongs to is not looked up.
_VisibleObjectsLookup = Callable[[CameraRobot], VisibleObjects]


def mounted_camera_state(
    world_from_robot: Pose,
    robot_from_camera: Pose,
    *,
    twist: Twist = AT_REST,
    objects: tuple[DynamicObject, ...] = (),
    ego_body: DynamicObject | None = None,
    noise_seed: NoiseSeed = ZERO_SEED,
) -> CameraState:
    """State of a camera for one exposure, given the state of the robot that carries the camera.

    Args:
        world_from_robot: Pose of the chassis.
        robot_from_camera: Pose of the viewpoint or pinhole on the robot.
        twist: Motion of the robot, referred to the chassis origin, in world axes.
        objects: Other dynamic objects in the scene; one whose box encloses the viewpoint is left
            out.
        ego_body: The robot itself, where the camera may show the robot's own body.
        noise_seed: Seed of the noise of this exposure.
    """
    world_from_camera = world_from_robot @ robot_from_camera
    # A turning chassis carries the camera around: v_camera = v_robot + omega x offset.
    offset_m = world_from_camera.translation - world_from_robot.translation
    camera_twist = twist if twist is AT_REST else twist.at_offset(offset_m)
    # From inside, a body would hide everything else, at up to 60 times the cost of the frame:
    # every ray meets it, and however slow, it passes by at any angular rate.
    visible = tuple(one for one in objects if not one.encloses(world_from_camera.translation))
    return CameraState(
        world_from_camera,
        visible,
        noise_seed=noise_seed,
        twist=camera_twist,
        ego_body=ego_body,
    )


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
        visible_objects_of: _VisibleObjectsLookup,
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
        self, robots: Iterable[CameraRobot], visible_objects_of: _VisibleObjectsLookup
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
    robot: CameraRobot, camera: _RobotCamera, visible_objects_of: _VisibleObjectsLookup
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
    if view is not None:
        view = replace(view, label_channels=variant.channels)
    metadata = composition.metadata
    if view is not None and variant.world_from_robot is not None:
        place, rows = variant.world_from_robot.position_m, variant.world_from_robot.rotation
        pose = Pose(np.array(rows).reshape(3, 3), np.array(place))
        view = _move_view(view, pose)
        metadata = replace(metadata, world_from_robot=pose)
    if variant != CameraVariant() and not variant.changes_settings:
        return replace(composition, views=(view,), metadata=metadata)
    if view is None or not isinstance(view.camera, OmniCameraSpec):
        raise DomainError("only omnidirectional cameras have variants of their settings")
    reference = variant.make_reference(view.camera)
    own = view.camera.camera
    shown = own if variant.picture is None else own.with_picture(variant.picture)
    if shown is not own and metadata.camera_model is not None:
        _, height_m = omni_camera_from_pairs(metadata.camera_model)
        metadata = replace(metadata, camera_model=pairs_from_omni_camera(shown, height_m))
    return replace(
        composition,
        views=(replace(view, camera=variant.apply_to(view.camera)),),
        reference=None if reference is None else replace(view, camera=reference, label_channels=()),
        metadata=metadata,
        is_turned=shown is not own,
    )


def _move_view(view: ViewRequest, world_from_robot: Pose) -> ViewRequest:
    """View of a camera with its robot at another pose, which no motion within a tick changes."""
    carrier, state = view.carrier, view.camera_state
    assert carrier is not None, "a camera with variants is on a robot"
    ego_body = state.ego_body and state.ego_body.with_pose(world_from_robot)
    pose = world_from_robot @ carrier.robot_from_camera
    return replace(
        view,
        camera_state=replace(state, world_from_mirror=pose, ego_body=ego_body),
        carrier=replace(carrier, world_from_robot=world_from_robot, twist=AT_REST),
    )


@dataclass(frozen=True, slots=True, eq=False)
class MountedCamera:
    """A camera and the robot that carries it."""

    robot: CameraRobot
    camera: _RobotCamera

    def request_view(
        self, tile: Tile | None, visible_objects_of: _VisibleObjectsLookup
    ) -> ViewRequest:
        """View of the camera now, at the size of a tile."""
        # Pose, twist and tick of one instant: the simulation thread moves nothing meanwhile.
        robot, visible = self.robot, visible_objects_of(self.robot)
        spec = self.camera.camera_spec(tile)
        robot_from_camera = self.camera.robot_from_camera(robot.joint_angles_rad)
        state = mounted_camera_state(
            robot.world_from_robot,
            robot_from_camera,
            twist=robot.twist,
            objects=visible.objects,
            # No effect of a camera without a mirror shows the robot itself.
            ego_body=visible.ego_body if isinstance(spec, OmniCameraSpec) else None,
            noise_seed=robot.noise_seed_for(self.camera.name),
        )
        carrier = Carrier(robot.world_from_robot, robot.twist, robot_from_camera)
        return ViewRequest(spec, state, carrier=carrier)


def _compose(
    layout: TileLayout,
    cameras: Sequence[MountedCamera | None],
    visible_objects_of: _VisibleObjectsLookup,
) -> FrameComposition:
    # All tiles of a layout have the size of the first, and a layout has at least one.
    tile = layout.first_tile
    views = tuple(
        mounted.request_view(tile, visible_objects_of) if mounted else None for mounted in cameras
    )
    # The fastest camera sets the pace of a frame of several.
    intervals = [mounted.camera.min_frame_interval_s for mounted in cameras if mounted]
    metadata = _frame_metadata(cameras, views, tile)
    return FrameComposition(layout, views, metadata, min(intervals, default=0.0))


def _frame_metadata(
    cameras: Sequence[MountedCamera | None], views: Sequence[ViewRequest | None], tile: Tile
) -> FrameMetadata:
    """Metadata of a frame: of its camera, else of its robot, else empty."""
    mounted_cameras = [mounted for mounted in cameras if mounted]
    robots = {mounted.robot for mounted in mounted_cameras}
    if len(robots) != 1:
        return FrameMetadata()
    robot = robots.pop()
    if len(cameras) > 1:  # four viewports: one robot, no camera model for the whole image
        return FrameMetadata(robot.name, robot.class_name, world_from_robot=robot.world_from_robot)
    camera = mounted_cameras[0].camera
    carrier = next(view.carrier for view in views if view)
    return FrameMetadata(
        robot.name,
        robot.class_name,
        camera.name,
        robot.world_from_robot,
        carrier.robot_from_camera if carrier else None,
        camera.camera_model(tile),
    )


def _single_tile_layout(size_px: tuple[int, int]) -> TileLayout:
    return TileLayout(1, 1, *size_px, *size_px)
