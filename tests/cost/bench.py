"""Frames per second, rendered and delivered over TCP, in both worlds and by both renderers.

Run: make bench. Prints medians and writes out/bench/bench.json. The robot moves in every row, so
that no frame is rendered twice. Machines are noisy: compare rows of one run.
"""

from __future__ import annotations

import json
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.robot_client import RobotClient
from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.effects import Threshold
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import RendererChoice, choose_renderer
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.simulation.robot_bodies import build_ego_mesh
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_studies.accuracy_cost.cost_command import describe_machine

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "configs/robots/p2at_omni.ini"
WORLDS = {"field": "four_legged_2006.ini", "corridor": "corridor.ini"}
SIZES = (360, 640)
SAMPLES = (1, 2)
WARM_UP_S = 0.8  # software OpenGL has no steady frame time before
MEASURED_S = 3.0


@dataclass(frozen=True, slots=True)
class FrameRateRow:
    """One line of the table. fps_alone: `View.render` in a loop; the others: over TCP, RAW."""

    world: str
    size_px: int
    samples: int
    renderer: str
    fps_alone: float
    fps_rendered: float
    fps_delivered: float

    @property
    def delivered_fraction(self) -> float:
        """Delivered over rendered frames."""
        return self.fps_delivered / self.fps_rendered if self.fps_rendered else 0.0


def main() -> int:
    """Measure every combination that this machine can render."""
    console = Console()
    rows = []
    for world, file in WORLDS.items():
        for size in SIZES:
            for samples in SAMPLES:
                for renderer in ("trace", "raster"):
                    row = _measure(world, ROOT / "configs/worlds" / file, size, samples, renderer)
                    if row is not None:
                        rows.append(row)
                        console.print(_format_row(row), highlight=False)
    console.print(_make_table(rows))
    _print_detection_time(console)
    output = ROOT / "out/bench"
    output.mkdir(parents=True, exist_ok=True)
    document = {"machine": describe_machine(), "rows": [asdict(row) for row in rows]}
    (output / "bench.json").write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    return 0


def _measure(world: str, path: Path, size: int, samples: int, renderer: str) -> FrameRateRow | None:
    """A row of the table; None where the renderer cannot run."""
    with _write_robot_file(size, samples) as robot:
        setup = read_startup_config([robot], path)
        try:
            choice = choose_renderer(renderer, setup.scene, setup.world)
        except CatoptraError:
            return None
        try:
            alone = _measure_fps_alone(setup, choice)
        finally:
            choice.renderer.close()
        rendered, delivered = _measure_fps_over_tcp(robot, path, renderer)
    return FrameRateRow(world, size, samples, renderer, alone, rendered, delivered)


@contextmanager
def _write_robot_file(size: int, samples: int) -> Iterator[Path]:
    """The bundled robot's file with another resolution."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.ini"
        path.write_text(
            f"[Configuration]\nBasedOn={ROBOT}\n[Catoptra.OmniCaptureCamera]\n"
            f"ResolutionX={size}\nResolutionY={size}\nSamples={samples}\n"
        )
        yield path


def _measure_fps_alone(setup: StartupConfig, choice: RendererChoice) -> float:
    """Frames per second of the median frame time, of the frames that a server would draw."""
    robot = setup.robots[0]
    omni, body = robot.mirror_camera, build_ego_mesh(robot)
    assert omni is not None, "the bench's robot has a mirror"
    assert body is not None, "the mirror shows the robot"
    thresholds = {SelfView.name: Threshold(omni.effects.max_change)}
    settings: RenderSettings = replace(omni.render_settings)
    plan = plan_from_settings(settings, omni.camera, kind=choice.kind, reason="bench")
    view = choice.renderer.prepare(omni.camera, plan)
    times: list[float] = []
    begin = time.perf_counter()
    while (now := time.perf_counter()) < begin + WARM_UP_S + MEASURED_S:
        turned = PlanarPose(0.0, 0.0, now - begin).at_height(robot.drive.ride_height_m)
        state = CameraState(turned @ omni.robot_from_mirror, (DynamicObject(body, turned),))
        view.render(state, (), thresholds)
        if now > begin + WARM_UP_S:
            times.append(time.perf_counter() - now)
    view.close()
    return 1.0 / statistics.median(times)


def _measure_fps_over_tcp(robot: Path, world: Path, renderer: str) -> tuple[float, float]:
    """Rendered and delivered frames per second of a server process with one RAW viewer."""
    command = [
        sys.executable,
        "-m",
        "catoptra_server",
        "--robot",
        str(robot),
        "--world",
        str(world),
    ]
    command += ["--control-port", "0", "--image-port", "0", "--image-type", "RAW"]
    command += ["--renderer", renderer]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        ports = re.findall(r":(\d+)", process.stdout.readline())
        delivered, elapsed_s = _measure_delivery(int(ports[0]), int(ports[1]))
        process.terminate()
        _, log = process.communicate()
    rendered = re.search(r"(\d+) frames captured in", log)
    assert rendered is not None, log
    # Both counts include the warm-up.
    return int(rendered[1]) / elapsed_s, delivered / elapsed_s


def _measure_delivery(control_port: int, image_port: int) -> tuple[int, float]:
    """Number of received frames, and the seconds, while the robot turns."""
    with (
        RobotClient.connect(port=control_port) as robot,
        ImageClient.connect(port=image_port) as images,
    ):
        robot.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
        robot.drive(0.5, -0.5)
        count, begin = 0, time.perf_counter()
        for _ in images.iter_frames():
            count += 1
            elapsed_s = time.perf_counter() - begin
            if elapsed_s > WARM_UP_S + MEASURED_S:
                return count, elapsed_s
    raise AssertionError("frames() does not end")


def _print_detection_time(console: Console) -> None:
    """Print the time of a frame at the client."""
    script = ROOT / "tests/measurements/detection_time.py"
    found = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True
    )
    console.print(found.stdout, highlight=False)


def _format_row(row: FrameRateRow) -> str:
    return (
        f"{row.world:9} {row.size_px} px {row.samples}^2 {row.renderer:6} "
        f"alone {row.fps_alone:6.1f}  rendered {row.fps_rendered:6.1f}  "
        f"delivered {row.fps_delivered:6.1f} fps ({row.delivered_fraction:.1%})"
    )


def _make_table(rows: list[FrameRateRow]) -> Table:
    table = Table(title=f"frames per second, {describe_machine()}")
    for head in ("world", "picture", "samples", "renderer", "alone", "over TCP", "delivered"):
        table.add_column(head, justify="left" if head in ("world", "renderer") else "right")
    for row in rows:
        table.add_row(
            row.world,
            f"{row.size_px} x {row.size_px}",
            f"{row.samples} x {row.samples}",
            row.renderer,
            f"{row.fps_alone:.1f}",
            f"{row.fps_rendered:.1f}",
            f"{row.delivered_fraction:.1%}",
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
