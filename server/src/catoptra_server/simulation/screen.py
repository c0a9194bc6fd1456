"""What the image port shows of which robots: the tiles of a multi-view, or one robot's viewports.

Without a multi-view it is the robot with a camera that is there longest, as it set its viewports.
With one, each camera has a tile from its robot's coming to its leaving: the first that is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from catoptra_server.imaging.multi_view import Tile, TileLayout, ViewportConfig, viewports
from catoptra_server.imaging.shot import Caption, OmniEye, Scenery, Take
from catoptra_server.scene.bodies import Body
from catoptra_server.sensors.camera import Camera
from catoptra_server.simulation.spawned_robot import SpawnedRobot


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What a robot's cameras see beside the scene: others, and its own body where that is asked."""

    bodies: tuple[Body, ...]
    own_body: Body | None = None


AroundOf = Callable[[SpawnedRobot], Around]


@dataclass(frozen=True, slots=True, eq=False)
class _Mounted:
    """A camera and the robot that carries it."""

    robot: SpawnedRobot
    camera: Camera


class Screen:
    """The screen of one server. black_px: width and height while there is nothing to show."""

    def __init__(self, multi_view: TileLayout | None, *, black_px: tuple[int, int]) -> None:
        self._layout = multi_view
        self._tiles = multi_view.tiles if multi_view else ()
        self._black_px = black_px
        self._shown: list[_Mounted | None] = [None] * len(self._tiles)

    def welcome(self, robot: SpawnedRobot) -> None:
        """Give each camera of a new robot a tile, as long as there are free ones."""
        for camera in robot.all_cameras:
            if None not in self._shown:
                return
            index = self._shown.index(None)
            self._shown[index] = _Mounted(robot, camera)
            camera.tile = self._tiles[index]
            robot.view = index if robot.view < 0 else robot.view

    def forget(self, robot: SpawnedRobot) -> None:
        """Free the tiles of a robot that leaves."""
        self._shown = [m if m and m.robot is not robot else None for m in self._shown]

    def scenery(
        self, robots: Sequence[SpawnedRobot], around_of: AroundOf, *, tile: int | None = None
    ) -> Scenery:
        """Return what is shown now: all of the screen, or one tile of a multi-view."""
        if self._layout is None:
            return self._viewports(robots, around_of)
        if tile is None:
            return _composed(self._layout, self._shown, around_of)
        mounted = self._shown[tile] if tile < len(self._shown) else None
        return _composed(_single(self._tiles[0]), [mounted], around_of)

    def _viewports(self, robots: Sequence[SpawnedRobot], around_of: AroundOf) -> Scenery:
        """Return the viewports of the robot that is there longest; black without one."""
        robot = watched(robots)
        if robot is None:
            layout = viewports(ViewportConfig.SINGLE_VIEW, **_sides(self._black_px))
            return _composed(layout, [None], around_of)
        shown = [robot.camera_named(name) for name in robot.viewports.shown]
        first = shown[0] or robot.all_cameras[0]
        single = robot.viewports.config is ViewportConfig.SINGLE_VIEW
        whole = first if single else robot.all_cameras[0]
        layout = viewports(robot.viewports.config, **_sides(whole.size_px))
        mounted = [_Mounted(robot, c) if c else None for c in shown[: len(layout)]]
        return _composed(layout, mounted, around_of)


def watched(robots: Sequence[SpawnedRobot]) -> SpawnedRobot | None:
    """Return the robot that is watched: the one with a camera that is there longest."""
    return next((robot for robot in robots if robot.all_cameras), None)


def own_scenery(robot: SpawnedRobot, camera: Camera, around_of: AroundOf) -> Scenery:
    """Return one camera's own picture at its own size."""
    layout = viewports(ViewportConfig.SINGLE_VIEW, **_sides(camera.size_px))
    return _composed(layout, [_Mounted(robot, camera)], around_of)


def _composed(layout: TileLayout, shown: Sequence[_Mounted | None], around_of: AroundOf) -> Scenery:
    place = layout.tiles[0]
    takes = tuple(_take(m, place, around_of) if m else None for m in shown)
    intervals = [mounted.camera.frame_interval_s for mounted in shown if mounted]
    return Scenery(layout, takes, _caption(shown, place), min(intervals, default=0.0))


def _take(mounted: _Mounted, place: Tile, around_of: AroundOf) -> Take:
    robot = mounted.robot
    around = around_of(robot)
    camera = mounted.camera
    robot_pose = robot.world_from_robot
    take = camera.take(robot_pose, around.bodies, joints=robot.joints, tile=place)
    way = take.exposure.world_from_mirror.translation - robot_pose.translation
    exposure = replace(
        take.exposure,
        key=robot.frame_key(camera.name),
        twist=robot.twist.at(way),
        own_body=around.own_body if isinstance(take.eye, OmniEye) else None,
    )
    return replace(take, exposure=exposure)


def _caption(shown: Sequence[_Mounted | None], place: Tile) -> Caption:
    """Return whose picture it is: a camera's, one robot's, or nobody's in particular."""
    present = [mounted for mounted in shown if mounted]
    robots = {mounted.robot for mounted in present}
    if len(robots) != 1:
        return Caption()
    robot = robots.pop()
    whose = (robot.name, robot.description.class_name)
    if len(shown) > 1:
        return Caption(*whose, world_from_robot=robot.world_from_robot)
    camera = present[0].camera
    mount = camera.robot_from_camera(robot.joints)
    return Caption(*whose, camera.name, robot.world_from_robot, mount, camera.law(place))


def _single(tile: Tile) -> TileLayout:
    """Return the layout of one tile on its own."""
    size = (tile.width_px, tile.height_px)
    return TileLayout(1, 1, *size, *size)


def _sides(size_px: tuple[int, int]) -> dict[str, int]:
    return {"width_px": size_px[0], "height_px": size_px[1]}
