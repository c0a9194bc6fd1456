"""What the figures picture: one robot's camera somewhere in a world, and among the rings.

Renders through the Renderer interface alone, with the trace renderer: it is exact, and runs
everywhere.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.cube import Face
from catoptra_protocol.optics.frames import Pose
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.plan.render_plan import (
    PerPixel,
    RendererKind,
    RenderWish,
    Surface,
    plan_from_wish,
)
from catoptra_server.render.renderer import Exposure, FaceCamera, Image, Renderer, View
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.robot.description import OmniCameraDescription, RobotDescription
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import build_scene

# The image that the paper shows and all tables of its errors speak of.
PAPER_SIZE_PX = 360


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A camera in a world, ready to be pictured; `rings` is the world of incidence angles.

    detail: part of a picture's natural size to render; below 1 only where time counts more.
    """

    camera: OmniCamera
    world: Renderer
    world_from_mirror: Pose
    rings: Renderer
    rings_from_mirror: Pose
    detail: float = 1.0

    def camera_of_size(self, size_px: int) -> OmniCamera:
        """Return the camera with a square image of another size, its rim inscribed as before."""
        scale = size_px / min(self.camera.width_px, self.camera.height_px)
        return dataclasses.replace(
            self.camera,
            width_px=size_px,
            height_px=size_px,
            centre_px=(0.5 * size_px, 0.5 * size_px),
            horizon_radius_px=scale * self.camera.horizon_radius_px,
        )

    def frame(self, size_px: int, samples: int, *, surface: Surface | None = None) -> Image:
        """Return the omnidirectional frame of the world, of samples^2 rays a pixel."""
        camera = self.camera_of_size(round(size_px * self.detail))
        return _drawn(self._view(self.world, camera, surface, samples), self.world_from_mirror)

    def rings_frame(self, samples: int) -> Image:
        """Return the frame of the rings, always of the paper's size: it is measured."""
        camera = self.camera_of_size(PAPER_SIZE_PX)
        return _drawn(self._view(self.rings, camera, None, samples), self.rings_from_mirror)

    def face(self, face: Face, size_px: int, samples: int) -> Image:
        """Return what one of the cube's virtual cameras sees of the world."""
        camera = FaceCamera(face, round(size_px * self.detail))
        return _drawn(self.world.prepare_face(camera, samples), self.world_from_mirror)

    def _view(
        self, renderer: Renderer, camera: OmniCamera, surface: Surface | None, samples: int
    ) -> View:
        wish = RenderWish(surface or PerPixel(), samples)
        plan = plan_from_wish(wish, camera, kind=RendererKind.TRACE, why="a figure")
        return renderer.prepare(camera, plan)


def _drawn(view: View, world_from_mirror: Pose) -> Image:
    try:
        return view.draw(Exposure(world_from_mirror)).rgb
    finally:
        view.close()


@contextmanager
def open_subject(
    robot: Path, world: Path, rings_world: Path, *, pose: PlanarPose | None, detail: float = 1.0
) -> Iterator[Subject]:
    """Yield what three files describe; without a pose the robot stands near the first start place.

    Raises ConfigError for a bad file, CatoptraError for a robot without a camera to picture.
    """
    description, _ = read_robot(robot)
    omni = _omni_camera(description, robot)
    in_world, _ = read_world(world)
    in_rings, _ = read_world(rings_world)
    ride_height_m = description.drive.ride_height_m
    world_renderer, rings_renderer = _renderer(in_world), _renderer(in_rings)
    try:
        yield Subject(
            camera=omni.camera,
            world=world_renderer,
            world_from_mirror=(pose or _beside(_first_start(in_world))).at_height(ride_height_m)
            @ omni.robot_from_mirror,
            rings=rings_renderer,
            rings_from_mirror=_first_start(in_rings).at_height(ride_height_m)
            @ omni.robot_from_mirror,
            detail=detail,
        )
    finally:
        world_renderer.close()
        rings_renderer.close()


def _omni_camera(robot: RobotDescription, file: Path) -> OmniCameraDescription:
    if robot.omni_camera is None:
        raise CatoptraError(
            f"{file}: {robot.class_name} has no omnidirectional camera to picture: take a robot "
            "with StaticMeshes, CamTexActors and Cameras, such as configs/robots/p2at_omni.ini"
        )
    return robot.omni_camera


def _renderer(world: World) -> TraceRenderer:
    return TraceRenderer(build_scene(world), world)


def _first_start(world: World) -> PlanarPose:
    if not world.starts:
        return PlanarPose(0.0, 0.0, 0.0)
    (x_m, y_m, _), (_, _, yaw_rad) = world.starts[0].location_m, world.starts[0].rotation_rad
    return PlanarPose(x_m, y_m, yaw_rad)


def _beside(start: PlanarPose) -> PlanarPose:
    """Return a pose a step back and left of a start place, turned to the right.

    On the place itself, often a world's centre, its lines run straight through the image's middle,
    where no mirror bends them.
    """
    back_m, left_m, turn_rad = 0.45, 0.35, math.radians(25.0)
    ahead = math.cos(start.yaw_rad), math.sin(start.yaw_rad)
    return PlanarPose(
        start.x_m - back_m * ahead[0] + left_m * ahead[1],
        start.y_m - back_m * ahead[1] - left_m * ahead[0],
        start.yaw_rad + turn_rad,
    )
