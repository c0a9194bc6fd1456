"""The paper's Figure 10: the frame rate by the payload of a robot, camera or laser scanner.

A frame consists of the perspective view on USARSim's screen, and of the payload: none,
the omnidirectional camera with a mirror mesh or the exact model, or a SICK LMS200 of 181 beams.
Frames are timed in turn, so that a disturbance of the machine falls on all payloads alike.
"""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.render.renderer import MirrorSurface, PerPixel, RenderSettings, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import SensorContext, SensorEnvironment
from catoptra_server.simulation.sensors.range_scanner import (
    RangeScannerDescription,
    RangeScannerSensor,
)
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.world.objects import CameraState
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, POLYGON_COUNTS
from catoptra_studies.plot_style import BLUE, MUTED, TEAL, Axes, Page, add_axes, add_legend
from catoptra_studies.study_subject import StudySubject

# The first frames fill caches, raise the processor's clock and start software OpenGL's threads.
NUM_WARM_UP_ROUNDS = 3

# Render one frame of the given round and return the milliseconds of its stages.
DrawFunction = Callable[[int], Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class RenderTiming:
    """Time of one frame, in milliseconds; of several frames the medians."""

    wall_ms: float
    """Elapsed time."""

    cpu_ms: float
    """Time of all threads together: comparable even where other programs use the machine."""

    stage_ms: dict[str, float]
    """Elapsed time of each stage by name."""


@dataclass(frozen=True, slots=True)
class FrameRate:
    """One bar of the paper's Figure 10."""

    world: str
    renderer: str

    conditions: str
    """Date, and load of the machine by other programs while this world was measured."""

    payload: str
    """Equipment of the robot: no camera, a mesh by the number of polygons, per pixel, or LMS200."""

    num_polygons: int
    """Polygons of the camera's mirror; 0 without a mesh."""

    fps: float
    wall_ms: float
    cpu_ms: float
    stage_ms: dict[str, float]


def time_round_robin(
    draw_functions: Sequence[DrawFunction], *, num_rounds: int, on_round: Callable[[], None]
) -> tuple[RenderTiming, ...]:
    """Time several functions in turn.

    Args:
        draw_functions: Functions to time; each is called once in every round.
        num_rounds: Rounds that count, after NUM_WARM_UP_ROUNDS others.
        on_round: Called after every round.

    Returns:
        The medians of each function.
    """
    timings: list[list[RenderTiming]] = [[] for _ in draw_functions]
    for number in range(NUM_WARM_UP_ROUNDS + num_rounds):
        # Interleaved, not one function after the other: a processor slows down as it gets warm.
        for index, draw in enumerate(draw_functions):
            timing = _time_once(draw, number)
            if number >= NUM_WARM_UP_ROUNDS:
                timings[index].append(timing)
        on_round()
    return tuple(_median_timing(rows) for rows in timings)


def _time_once(draw: DrawFunction, round_number: int) -> RenderTiming:
    # process_time counts all threads, the kernel's and llvmpipe's included.
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    stage_ms = dict(draw(round_number))
    return RenderTiming(
        1e3 * (time.perf_counter() - wall_s), 1e3 * (time.process_time() - cpu_s), stage_ms
    )


def _median_timing(timings: Sequence[RenderTiming]) -> RenderTiming:
    # A mean would count every interruption of the process; the median ignores up to a half.
    return RenderTiming(
        wall_ms=statistics.median(timing.wall_ms for timing in timings),
        cpu_ms=statistics.median(timing.cpu_ms for timing in timings),
        stage_ms={
            name: statistics.median(timing.stage_ms[name] for timing in timings)
            for name in timings[0].stage_ms
        },
    )


NO_CAMERA, SCANNER, _PER_PIXEL = "no camera", "LMS200", "per pixel"
# The smallest window of UT2004, at the default field of view.
_PERSPECTIVE_VIEW = PerspectiveCamera(640, 480, 0.5 * math.pi)
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
    """Equipment of a robot, rendered after the perspective view."""

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
    with ExitStack() as stack:

        def keep(view: View) -> View:
            return stack.enter_context(closing(view))

        renderer = subject.renderers[renderer_kind]
        perspective = keep(renderer.prepare_perspective(_PERSPECTIVE_VIEW, _SAMPLES))
        cameras = {
            name: keep(subject.prepare_view(renderer_kind, RenderSettings(surface, _SAMPLES)))
            for name, surface in _surfaces().items()
        }
        payloads = (*_camera_payloads(cameras), _scanner_payload(subject, drive))
        draw_functions = [_draw_function(perspective, payload, subject) for payload in payloads]
        with _measure_load() as load:
            timings = time_round_robin(draw_functions, num_rounds=num_rounds, on_round=on_round)
    return tuple(
        FrameRate(
            world=subject.world.name,
            renderer=renderer_kind.value,
            conditions=f"{time.strftime('%Y-%m-%d')}, {load[0]}",
            payload=payload.name,
            num_polygons=payload.num_polygons,
            fps=1e3 / timing.wall_ms,
            **asdict(timing),
        )
        for payload, timing in zip(payloads, timings, strict=True)
    )


@contextmanager
def _measure_load() -> Iterator[list[str]]:
    """Yield a list that gets what other programs used while the block ran.

    Not the load average: that one counts what this program did in the minutes before.
    """
    load: list[str] = []
    begin = _busy_s(), time.process_time(), time.perf_counter()
    yield load
    busy_s, own_s, wall_s = (
        end - start
        for end, start in zip(
            (_busy_s(), time.process_time(), time.perf_counter()), begin, strict=True
        )
    )
    others = f"{max(0.0, busy_s - own_s) / wall_s:.1f}" if math.isfinite(busy_s) else "unknown"
    load.append(f"load by others: {others} of {os.cpu_count()} processors")


def _busy_s() -> float:
    """Processor time of all programs since the start of the machine; nan where Linux is not."""
    try:
        first, *_ = Path("/proc/stat").read_text(encoding="ascii").splitlines()
    except OSError:
        return math.nan
    user, nice, system, _idle, _wait, *interrupts = map(int, first.split()[1:8])
    return (user + nice + system + sum(interrupts)) / os.sysconf("SC_CLK_TCK")


def _surfaces() -> dict[str, MirrorSurface]:
    meshes: dict[str, MirrorSurface] = {
        str(count): tessellation_from_polygon_count(count) for count in POLYGON_COUNTS
    }
    return meshes | {_PER_PIXEL: PerPixel()}


def _camera_payloads(cameras: dict[str, View]) -> Iterator[_Payload]:
    # The perspective view alone, to be subtracted from all other payloads.
    yield _Payload(NO_CAMERA, 0, "camera", lambda state: None)
    for name, view in cameras.items():
        yield _Payload(name, int(name) if name.isdigit() else 0, "camera", view.render)


def _scanner_payload(subject: StudySubject, drive: DriveBase) -> _Payload:
    sensor = RangeScannerSensor(_LMS200, drive, RandomSource.from_names(0, "cost", "LMS200"))
    environment = SensorEnvironment(commit_ray_caster(subject.scene))

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


def frame_time_spread(rows: tuple[FrameRate, ...], *, min_polygons: int) -> float:
    """Relative difference between the slowest and the fastest frame.

    Of processor time, which other programs on the machine disturb less than elapsed time.

    Args:
        rows: Frame rates of one renderer in one world.
        min_polygons: Rows with fewer polygons do not count; at least one row must remain.
    """
    times_ms = [row.cpu_ms for row in rows if row.num_polygons >= min_polygons]
    return max(times_ms) / min(times_ms) - 1.0


_RENDERER_COLOURS = {"trace": BLUE, "raster": TEAL}


def draw_frame_rates(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Measure and draw the frame rates of all payloads in both worlds, with trace."""
    rows = [
        row
        for subject in (inputs.subject, inputs.rooms)
        for row in measure_frame_rates(
            subject,
            inputs.drive,
            RendererKind.TRACE,
            num_rounds=inputs.num_timed_frames,
            on_round=lambda: None,
        )
    ]
    draw_frame_rate_panels(page, rows)
    return _caption(rows, inputs.num_timed_frames)


def draw_frame_rate_panels(page: Page, rows: Sequence[FrameRate]) -> None:
    """Draw a panel for each world, with one bar for each payload and renderer."""
    worlds = list(dict.fromkeys(row.world for row in rows))
    max_fps = max(row.fps for row in rows)
    width = (1400 - 60 * (len(worlds) - 1)) // len(worlds)
    for index, world in enumerate(worlds):
        axes = add_axes(page, 90 + index * (width + 60), 120, width, 415)
        _draw_panel(axes, [row for row in rows if row.world == world], world)
        # One scale for all worlds; only the first panel has numbers.
        axes.set_ylim(0.0, 1.12 * max_fps)
        axes.tick_params(labelleft=index == 0)
    add_legend(page, axes, loc="lower right", ncols=2)


def group_conditions(pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Names, joined by commas, of the measurements under each of some conditions."""
    grouped: dict[str, dict[str, None]] = {}
    for conditions, name in pairs:
        grouped.setdefault(conditions, {})[name] = None
    return {conditions: ", ".join(names) for conditions, names in grouped.items()}


def _draw_panel(axes: Axes, rows: Sequence[FrameRate], world: str) -> None:
    payloads = list(dict.fromkeys(row.payload for row in rows))
    renderers = list(dict.fromkeys(row.renderer for row in rows))
    width = 0.8 / len(renderers)
    for index, renderer in enumerate(renderers):
        bars = [row for row in rows if row.renderer == renderer]
        centres = [payloads.index(row.payload) + (index + 0.5) * width - 0.4 for row in bars]
        artists = axes.bar(
            centres, [row.fps for row in bars], 0.94 * width, color=_RENDERER_COLOURS[renderer],
            label=renderer,
        )  # fmt: skip
        axes.bar_label(artists, fmt="%.0f", fontsize=6, padding=1.5, color=MUTED)
    by_conditions = group_conditions((row.conditions, row.renderer) for row in rows)
    conditions = "\n".join(f"{names}: {stated}" for stated, names in by_conditions.items())
    axes.set_title(f"frames a second in {world}\n{conditions}", loc="left", fontsize=7)
    axes.set_xticks(
        range(len(payloads)), [name.replace(" ", "\n") for name in payloads], fontsize=7
    )
    axes.grid(visible=False, axis="x")
    # The label is centred under the payloads that are numbers of polygons.
    numbers = [position for position, payload in enumerate(payloads) if payload.isdigit()]
    centre = (sum(numbers) / len(numbers) + 0.5) / len(payloads)
    axes.set_xlabel("polygons of the camera's mirror", fontsize=7.5, labelpad=2, x=centre)


def _caption(rows: Sequence[FrameRate], num_frames: int) -> FigureCaption:
    spread = max(
        frame_time_spread(
            tuple(row for row in rows if row.world == world), min_polygons=PAPER_POLYGON_COUNTS[0]
        )
        for world in {row.world for row in rows}
    )
    view = _PERSPECTIVE_VIEW
    return FigureCaption(
        title="Frame rate by the payload of a robot",
        caption=(
            f"A perspective view of {view.width_px} × {view.height_px} pixels, as USARSim shows on "
            "its screen, rendered with nothing else, with the mirror camera through meshes or by "
            "the exact model (per pixel), or with a laser scanner LMS200. Medians of "
            f"{num_frames} frames on this machine, by the renderer trace on its processor; the "
            "load by other programs is above each panel, and lowers the bars. The paper measured "
            "in two maps, the soccer field and DM-Mapping_250. The latter is not available here: "
            "the second panel shows a map of corridors and rooms that was written for this figure. "
            "The paper found no influence of the number of polygons; here the slowest mesh takes "
            f"at most {100 * spread:.0f} % more processor time than the fastest."
        ),
        alt="Bars of frames a second: highest without a camera, and similar for all meshes.",
        metrics={"width_px": view.width_px, "height_px": view.height_px, "frames": num_frames},
        timings={f"{row.world}: {row.payload}": round(row.fps, 1) for row in rows},
    )
