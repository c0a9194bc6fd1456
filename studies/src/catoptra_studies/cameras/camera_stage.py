"""One world in which every camera renders from the same place: frames, and milliseconds each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.config.camera_file import CameraFile, carry_camera
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.render.renderer import Renderer, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import PerPixel, RenderSettings
from catoptra_server.robot.robot_description import OmniCameraDescription
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_studies.camera_figures.frame_rates import time_round_robin
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import study_poses

# Along a pixel's side: the samples of the camera files.
_NUM_SAMPLES = 2


@dataclass(frozen=True, slots=True, eq=False)
class StagedCamera:
    """A camera file with the camera and the place that a robot gives it."""

    file: CameraFile
    robot_file: Path
    description: OmniCameraDescription

    height_m: float
    """Height of the viewpoint above the floor."""

    @property
    def camera(self) -> OmniCamera:
        """The camera model."""
        return self.description.camera


@dataclass(frozen=True, slots=True, eq=False)
class CameraStage:
    """A world and its trace renderer, which is exact for every camera."""

    renderer: Renderer
    landmarks: tuple[Landmark, ...]
    """Landmarks of the world."""

    cameras: tuple[StagedCamera, ...]
    states: tuple[CameraState, ...]
    """Pose of each camera."""

    def render_frame(self, index: int) -> Image:
        """Frame of a camera."""
        view = self._prepare(index)
        try:
            return view.render(self.states[index]).rgb
        finally:
            view.close()

    def time_frames(self, num_rounds: int, on_round: Callable[[], None]) -> tuple[float, ...]:
        """Processor time of a frame of each camera in milliseconds: medians over rounds."""
        views = [self._prepare(index) for index in range(len(self.cameras))]
        try:
            draw = [
                # The state as a default: bound now, not after the loop.
                lambda _, view=view, state=state: view.render(state).stage_ms
                for view, state in zip(views, self.states, strict=True)
            ]
            timings = time_round_robin(draw, num_rounds=num_rounds, on_round=on_round)
        finally:
            for view in views:
                view.close()
        return tuple(timing.cpu_ms for timing in timings)

    def _prepare(self, index: int) -> View:
        camera = self.cameras[index].camera
        settings = RenderSettings(PerPixel(), _NUM_SAMPLES)
        plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="compared")
        return self.renderer.prepare(camera, plan)


def stage_cameras(
    files: Sequence[CameraFile], folder: Path, *, size_px: int | None
) -> tuple[StagedCamera, ...]:
    """Give each camera to a robot, whose file is written into a folder.

    Args:
        files: Cameras.
        folder: Folder for a robot file of each camera.
        size_px: Width and height of images, of cameras that have no size of their own.
    """
    staged = []
    for file in files:
        robot_file = folder.resolve() / f"robot_{file.name}.ini"
        description = carry_camera(file, robot_file, size_px=size_px)
        above_chassis_m = -float(description.robot_from_mirror.translation[2])
        ride_height_m = read_robot(robot_file)[0].drive.ride_height_m
        staged.append(StagedCamera(file, robot_file, description, ride_height_m + above_chassis_m))
    return tuple(staged)


@contextmanager
def open_stage(cameras: Sequence[StagedCamera], world_file: Path) -> Iterator[CameraStage]:
    """Start the renderer of a world, with all cameras at the first pose of the studies.

    Raises:
        ConfigError: The world cannot be read.
    """
    world, _ = read_world(world_file)
    pose = study_poses(world)[0]
    renderer = choose_renderer(RendererKind.TRACE.value, build_scene(world), world).renderer
    try:
        states = tuple(
            CameraState(pose.at_height(camera.height_m + float(mirror.translation[2])) @ mirror)
            for camera in cameras
            for mirror in (camera.description.robot_from_mirror,)
        )
        yield CameraStage(renderer, world.landmarks, tuple(cameras), states)
    finally:
        renderer.close()
