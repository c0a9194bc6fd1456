"""One world in which every camera renders from the same place: frames, and milliseconds each.

Each camera is given to a robot of its own, which carries the viewpoint of all at one height. The
commands `cameras` and `compare` declare their cameras, world and sizes here.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from catoptra_protocol.command_line import CommandParser, parse_count
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.camera_file import CameraFile, carry_camera, read_camera_files
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import PerPixel, RenderSettings, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.simulation.robot_bodies import build_carrier_mesh
from catoptra_server.simulation.robot_description import OmniCameraDescription
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.scene_mesh import build_scene
from catoptra_studies.camera_figures.frame_rates import time_round_robin
from catoptra_studies.commands import open_progress, parse_size
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import render_once, study_poses

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

    renderer: TraceRenderer
    world_file: Path
    landmarks: tuple[Landmark, ...]
    """Landmarks of the world."""

    cameras: tuple[StagedCamera, ...]
    states: tuple[CameraState, ...]
    """Pose of each camera, without the robot that carries it."""

    labels: LabelRenderer
    """Ground truth in the same world."""

    def render_frame(self, index: int) -> Image:
        """Frame of a camera."""
        return render_once(self._prepare(index), self.states[index])

    def hidden_floor_m(self, index: int) -> float:
        """Distance up to which the robot hides floor from a camera, by the labels of its image.

        Of a pixel that shows the robot, the floor where its ray would meet it without the robot;
        0 without such a pixel, inf where the robot reaches up to the horizon of the viewpoint.
        """
        staged, state = self.cameras[index], self.states[index]
        robot = read_robot(staged.robot_file)[0]
        world_from_robot = state.world_from_mirror @ staged.description.robot_from_mirror.inverse()
        body = DynamicObject(build_carrier_mesh(robot), world_from_robot)
        image = LabelledImage(staged.camera, replace(state, objects=(body,)))
        truth = self.labels.render(image, ("ids", "point"))
        points = truth.channels["point"][truth.channels["ids"] == truth.objects[-1].number]
        if not len(points):
            return 0.0
        offset = points.astype(np.float64) - state.world_from_mirror.translation
        # z points down: the ray goes on from the robot to the floor.
        below = np.maximum(offset[:, 2], 0.0)
        with np.errstate(divide="ignore"):
            return float((np.hypot(*offset[:, :2].T) * staged.height_m / below).max())

    def time_frames(self, num_rounds: int) -> tuple[float, ...]:
        """Processor time of a frame of each camera in milliseconds: medians over rounds."""
        with ExitStack() as stack:
            views = [
                stack.enter_context(closing(self._prepare(index)))
                for index in range(len(self.cameras))
            ]
            draw = [
                # The state as a default: bound now, not after the loop.
                lambda _, view=view, state=state: view.render(state).stage_ms
                for view, state in zip(views, self.states, strict=True)
            ]
            timings = time_round_robin(draw, num_rounds=num_rounds, on_round=lambda: None)
        return tuple(timing.cpu_ms for timing in timings)

    def _prepare(self, index: int) -> View:
        camera = self.cameras[index].camera
        settings = RenderSettings(PerPixel(), _NUM_SAMPLES)
        plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="compared")
        return self.renderer.prepare(camera, plan)


def add_camera_options(parser: CommandParser, *, size_px: int) -> None:
    """Declare the options that `open_requested_stage` reads, and the number of timed frames."""
    add = parser.add_argument
    add("--cameras", type=_find_cameras, default=[], metavar="A,B",
        help="camera files or bundled names (default: all of configs/cameras)")  # fmt: skip
    add("--world", type=partial(find_configuration, "worlds"), default="four_legged_2006",
        metavar="FILE", help="world ini, or a bundled name")  # fmt: skip
    add("--size", type=parse_size, default=size_px, metavar="PX",
        help="side of images, but of cameras calibrated in pixels")  # fmt: skip
    add("--frames", type=parse_count, default=9, metavar="N",
        help="frames of each camera that are timed")  # fmt: skip


def _find_cameras(text: str) -> list[str]:
    return [str(find_configuration("cameras", name)) for name in text.split(",")]


@contextmanager
def open_requested_stage(
    parsed: argparse.Namespace,
) -> Iterator[tuple[CameraStage, Callable[[], None]]]:
    """Start the renderer of a command line's world, and a progress bar that each camera advances.

    Raises:
        ConfigError: The world or a camera cannot be read.
    """
    files = read_camera_files(parsed.cameras)
    cameras = tuple(_give_to_robot(file, parsed.out, parsed.size) for file in files)
    world, _ = read_world(parsed.world)
    # All cameras at the first pose of the studies.
    pose = study_poses(world)[0]
    states = tuple(
        CameraState(pose.at_height(camera.height_m + float(mirror.translation[2])) @ mirror)
        for camera in cameras
        for mirror in (camera.description.robot_from_mirror,)
    )
    scene = build_scene(world)
    with (
        open_progress() as progress,
        closing(TraceRenderer(scene, world)) as renderer,
        closing(LabelRenderer(renderer, scene)) as labels,
    ):
        stage = CameraStage(renderer, parsed.world, world.landmarks, cameras, states, labels)
        yield stage, progress.add_task("cameras", len(files))


def _give_to_robot(file: CameraFile, folder: Path, size_px: int) -> StagedCamera:
    robot_file = folder.resolve() / f"robot_{file.name}.ini"
    description = carry_camera(file, robot_file, size_px=size_px)
    above_chassis_m = -float(description.robot_from_mirror.translation[2])
    ride_height_m = read_robot(robot_file)[0].drive.ride_height_m
    return StagedCamera(file, robot_file, description, ride_height_m + above_chassis_m)
