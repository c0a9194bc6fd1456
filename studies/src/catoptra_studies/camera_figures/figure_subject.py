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
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.planning.renderer_choice import create_renderer
from catoptra_server.render.render_plan import (
    MirrorSurface,
    PerPixel,
    RendererKind,
    RenderSettings,
    plan_from_settings,
)
from catoptra_server.render.renderer import FaceCamera, Image, Renderer, View
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import OmniCameraDescription, RobotDescription
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import World

# The image that the paper shows and all tables of its errors speak of.
PAPER_SIZE_PX = 360


@dataclass(frozen=True, slots=True, eq=False)
class FigureSubject:
    """A camera in a world, ready to be pictured; `rings` is the world of incidence angles.

    detail: part of a picture's natural size to render; below 1 only where time counts more.
    """

    camera: OmniCamera
    world_renderer: Renderer
    world_from_mirror: Pose
    rings_renderer: Renderer
    rings_from_mirror: Pose
    resolution_scale: float = 1.0

    def resize_camera(self, size_px: int) -> OmniCamera:
        """Return the camera with a square image of another size, its rim inscribed as before."""
        scale = size_px / min(self.camera.width_px, self.camera.height_px)
        return dataclasses.replace(
            self.camera,
            width_px=size_px,
            height_px=size_px,
            centre_px=(0.5 * size_px, 0.5 * size_px),
            horizon_radius_px=scale * self.camera.horizon_radius_px,
        )

    def render_frame(
        self, size_px: int, samples: int, *, surface: MirrorSurface | None = None
    ) -> Image:
        """Return the omnidirectional frame of the world, of samples^2 rays a pixel."""
        camera = self.resize_camera(round(size_px * self.resolution_scale))
        return _render(
            self._prepare_view(self.world_renderer, camera, surface, samples),
            self.world_from_mirror,
        )

    def render_rings(self, samples: int) -> Image:
        """Return the frame of the rings, always of the paper's size: it is measured."""
        camera = self.resize_camera(PAPER_SIZE_PX)
        return _render(
            self._prepare_view(self.rings_renderer, camera, None, samples), self.rings_from_mirror
        )

    def render_face(self, face: Face, size_px: int, samples: int) -> Image:
        """Return what one of the cube's virtual cameras sees of the world."""
        camera = FaceCamera(face, round(size_px * self.resolution_scale))
        return _render(self.world_renderer.prepare_face(camera, samples), self.world_from_mirror)

    def _prepare_view(
        self, renderer: Renderer, camera: OmniCamera, surface: MirrorSurface | None, samples: int
    ) -> View:
        wish = RenderSettings(surface or PerPixel(), samples)
        plan = plan_from_settings(wish, camera, kind=RendererKind.TRACE, reason="a figure")
        return renderer.prepare(camera, plan)


def _render(view: View, world_from_mirror: Pose) -> Image:
    try:
        return view.render(CameraState(world_from_mirror)).rgb
    finally:
        view.close()


@contextmanager
def open_figure_subject(
    robot_file: Path,
    world_file: Path,
    rings_world_file: Path,
    *,
    pose: PlanarPose | None,
    resolution_scale: float = 1.0,
) -> Iterator[FigureSubject]:
    """Yield what three files describe; without a pose the robot stands near the first start place.

    Raises ConfigError for a bad file, CatoptraError for a robot without a camera to picture.
    """
    description, _ = read_robot(robot_file)
    omni = _omni_camera(description, robot_file)
    in_world, _ = read_world(world_file)
    in_rings, _ = read_world(rings_world_file)
    ride_height_m = description.drive.ride_height_m
    world_renderer, rings_renderer = _open_renderer(in_world), _open_renderer(in_rings)
    try:
        yield FigureSubject(
            camera=omni.camera,
            world_renderer=world_renderer,
            world_from_mirror=(pose or _offset_pose(_first_start_pose(in_world))).at_height(
                ride_height_m
            )
            @ omni.robot_from_mirror,
            rings_renderer=rings_renderer,
            rings_from_mirror=_first_start_pose(in_rings).at_height(ride_height_m)
            @ omni.robot_from_mirror,
            resolution_scale=resolution_scale,
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


def _open_renderer(world: World) -> Renderer:
    return create_renderer(RendererKind.TRACE, build_scene(world), world)


def _first_start_pose(world: World) -> PlanarPose:
    if not world.starts:
        return PlanarPose(0.0, 0.0, 0.0)
    (x_m, y_m, _), (_, _, yaw_rad) = world.starts[0].location_m, world.starts[0].rotation_rad
    return PlanarPose(x_m, y_m, yaw_rad)


def _offset_pose(start: PlanarPose) -> PlanarPose:
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
