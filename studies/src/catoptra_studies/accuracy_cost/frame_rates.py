"""The paper's Figure 10: what a robot's camera costs a frame of the whole, against a laser scanner.

A frame of the whole is what the server does for one: it draws the ordinary view that USARSim shows
on its screen, and what the robot carries: nothing, the omnidirectional camera with polygon mirrors
or an exact one, or a SICK LMS200 that casts its 181 beams.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.random_sources import RandomSource
from catoptra_server.render.render_plan import MirrorSurface, PerPixel, RendererKind, RenderSettings
from catoptra_server.render.renderer import View
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.robot.mount import Mount
from catoptra_server.robot.robot_description import DriveBase, RangeScannerDescription
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.sensors.range_scanner import RangeScannerSensor
from catoptra_server.sensors.sensor import SensorContext
from catoptra_server.sensors.sensor_environment import SensorEnvironment
from catoptra_studies.accuracy_cost.accuracy_levels import POLYGON_COUNTS, AccuracyLevel
from catoptra_studies.accuracy_cost.cost_results import FrameRate
from catoptra_studies.accuracy_cost.render_timing import (
    DrawFunction,
    RenderTiming,
    time_round_robin,
)
from catoptra_studies.study_subject import StudySubject

NO_CAMERA, SCANNER, PER_PIXEL = "no camera", "LMS200", "per pixel"
# The least that UT2004's window came in, at its own field of view.
PERSPECTIVE_VIEW = PerspectiveCamera(640, 480, 0.5 * math.pi)
# The paper's pictures have no more: it knows no supersampling.
_SAMPLES = 1
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
    """What a robot carries, and what a frame of it draws or casts beside the screen."""

    name: str
    num_polygons: int
    stage: str
    render: Callable[[CameraState], object]


def measure_frame_rates(
    subject: StudySubject,
    drive: DriveBase,
    renderer_kind: RendererKind,
    *,
    num_rounds: int,
    on_round: Callable[[], None],
) -> tuple[FrameRate, ...]:
    """Return a row for each load, drawn by one renderer, in turns."""
    renderer = subject.renderers[renderer_kind]
    screen = renderer.prepare_perspective(PERSPECTIVE_VIEW, _SAMPLES)
    cameras = {
        name: _prepare_camera(subject, renderer_kind, surface)
        for name, surface in _surfaces().items()
    }
    try:
        loads = (*_camera_payloads(cameras), _scanner_payload(subject, drive))
        draws = [_draw_function(screen, load, subject) for load in loads]
        took = time_round_robin(draws, num_rounds=num_rounds, on_round=on_round)
    finally:
        for view in (screen, *cameras.values()):
            view.close()
    rows = zip(loads, took, strict=True)
    return tuple(
        _frame_rate_row(subject.world.name, renderer_kind, load, time) for load, time in rows
    )


def _surfaces() -> dict[str, MirrorSurface]:
    polygons: dict[str, MirrorSurface] = {
        str(count): tessellation_from_polygon_count(count) for count in POLYGON_COUNTS
    }
    return polygons | {PER_PIXEL: PerPixel()}


def _prepare_camera(
    subject: StudySubject, renderer_kind: RendererKind, surface: MirrorSurface
) -> View:
    return subject.prepare_view(AccuracyLevel("", renderer_kind, RenderSettings(surface, _SAMPLES)))


def _camera_payloads(cameras: dict[str, View]) -> Iterator[_Payload]:
    yield _Payload(NO_CAMERA, 0, "camera", lambda exposure: None)
    for name, view in cameras.items():
        yield _Payload(name, int(name) if name.isdigit() else 0, "camera", view.render)


def _scanner_payload(subject: StudySubject, drive: DriveBase) -> _Payload:
    sensor = RangeScannerSensor(_LMS200, drive, RandomSource.from_names(0, "cost", "LMS200"))
    around = SensorEnvironment(EmbreeRayCaster(subject.scene))

    def scan(camera_state: CameraState) -> object:
        return sensor.read(SensorContext(0.0, 0, camera_state.world_from_mirror, around))

    return _Payload(SCANNER, 0, "scanner", scan)


def _draw_function(
    perspective_view: View, payload: _Payload, subject: StudySubject
) -> DrawFunction:
    """Return what draws the screen and the load, and tells how long each took."""
    exposures = subject.camera_states

    def draw_frame(number: int) -> dict[str, float]:
        exposure = exposures[number % len(exposures)]
        begin = time.perf_counter()
        perspective_view.render(exposure)
        middle = time.perf_counter()
        payload.render(exposure)
        end = time.perf_counter()
        return {"screen": 1e3 * (middle - begin), payload.stage: 1e3 * (end - middle)}

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
    """Return how much more the dearest frame takes than the cheapest, as a share.

    Of processor time, which others on the machine disturb less; among the rows with at least so
    many polygons. Domain: there is one.
    """
    times = [row.cpu_ms for row in rows if row.num_polygons >= min_polygons]
    return max(times) / min(times) - 1.0
