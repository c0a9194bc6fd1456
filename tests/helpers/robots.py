"""A P2AT without noise, a world of walls, and stand-ins for what surrounds a fleet."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import Report
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_request import (
    IMAGE_PORT,
    CameraSpec,
    Channel,
    FrameRequest,
    OmniCameraSpec,
    ViewRequest,
)
from catoptra_server.frames.render_thread import render_frame
from catoptra_server.frames.view_cache import ViewState
from catoptra_server.planning.error_bound import ErrorBound, error_bound
from catoptra_server.planning.planner import PlanChoice
from catoptra_server.render.render_plan import RendererKind, plan_from_settings
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.robot.robot_description import (
    DriveBase,
    EncoderDescription,
    GpsDescription,
    GroundTruthDescription,
    InsDescription,
    Mount,
    OdometryDescription,
    OmniCameraDescription,
    RangeScannerDescription,
    RfidDescription,
    RobotDescription,
    SonarDescription,
    TachometerDescription,
    TouchDescription,
    VictimSensorDescription,
)
from catoptra_server.scene.world_description import Box, Item, Material, StartPlace, World
from catoptra_server.simulation.fleet import Fleet

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
# One of each kind.
SENSORS = (
    *(SONAR, SCANNER, INS, ODOMETRY, ENCODER, TACHOMETER),
    *(TOUCH, RFID, VICTIMS, GROUND_TRUTH, GPS),
)
CAMERA = OmniCameraDescription(
    name="OmniCam",
    camera=camera_with_inscribed_rim(
        HyperbolicMirror(11.546, 0.2321), width_px=8, height_px=6, rim_rad=math.radians(120.0)
    ),
    robot_from_mirror=Pose.from_rpy((0.0, 0.0, -0.4543)),
    texture_clients=(),
    render_settings=RenderSettings(),
    min_frame_interval_s=0.0,
    capture_fov_rad=0.33,
)


def make_p2at(*, base: DriveBase = BASE, **changes: Any) -> RobotDescription:
    """Return a robot with odometry, ground truth and a small camera; `changes` replace fields."""
    robot = RobotDescription(
        class_name="USARBot.OmniP2AT",
        drive=base,
        sensors=(ODOMETRY, GROUND_TRUTH),
        omni_camera=CAMERA,
        status_interval_s=0.2,
        battery_s=1200.0,
    )
    return dataclasses.replace(robot, **changes)


def make_noisy_p2at() -> RobotDescription:
    """Return a P2AT whose floor and odometry draw random numbers."""
    base = dataclasses.replace(BASE, turn_slip=0.03, slip_noise=0.01)
    odometry = dataclasses.replace(
        ODOMETRY, distance_noise_m=0.01, turn_noise_rad=0.02, heading_noise_rad=0.01
    )
    return make_p2at(base=base, sensors=(odometry, GROUND_TRUTH))


def make_walled_world(*walls_x_m: float) -> World:
    """Return a world with walls, 0.1 m thick, whose near faces stand at these x > 0."""
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
        StartPlace("Centre", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        StartPlace("Aside", (1.0, -2.0, 0.3), (0.1, 0.2, 1.5)),
    )
    return World("walls", items, starts=starts)


class FakeClient:
    """A control connection that keeps what it is told."""

    def __init__(self) -> None:
        self.batches: list[tuple[Report, ...]] = []
        self.num_rejections = 0

    @property
    def reports(self) -> list[Report]:
        """Return all reports, in order."""
        return [report for batch in self.batches for report in batch]

    def deliver(self, reports: Sequence[Report]) -> None:
        """Keep reports."""
        self.batches.append(tuple(reports))

    def reject_init(self) -> None:
        """Count a refusal."""
        self.num_rejections += 1


class FakeView:
    """A view whose pictures have the number of the exposure in every byte."""

    def __init__(self) -> None:
        self.exposures: list[CameraState] = []
        self.is_closed = False

    def render(self, exposure: CameraState) -> RenderedImage:
        """Return the next picture."""
        self.exposures.append(exposure)
        return RenderedImage(np.full((6, 8, 3), len(self.exposures), dtype=np.uint8), {"fake": 1.0})

    def close(self) -> None:
        """Take note."""
        self.is_closed = True


class FakeViewProvider:
    """Views of which every eye is drawn by one fake view, at the eye's own size if it has one."""

    def __init__(self, view: FakeView | None = None) -> None:
        self.view = view or FakeView()
        self.view_requests: list[ViewRequest] = []

    def render(self, take: ViewRequest) -> RenderedImage:
        """Return the next picture."""
        self.view_requests.append(take)
        image = self.view.render(take.camera_state)
        eye = take.camera.camera if isinstance(take.camera, OmniCameraSpec) else take.camera
        rgb = np.full((eye.height_px, eye.width_px, 3), image.rgb.flat[0], dtype=np.uint8)
        return RenderedImage(rgb, image.stage_ms)

    def plan(self, eye: CameraSpec) -> str:
        """Return a plan that can be printed."""
        return "fake plan"

    def error_bound(self, eye: CameraSpec) -> ErrorBound | None:
        """Return the bound of an omnidirectional eye, traced as it is wished."""
        return self.view_state(eye).choice.bound if isinstance(eye, OmniCameraSpec) else None

    def view_state(self, eye: OmniCameraSpec) -> ViewState:
        """Return how trace draws an eye as it is wished, in 12.5 ms."""
        plan = plan_from_settings(
            eye.render_settings, eye.camera, kind=RendererKind.TRACE, reason="fake"
        )
        return ViewState(PlanChoice(plan, error_bound(eye.camera, plan)), 12.5)

    def close(self) -> None:
        """Close the view."""
        self.view.close()


def render_channel(fleet: Fleet, views: Any = None, channel: Channel = IMAGE_PORT) -> Frame:
    """Return what a channel shows now, drawn at once."""
    scenery = fleet.compose_frame(channel)
    assert scenery is not None
    shot = FrameRequest(channel, 1, 0.0, 0.0, scenery)
    return render_frame(
        shot, views if views is not None else FakeViewProvider(), monotonic=lambda: 0.0
    )
