"""What the study draws: one robot's camera at a few places of a world, by each renderer."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.render.raster import OpenGLMissingError
from catoptra_server.render.render_plan import (
    PerPixel,
    RendererKind,
    RenderPlan,
    RenderSettings,
    plan_from_settings,
)
from catoptra_server.render.renderer import Image, Renderer, View
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import OmniCameraDescription
from catoptra_server.scene.scene_mesh import SceneMesh, build_scene
from catoptra_server.scene.world_description import World
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel

# The most that a plan allows.
REFERENCE_SAMPLES = 16
# Beside a start place, since a world's middle is on its lines, where no mirror bends them: metres
# back and left of it, degrees to the right. Small enough for a corridor.
_POSE_OFFSETS = ((0.45, 0.35, 25.0), (-0.5, 0.2, 70.0), (0.15, -0.4, 160.0), (-0.3, -0.3, 250.0))


@dataclass(frozen=True, slots=True, eq=False)
class StudySubject:
    """A camera of the wished size in a world. renderers: without raster where OpenGL is missing."""

    camera: OmniCamera
    world: World
    scene: SceneMesh
    renderers: Mapping[RendererKind, Renderer]
    camera_states: tuple[CameraState, ...]

    def plan_level(self, level: AccuracyLevel) -> RenderPlan:
        """Return the plan of a step."""
        return plan_from_settings(
            level.render_settings, self.camera, kind=level.renderer_kind, reason="measured"
        )

    def prepare_view(self, level: AccuracyLevel) -> View:
        """Return the view of a step."""
        return self.renderers[level.renderer_kind].prepare(self.camera, self.plan_level(level))

    def render_reference(self, samples: int) -> tuple[Image, ...]:
        """Return the exact frame of each exposure: a ray a sample, none left out."""
        wish = RenderSettings(PerPixel(), samples, stride_px=1)
        view = self.prepare_view(AccuracyLevel("reference", RendererKind.TRACE, wish))
        try:
            return tuple(view.render(exposure).rgb for exposure in self.camera_states)
        finally:
            view.close()


@contextmanager
def open_study_subject(
    robot_file: Path, world_file: Path, *, size_px: int, num_poses: int
) -> Iterator[StudySubject]:
    """Yield what two files describe.

    Raises ConfigError for a bad file, CatoptraError for a robot without a mirror camera.
    """
    description, _ = read_robot(robot_file)
    omni = description.omni_camera
    if omni is None:
        raise CatoptraError(
            f"{robot_file}: {description.class_name} has no omnidirectional camera to measure: take a "
            "robot with StaticMeshes, CamTexActors and Cameras, such as p2at_omni.ini"
        )
    described, _ = read_world(world_file)
    scene = build_scene(described)
    with ExitStack() as opened:
        renderers = _open_renderers(scene, described, opened)
        height_m = description.drive.ride_height_m
        yield StudySubject(
            camera=resize_camera(omni.camera, size_px),
            world=described,
            scene=scene,
            renderers=renderers,
            camera_states=_camera_states(described, omni, height_m)[:num_poses],
        )


def resize_camera(camera: OmniCamera, size_px: int) -> OmniCamera:
    """Return the camera with a square image of another size, its rim inscribed as before."""
    scale = size_px / min(camera.width_px, camera.height_px)
    return dataclasses.replace(
        camera,
        width_px=size_px,
        height_px=size_px,
        centre_px=(0.5 * size_px, 0.5 * size_px),
        horizon_radius_px=scale * camera.horizon_radius_px,
    )


def _open_renderers(
    scene: SceneMesh, world: World, stack: ExitStack
) -> dict[RendererKind, Renderer]:
    found = {}
    for kind in RendererKind:
        try:
            found[kind] = choose_renderer(kind.value, scene, world).renderer
        except OpenGLMissingError:
            continue
        stack.callback(found[kind].close)
    return found


def _camera_states(
    world: World, omni: OmniCameraDescription, height_m: float
) -> tuple[CameraState, ...]:
    start = _first_start_pose(world)
    return tuple(
        CameraState(_offset_pose(start, *place).at_height(height_m) @ omni.robot_from_mirror)
        for place in _POSE_OFFSETS
    )


def _first_start_pose(world: World) -> PlanarPose:
    if not world.starts:
        return PlanarPose(0.0, 0.0, 0.0)
    (x_m, y_m, _), (_, _, yaw_rad) = world.starts[0].location_m, world.starts[0].rotation_rad
    return PlanarPose(x_m, y_m, yaw_rad)


def _offset_pose(start: PlanarPose, back_m: float, left_m: float, turn_deg: float) -> PlanarPose:
    """Return the pose a step back and left of a start place, turned to the right."""
    offset = Pose.from_rpy((-back_m, -left_m, 0.0))
    moved = start.at_height(0.0) @ offset
    x_m, y_m, _ = moved.translation
    return PlanarPose(float(x_m), float(y_m), start.yaw_rad + math.radians(turn_deg))
