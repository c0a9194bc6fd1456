"""One robot's camera at a few poses in a world, rendered by the server's own code.

Accuracy against cost and the camera figures share this subject: the study of cost compares all
renderers at several poses, a figure takes one frame of the trace renderer.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from catoptra_protocol.errors import CatoptraError, RendererUnavailableError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import choose_renderer
from catoptra_server.render.renderer import (
    FaceCamera,
    MirrorSurface,
    PerPixel,
    Renderer,
    RenderPlan,
    RenderSettings,
    View,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.simulation.robot_description import (
    OmniCameraDescription,
    PlanarPose,
    RobotDescription,
)
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World
from catoptra_studies.plot_style import Image

# The largest number of samples that a plan allows.
REFERENCE_SAMPLES = 16
# Metres back and left of the first start pose, degrees to the right. A world's centre is on the
# lines, which run straight through the image's centre where no mirror bends them; so no pose is on
# the start itself. Half a metre at most, since the corridor is not wider.
_POSE_OFFSETS = ((0.45, 0.35, 25.0), (-0.5, 0.2, 70.0), (0.15, -0.4, 160.0), (-0.3, -0.3, 250.0))
# Figures show the exact image, and trace is exact and runs everywhere.
FIGURE_RENDERERS = (RendererKind.TRACE,)


@dataclass(frozen=True, slots=True, eq=False)
class StudySubject:
    """A camera in a world, ready to be rendered."""

    camera: OmniCamera
    """The robot's camera, with a square image of the study's size."""

    world: World
    """Description of the world, as in the file."""

    scene: SceneMesh
    """Triangles of the world."""

    renderers: Mapping[RendererKind, Renderer]
    """Renderers that run here: raster is missing where OpenGL is."""

    camera_states: tuple[CameraState, ...]
    """State of the camera at each pose."""

    resolution_scale: float = 1.0
    """Factor on the sizes that figures request; below 1 only in tests, to save time."""

    def resize_camera(self, size_px: int) -> OmniCamera:
        """The subject's camera with a square image of another size."""
        return resize_camera(self.camera, size_px)

    def plan(self, kind: RendererKind, settings: RenderSettings) -> RenderPlan:
        """Plan of the settings for the subject's camera."""
        return plan_from_settings(settings, self.camera, kind=kind, reason="measured")

    def prepare_view(self, kind: RendererKind, settings: RenderSettings) -> View:
        """Prepare a view, to be closed by the caller."""
        return self.renderers[kind].prepare(self.camera, self.plan(kind, settings))

    def render_reference(self, samples: int) -> tuple[Image, ...]:
        """Render the exact frame at each pose, of samples^2 rays a pixel."""
        settings = RenderSettings(PerPixel(), samples)
        with closing(self.prepare_view(RendererKind.TRACE, settings)) as view:
            return tuple(view.render(state).rgb for state in self.camera_states)

    def render_frame(
        self, size_px: int, samples: int, *, surface: MirrorSurface | None = None
    ) -> Image:
        """Render the frame at the first pose.

        Args:
            size_px: Width and height of the image, before `resolution_scale`.
            samples: Samples along a pixel's side.
            surface: Mirror mesh to look up; None evaluates the camera model in every ray.

        Returns:
            (size, size, 3) RGB image.
        """
        camera = self.resize_camera(round(size_px * self.resolution_scale))
        # A copy: the subject itself keeps the study's size.
        resized = dataclasses.replace(self, camera=camera)
        settings = RenderSettings(surface or PerPixel(), samples)
        return render_once(
            resized.prepare_view(RendererKind.TRACE, settings), self.camera_states[0]
        )

    def render_face(self, face: Face, size_px: int, samples: int) -> Image:
        """Render the view of one virtual camera of the cube, at the first pose."""
        camera = FaceCamera(face, round(size_px * self.resolution_scale))
        view = self.renderers[RendererKind.TRACE].prepare_face(camera, samples)
        return render_once(view, self.camera_states[0])


def render_once(view: View, state: CameraState) -> Image:
    """Render one frame and close the view."""
    with closing(view):
        return view.render(state).rgb


@contextmanager
def open_study_subject(
    robot_file: Path,
    world_file: Path,
    *,
    size_px: int | None = None,
    poses: Sequence[PlanarPose] | None = None,
    num_poses: int = len(_POSE_OFFSETS),
    kinds: Sequence[RendererKind] = tuple(RendererKind),
    resolution_scale: float = 1.0,
) -> Iterator[StudySubject]:
    """Read two files and start the renderers.

    Args:
        robot_file: Robot with an omnidirectional camera.
        world_file: World in which the robot stands.
        size_px: Width and height of the image; None keeps the size in the robot file.
        poses: Poses of the robot; None takes `study_poses`.
        num_poses: Number of the latter.
        kinds: Renderers to start; raster is left out where OpenGL is missing.
        resolution_scale: Factor on the sizes that figures request.

    Raises:
        ConfigError: A file cannot be read.
        CatoptraError: The robot has no omnidirectional camera.
    """
    description, _ = read_robot(robot_file)
    omni = _require_omni_camera(description, robot_file)
    world, _ = read_world(world_file)
    scene = build_scene(world)
    # Above the floor: a pose is planar, and the robot rides on wheels.
    height_m = description.drive.ride_height_m
    with ExitStack() as stack:
        yield StudySubject(
            camera=omni.camera if size_px is None else resize_camera(omni.camera, size_px),
            world=world,
            scene=scene,
            renderers=_open_renderers(kinds, scene, world, stack),
            camera_states=tuple(
                CameraState(pose.at_height(height_m) @ omni.robot_from_mirror)
                for pose in poses or study_poses(world)[:num_poses]
            ),
            resolution_scale=resolution_scale,
        )


def resize_camera(camera: OmniCamera, size_px: int) -> OmniCamera:
    """The camera with a square image of another size, with the rim inscribed as before."""
    # The rim touches the shorter sides, so these scale the radius.
    scale = size_px / min(camera.width_px, camera.height_px)
    return dataclasses.replace(
        camera,
        width_px=size_px,
        height_px=size_px,
        centre_px=(0.5 * size_px, 0.5 * size_px),
        scale_px=scale * camera.scale_px,
    )


def first_start_pose(world: World) -> PlanarPose:
    """Pose of a world's first start, or the origin in a world without starts."""
    if not world.starts:
        return PlanarPose(0.0, 0.0, 0.0)
    (x_m, y_m, _), (_, _, yaw_rad) = world.starts[0].location_m, world.starts[0].rotation_rad
    return PlanarPose(x_m, y_m, yaw_rad)


def study_poses(world: World) -> tuple[PlanarPose, ...]:
    """Four poses around a world's first start, from which no line looks straight."""
    start = first_start_pose(world)
    poses = []
    for back_m, left_m, turn_deg in _POSE_OFFSETS:
        # Back and left along the robot's axes, then a turn to the right.
        moved = start.at_height(0.0) @ Pose.from_rpy((-back_m, -left_m, 0.0))
        x_m, y_m, _ = moved.translation
        yaw_rad = start.yaw_rad + math.radians(turn_deg)
        poses.append(PlanarPose(float(x_m), float(y_m), yaw_rad))
    return tuple(poses)


def _require_omni_camera(robot: RobotDescription, file: Path) -> OmniCameraDescription:
    if robot.omni_camera is None:
        raise CatoptraError(
            f"{file}: {robot.class_name} has no omnidirectional camera: take a robot with "
            "StaticMeshes, CamTexActors and Cameras, such as configs/robots/p2at_omni.ini"
        )
    return robot.omni_camera


def _open_renderers(
    kinds: Sequence[RendererKind], scene: SceneMesh, world: World, stack: ExitStack
) -> dict[RendererKind, Renderer]:
    """Start the renderers that run here; closed by the stack."""
    renderers = {}
    # Software OpenGL counts, too: the study compares renderers as found on this machine.
    for kind in kinds:
        try:
            renderers[kind] = choose_renderer(kind.value, scene, world).renderer
        except RendererUnavailableError:
            continue
        stack.callback(renderers[kind].close)
    return renderers
