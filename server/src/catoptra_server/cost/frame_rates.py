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
from catoptra_server.cost.document import FrameRate
from catoptra_server.cost.ladder import COUNTS, Step
from catoptra_server.cost.stopwatch import Draw, Took, in_turns
from catoptra_server.cost.subject import Subject
from catoptra_server.plan.render_plan import PerPixel, RendererKind, RenderWish, Surface
from catoptra_server.random_streams import RandomStream
from catoptra_server.render.renderer import Exposure, View
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.robot.description import DriveBase, RangeScannerDescription
from catoptra_server.robot.mount import Mount
from catoptra_server.scene.mirror_mesh import split_for
from catoptra_server.sensors.range_scanner import RangeScannerSensor
from catoptra_server.sensors.sensor import Moment
from catoptra_server.sensors.sight import Surroundings

NO_CAMERA, SCANNER, EXACT = "no camera", "LMS200", "per pixel"
# The least that UT2004's window came in, at its own field of view.
SCREEN = PerspectiveCamera(640, 480, 0.5 * math.pi)
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
class _Load:
    """What a robot carries, and what a frame of it draws or casts beside the screen."""

    carries: str
    polygons: int
    stage: str
    draw: Callable[[Exposure], object]


def measure_frame_rates(
    subject: Subject,
    drive: DriveBase,
    kind: RendererKind,
    *,
    rounds: int,
    on_round: Callable[[], None],
) -> tuple[FrameRate, ...]:
    """Return a row for each load, drawn by one renderer, in turns."""
    renderer = subject.renderers[kind]
    screen = renderer.prepare_perspective(SCREEN, _SAMPLES)
    cameras = {name: _camera(subject, kind, surface) for name, surface in _surfaces().items()}
    try:
        loads = (*_loads(cameras), _scanner(subject, drive))
        draws = [_whole(screen, load, subject) for load in loads]
        took = in_turns(draws, rounds=rounds, on_round=on_round)
    finally:
        for view in (screen, *cameras.values()):
            view.close()
    rows = zip(loads, took, strict=True)
    return tuple(_row(subject.world.name, kind, load, time) for load, time in rows)


def _surfaces() -> dict[str, Surface]:
    polygons: dict[str, Surface] = {str(count): split_for(count) for count in COUNTS}
    return polygons | {EXACT: PerPixel()}


def _camera(subject: Subject, kind: RendererKind, surface: Surface) -> View:
    return subject.prepare(Step("", kind, RenderWish(surface, _SAMPLES)))


def _loads(cameras: dict[str, View]) -> Iterator[_Load]:
    yield _Load(NO_CAMERA, 0, "camera", lambda exposure: None)
    for name, view in cameras.items():
        yield _Load(name, int(name) if name.isdigit() else 0, "camera", view.draw)


def _scanner(subject: Subject, drive: DriveBase) -> _Load:
    sensor = RangeScannerSensor(_LMS200, drive, RandomStream.of(0, "cost", "LMS200"))
    around = Surroundings(EmbreeRayCaster(subject.scene))

    def scan(exposure: Exposure) -> object:
        return sensor.reading(Moment(0.0, 0, exposure.world_from_mirror, around))

    return _Load(SCANNER, 0, "scanner", scan)


def _whole(screen: View, load: _Load, subject: Subject) -> Draw:
    """Return what draws the screen and the load, and tells how long each took."""
    exposures = subject.exposures

    def draw(number: int) -> dict[str, float]:
        exposure = exposures[number % len(exposures)]
        begin = time.perf_counter()
        screen.draw(exposure)
        middle = time.perf_counter()
        load.draw(exposure)
        end = time.perf_counter()
        return {"screen": 1e3 * (middle - begin), load.stage: 1e3 * (end - middle)}

    return draw


def _row(world: str, kind: RendererKind, load: _Load, took: Took) -> FrameRate:
    return FrameRate(
        world=world,
        renderer=kind.value,
        carries=load.carries,
        polygons=load.polygons,
        fps=1e3 / took.ms,
        ms=took.ms,
        processor_ms=took.processor_ms,
        stage_ms=took.stage_ms,
    )


def spread_over_polygons(rows: tuple[FrameRate, ...], *, least: int) -> float:
    """Return how much more the dearest frame takes than the cheapest, as a share.

    Of processor time, which others on the machine disturb less; among the rows with at least so
    many polygons. Domain: there is one.
    """
    times = [row.processor_ms for row in rows if row.polygons >= least]
    return max(times) / min(times) - 1.0
