"""A P2AT without noise, a world of walls, and fakes of clients, views and view providers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import InitResult, Report, StartPose
from catoptra_server.effects.effect_plan import NO_EFFECTS, EffectDecision
from catoptra_server.frames.frame import IMAGE_PORT, Channel, Frame, FrameRequest, ViewRequest
from catoptra_server.frames.frame_plan import CameraPlan, FramePlan, ViewState
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec
from catoptra_server.frames.plan.error_bound import ErrorBound, error_bound
from catoptra_server.frames.plan.plans import PerspectivePlan, PlanChoice, plan_from_settings
from catoptra_server.frames.render_thread import render_frame
from catoptra_server.frames.views import RenderedView
from catoptra_server.render.renderer import RenderedImage, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.ray_caster import commit_to_reference
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.collision_index import collision_height_m
from catoptra_server.simulation.drive import RobotBody
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.ground import SceneGround
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import (
    DriveBase,
    Mount,
    OmniCameraDescription,
    PlanarPose,
    RobotDescription,
    SensorDescription,
)
from catoptra_server.simulation.sensors import EmptyScene, Sensor, build_sensors
from catoptra_server.simulation.sensors.encoder import EncoderDescription
from catoptra_server.simulation.sensors.gps import GpsDescription
from catoptra_server.simulation.sensors.ground_truth import GroundTruthDescription
from catoptra_server.simulation.sensors.ins import InsDescription
from catoptra_server.simulation.sensors.odometry import OdometryDescription
from catoptra_server.simulation.sensors.range_scanner import RangeScannerDescription
from catoptra_server.simulation.sensors.rfid import RfidDescription
from catoptra_server.simulation.sensors.sonar import SonarDescription
from catoptra_server.simulation.sensors.tachometer import TachometerDescription
from catoptra_server.simulation.sensors.touch import TouchDescription
from catoptra_server.simulation.sensors.victim_sensor import VictimSensorDescription
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World

BASE = DriveBase(
    wheel_radius_m=0.13,
    wheel_separation_m=0.4712,
    wheel_base_m=0.2884,
    dimensions_m=(0.5238, 0.4968, 0.2913),
    ride_height_m=0.1457,
    mass_kg=14.0,
    max_speed_rad_s=5.385,
    max_torque=60.0,
    turn_slip=0.0,
    slip_noise=0.0,
)
ODOMETRY = OdometryDescription("Odometry", 0.2)
GROUND_TRUTH = GroundTruthDescription("GroundTruth", 0.2, decimals=9)
FORWARD_MOUNT = Mount((0.1, 0.0, -0.05), (0.0, 0.0, 0.0))
SCANNER = RangeScannerDescription(
    "Scanner1", 0.2, FORWARD_MOUNT, fov_rad=math.pi, resolution_rad=math.pi / 180.0,
    min_range_m=0.1, max_range_m=20.0,
)  # fmt: skip
SONAR = SonarDescription(
    "F1", 0.2, FORWARD_MOUNT, beam_rad=0.3491, min_range_m=0.1, max_range_m=5.0
)
INS = InsDescription("INS", 0.2, FORWARD_MOUNT)
ENCODER = EncoderDescription("ECLeft", 0.2, FORWARD_MOUNT, shaft="left", resolution_rad=0.01745)
TACHOMETER = TachometerDescription("TachTest", 0.2, FORWARD_MOUNT)
TOUCH = TouchDescription("Touch", 0.2, FORWARD_MOUNT, diameter_m=0.01)
RFID = RfidDescription("RFID", 0.2, FORWARD_MOUNT, max_range_m=2.0)
VICTIMS = VictimSensorDescription("VictSensor", 0.2, FORWARD_MOUNT, fov_rad=1.0, max_range_m=5.0)
GPS = GpsDescription("GPS", 0.2, FORWARD_MOUNT)


def make_sensor(*descriptions: SensorDescription, seed: int = 1) -> Sensor:
    """Sensor of a description, or of several that share a line, on the P2AT."""
    (sensor,) = build_sensors(
        descriptions, BASE, lambda stream: RandomSource.from_names(seed, "R", stream)
    )
    return sensor


def make_instrument(*descriptions: SensorDescription, seed: int = 1) -> Any:
    """The measuring part of such a sensor."""
    return make_sensor(*descriptions, seed=seed).instrument


CAMERA = OmniCameraDescription(
    name="OmniCam",
    camera=camera_with_inscribed_rim(
        PAPER_MIRROR, width_px=8, height_px=6, rim_rad=math.radians(120.0)
    ),
    robot_from_mirror=Pose.from_rpy((0.0, 0.0, -0.4543)),
    texture_clients=(),
    render_settings=RenderSettings(),
    min_frame_interval_s=0.0,
    capture_fov_rad=0.33,
)


def make_p2at(*, base: DriveBase = BASE, **changes: Any) -> RobotDescription:
    """Robot with odometry, ground truth and a small camera; `changes` replace fields."""
    robot = RobotDescription(
        class_name="USARBot.OmniP2AT",
        drive=base,
        sensors=(ODOMETRY, GROUND_TRUTH),
        omni_cameras=(CAMERA,),
        status_interval_s=0.2,
        battery_s=1200.0,
    )
    return dataclasses.replace(robot, **changes)


def make_noisy_p2at() -> RobotDescription:
    """P2AT with random slip and odometry noise."""
    base = dataclasses.replace(BASE, turn_slip=0.03, slip_noise=0.01)
    odometry = dataclasses.replace(
        ODOMETRY, distance_noise_m=0.01, turn_noise_rad=0.02, heading_noise_rad=0.01
    )
    return make_p2at(base=base, sensors=(odometry, GROUND_TRUTH))


def stand(description: RobotDescription, pose: PlanarPose) -> RobotBody:
    """Base of a class on the plane z = 0."""
    return RobotBody.on_floor(description.drive, pose, collision_height_m(description))


def make_robot_at(
    description: RobotDescription, pose: PlanarPose, *, name: str, seed: int, time_s: float
) -> Robot:
    """Robot on the plane z = 0."""
    body = stand(description, pose)
    return Robot(description, body, name=name, seed=seed, time_s=time_s)


def make_ground(world: World | None = None) -> SceneGround:
    """Ground of a world, without a floor in most; else a plane."""
    scene = build_scene(world or World("plane", ()))
    return SceneGround(scene, commit_to_reference(scene) if len(scene) else EmptyScene())


def make_walled_world(*walls_x_m: float) -> World:
    """World with walls, 0.1 m thick, whose near faces are at these x > 0."""
    items = tuple(
        Item(
            f"wall {index}",
            Box((0.1, 4.0, 1.0)),
            Pose.from_rpy((x + 0.05, 0.0, -0.5)),
            Material((0.5, 0.5, 0.5)),
        )
        for index, x in enumerate(walls_x_m or (50.0,))
    )
    starts = (
        StartPose("Centre", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        StartPose("Aside", (1.0, -2.0, 0.3), (0.1, 0.2, 1.5)),
    )
    return World("walls", items, starts=starts)


class FakeClient:
    """A control connection that stores all reports."""

    def __init__(self) -> None:
        self.batches: list[tuple[Report, ...]] = []
        self.rejections: list[str] = []
        self.spawns: list[tuple[str, tuple[float, float, float] | None]] = []
        self.disconnections: list[str] = []
        self.num_resumes = 0

    @property
    def reports(self) -> list[Report]:
        """All reports, in order."""
        return [report for batch in self.batches for report in batch]

    def deliver(self, reports: Sequence[Report]) -> None:
        """Store a batch of reports."""
        self.batches.append(tuple(reports))

    def finish_init(self, result: InitResult) -> None:
        """Store the name and the location of a spawn, or the reason of a rejection."""
        if result.failure:
            self.rejections.append(result.failure)
        else:
            self.spawns.append((result.name, result.moved_to))

    def disconnect(self, reason: str) -> None:
        """Store the reason of a disconnection."""
        self.disconnections.append(reason)

    def resume_reading(self) -> None:
        """Count the calls."""
        self.num_resumes += 1


class FakeView:
    """A view whose images have the number of the rendering in every byte."""

    memory_bytes = 0

    def __init__(self) -> None:
        self.camera_states: list[CameraState] = []
        self.is_closed = False

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Render the next image."""
        self.camera_states.append(camera_state)
        rgb = np.full((6, 8, 3), len(self.camera_states), dtype=np.uint8)
        return RenderedImage(rgb, {"fake": 1.0})

    def close(self) -> None:
        """Record the closing."""
        self.is_closed = True


def make_rendered_view(
    image: RenderedImage,
    request: ViewRequest,
    *,
    bounds: dict[str, float] | None = None,
    decisions: tuple[EffectDecision, ...] = (),
) -> RenderedView:
    """An image as drawn by a plan with some bounds."""
    plan = PerspectivePlan(RendererKind.TRACE, 1, "fake")
    camera, state = request.camera, request.camera_state
    camera_plan = CameraPlan(camera, plan)
    frame_plan = FramePlan(
        camera,
        camera,
        plan,
        camera_plan.view_key,
        "fake plan",
        state,
        state,
        NO_EFFECTS,
        None,
        bounds,
        camera_plan,
        0.0,
    )
    return RenderedView(image, frame_plan, decisions)


LEVEL = CameraState(Pose.identity())


class FakeViewProvider:
    """Views of all cameras, rendered by one fake view at the size of the camera."""

    def __init__(self, view: FakeView | None = None) -> None:
        self.view = view or FakeView()
        self.view_requests: list[ViewRequest] = []

    def render(self, request: ViewRequest) -> RenderedView:
        """Render the next image, with the error bound of a traced omnidirectional camera."""
        self.view_requests.append(request)
        image = self.view.render(request.camera_state)
        spec = request.camera
        camera = spec.camera
        rgb = np.full((camera.height_px, camera.width_px, 3), image.rgb.flat[0], dtype=np.uint8)
        bound = self.error_bound(request.camera)
        bounds = bound.numbers_by_name() if bound else None
        return make_rendered_view(RenderedImage(rgb, image.stage_ms), request, bounds=bounds)

    def error_bound(self, camera: CameraSpec) -> ErrorBound | None:
        """Error bound of an omnidirectional camera as requested, traced."""
        if not isinstance(camera, OmniCameraSpec):
            return None
        return self.view_state(ViewRequest(camera, LEVEL)).choice.bound

    def view_state(self, request: ViewRequest) -> ViewState:
        """Plan of an omnidirectional camera as requested, traced in 12.5 ms."""
        camera = cast(OmniCameraSpec, request.camera)
        plan = plan_from_settings(
            camera.render_settings, camera.camera, kind=RendererKind.TRACE, reason="fake"
        )
        return ViewState(PlanChoice(plan, error_bound(camera.camera, plan)), 12.5)

    def close_idle(self) -> None:
        """Close nothing: there is one view."""

    def close(self) -> None:
        """Close the view."""
        self.view.close()


def render_channel(fleet: Fleet, views: Any = None, channel: Channel = IMAGE_PORT) -> Frame:
    """Render the present frame of a channel."""
    composition = fleet.cameras.compose_frame(channel)
    assert composition is not None
    request = FrameRequest(channel, 1, 0.0, 0.0, composition)
    # Not `or`: an empty view cache is false.
    provider = views if views is not None else FakeViewProvider()
    return render_frame(request, provider, monotonic=lambda: 0.0)
