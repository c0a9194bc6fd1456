"""The paper's Figure 10: the frame rate by the payload of a robot, camera or laser scanner.

A frame consists of the perspective view that USARSim shows on its screen, and of the payload: none,
the omnidirectional camera with a mirror mesh or the exact model, or a SICK LMS200 of 181 beams.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.random_sources import RandomSource
from catoptra_server.render.renderer import View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.robot.mount import Mount
from catoptra_server.robot.render_settings import MirrorSurface, PerPixel, RenderSettings
from catoptra_server.robot.robot_description import DriveBase
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.sensors.range_scanner import RangeScannerDescription, RangeScannerSensor
from catoptra_server.sensors.sensor import SensorContext
from catoptra_server.sensors.sensor_environment import SensorEnvironment
from catoptra_studies.camera_figures.render_timing import (
    DrawFunction,
    FrameRate,
    RenderTiming,
    time_round_robin,
)
from catoptra_studies.paper_values import POLYGON_COUNTS
from catoptra_studies.study_subject import StudySubject

NO_CAMERA, SCANNER, PER_PIXEL = "no camera", "LMS200", "per pixel"
# The smallest window of UT2004, at its default field of view.
PERSPECTIVE_VIEW = PerspectiveCamera(640, 480, 0.5 * math.pi)
# The paper's engine does not supersample.
_SAMPLES = 1
# As USARSim's P2AT carries the scanner: robots/p2at.ini.
_LMS200 = RangeScannerDescription(
    name="Scanner1",
    interval_s=0.2,
    mount=Mount((0.1440, 0.0, -0.0918)),
    fov_rad=math.pi,
    resolution_rad=math.radians(1.0),
    min_range_m=0.1,
    max_range_m=20.0,
    noise_m=0.01,
)


@dataclass(frozen=True, slots=True)
class _Payload:
    """Equipment of a robot, rendered beside the perspective view."""

    name: str

    num_polygons: int
    """Polygons of the mirror mesh; 0 without a mesh."""

    stage: str
    """Name of the timed stage: camera or scanner."""

    render: Callable[[CameraState], object]


def measure_frame_rates(
    subject: StudySubject,
    drive: DriveBase,
    renderer_kind: RendererKind,
    *,
    num_rounds: int,
    on_round: Callable[[], None],
) -> tuple[FrameRate, ...]:
    """Measure the frame rate of each payload with one renderer, in turn.

    Args:
        subject: Camera, world and renderers.
        drive: Drive of the robot that carries the scanner.
        renderer_kind: A renderer of the subject.
        num_rounds: Timed frames of each payload.
        on_round: Called after each round over all payloads.
    """
    perspective = subject.renderers[renderer_kind].prepare_perspective(PERSPECTIVE_VIEW, _SAMPLES)
    cameras = {
        name: subject.prepare_view(renderer_kind, RenderSettings(surface, _SAMPLES))
        for name, surface in _surfaces().items()
    }
    try:
        payloads = (*_camera_payloads(cameras), _scanner_payload(subject, drive))
        draw_functions = [_draw_function(perspective, payload, subject) for payload in payloads]
        timings = time_round_robin(draw_functions, num_rounds=num_rounds, on_round=on_round)
    finally:
        for view in (perspective, *cameras.values()):
            view.close()
    return tuple(
        _frame_rate_row(subject.world.name, renderer_kind, payload, timing)
        for payload, timing in zip(payloads, timings, strict=True)
    )


def _surfaces() -> dict[str, MirrorSurface]:
    meshes: dict[str, MirrorSurface] = {
        str(count): tessellation_from_polygon_count(count) for count in POLYGON_COUNTS
    }
    return meshes | {PER_PIXEL: PerPixel()}


def _camera_payloads(cameras: dict[str, View]) -> Iterator[_Payload]:
    # The perspective view alone, to be subtracted from all other payloads.
    yield _Payload(NO_CAMERA, 0, "camera", lambda state: None)
    for name, view in cameras.items():
        yield _Payload(name, int(name) if name.isdigit() else 0, "camera", view.render)


def _scanner_payload(subject: StudySubject, drive: DriveBase) -> _Payload:
    sensor = RangeScannerSensor(_LMS200, drive, RandomSource.from_names(0, "cost", "LMS200"))
    environment = SensorEnvironment(EmbreeRayCaster(subject.scene))

    def scan(state: CameraState) -> object:
        # The mirror's pose stands for the robot's: a scan casts as many rays from any height.
        return sensor.read(SensorContext(0.0, 0, state.world_from_mirror, environment))

    return _Payload(SCANNER, 0, "scanner", scan)


def _draw_function(perspective: View, payload: _Payload, subject: StudySubject) -> DrawFunction:
    """Function that renders one frame and returns the milliseconds of both its parts."""
    states = subject.camera_states

    def draw_frame(round_number: int) -> dict[str, float]:
        state = states[round_number % len(states)]
        begin_s = time.perf_counter()
        perspective.render(state)
        between_s = time.perf_counter()
        payload.render(state)
        end_s = time.perf_counter()
        return {
            "perspective": 1e3 * (between_s - begin_s),
            payload.stage: 1e3 * (end_s - between_s),
        }

    return draw_frame


def _frame_rate_row(
    world: str, renderer_kind: RendererKind, payload: _Payload, timing: RenderTiming
) -> FrameRate:
    return FrameRate(
        world=world,
        renderer=renderer_kind.value,
        payload=payload.name,
        num_polygons=payload.num_polygons,
        fps=1e3 / timing.wall_ms,
        wall_ms=timing.wall_ms,
        cpu_ms=timing.cpu_ms,
        stage_ms=timing.stage_ms,
    )


def frame_time_spread(rows: tuple[FrameRate, ...], *, min_polygons: int) -> float:
    """Relative difference between the slowest and the fastest frame.

    Of processor time, which other programs on the machine disturb less than elapsed time.

    Args:
        rows: Frame rates of one renderer in one world.
        min_polygons: Rows with fewer polygons do not count; at least one row must remain.
    """
    times_ms = [row.cpu_ms for row in rows if row.num_polygons >= min_polygons]
    return max(times_ms) / min(times_ms) - 1.0
