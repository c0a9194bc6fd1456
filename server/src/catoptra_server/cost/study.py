"""The study itself: what is measured, in which order, with how many frames. Prints nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.progress import Progress

from catoptra_server.config.robot_file import read_robot
from catoptra_server.cost.document import Conditions, Document, FrameRate
from catoptra_server.cost.frame_rates import measure_frame_rates
from catoptra_server.cost.ladder import Step, ladder, quick_ladder
from catoptra_server.cost.polygon_table import polygon_table
from catoptra_server.cost.step_costs import measure_steps
from catoptra_server.cost.stopwatch import WARM_UP_ROUNDS
from catoptra_server.cost.subject import REFERENCE_SAMPLES, Subject, open_subject
from catoptra_server.cost.telling import draw_frames
from catoptra_server.plan.render_plan import RendererKind, RenderWish


@dataclass(frozen=True, slots=True)
class Order:
    """What to measure. worlds: frame rates in all, the rest in the first."""

    robot: Path
    worlds: tuple[Path, ...]
    size_px: int
    is_quick: bool
    output: Path
    date: str
    machine: str

    @property
    def rounds(self) -> int:
        """Return how many frames of each step are timed."""
        return 6 if self.is_quick else 32

    @property
    def poses(self) -> int:
        """Return from how many places pictures are compared."""
        return 2 if self.is_quick else 4

    @property
    def reference_samples(self) -> int:
        """Return the samples of the reference along a pixel's side."""
        return 8 if self.is_quick else REFERENCE_SAMPLES


def measure(order: Order, progress: Progress) -> Document:
    """Return all that was measured; writes the pictures that need frames on the way."""
    with open_subject(
        order.robot, order.worlds[0], size_px=order.size_px, places=order.poses
    ) as subject:
        steps = _steps(subject, order)
        reference = subject.reference(order.reference_samples)
        on_round = _counter(progress, "ladder: rounds", order.rounds)
        drawn = measure_steps(subject, steps, reference, rounds=order.rounds, on_round=on_round)
        draw_frames(subject, drawn, reference[0], order.output)
        conditions = _conditions(order, subject)
        table = polygon_table(subject.camera)
    return Document(
        conditions=conditions,
        steps=tuple(one.cost for one in drawn),
        polygons=table,
        frame_rates=tuple(row for world in order.worlds for row in _rates(order, world, progress)),
    )


def _steps(subject: Subject, order: Order) -> list[Step]:
    """Return the steps that can be drawn here: without OpenGL those of trace alone."""
    own = subject.plan(Step("", RendererKind.RASTER, RenderWish())).face_size_px
    steps = quick_ladder(own) if order.is_quick else ladder(own)
    return [step for step in steps if step.kind in subject.renderers]


def _rates(order: Order, world: Path, progress: Progress) -> list[FrameRate]:
    """Return the frame rates in a world by each renderer."""
    description, _ = read_robot(order.robot)
    rows: list[FrameRate] = []
    with open_subject(order.robot, world, size_px=order.size_px, places=order.poses) as subject:
        for kind in subject.renderers:
            name = f"frame rates: {world.stem}, {kind.value}"
            rounds = 2 * order.rounds
            rows += measure_frame_rates(
                subject,
                description.drive,
                kind,
                rounds=rounds,
                on_round=_counter(progress, name, rounds),
            )
    return rows


def _counter(progress: Progress, name: str, rounds: int) -> Callable[[], None]:
    task = progress.add_task(name, total=WARM_UP_ROUNDS + rounds)
    return partial(progress.advance, task)


def _conditions(order: Order, subject: Subject) -> Conditions:
    return Conditions(
        date=order.date,
        machine=order.machine,
        renderers=tuple(renderer.describe() for renderer in subject.renderers.values()),
        robot=order.robot.stem,
        world=subject.world.name,
        size_px=order.size_px,
        is_quick=order.is_quick,
        rounds=order.rounds,
        poses=order.poses,
        reference_samples=order.reference_samples,
    )
