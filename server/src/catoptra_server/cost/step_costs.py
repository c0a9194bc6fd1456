"""Every step of the ladder: timed in turns, bounded, and held against the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from catoptra_protocol.optics.camera import OmniCamera, direction_from_pixel, pixel_centres
from catoptra_protocol.optics.numerics import Bools
from catoptra_server.cost.document import StepCost
from catoptra_server.cost.image_error import ImageError, image_error
from catoptra_server.cost.ladder import Step, robot_lines
from catoptra_server.cost.pareto import LEAST_GAIN, pareto_front
from catoptra_server.cost.stopwatch import Draw, Took, in_turns
from catoptra_server.cost.subject import Subject
from catoptra_server.plan.error_bound import error_bound
from catoptra_server.plan.render_plan import RenderPlan
from catoptra_server.render.renderer import Image, View
from catoptra_server.scene.mirror_mesh import PolygonSplit


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A step's cost and its first frame, for the pictures."""

    cost: StepCost
    frame: Image


def measure_steps(
    subject: Subject,
    steps: Sequence[Step],
    reference: Sequence[Image],
    *,
    rounds: int,
    on_round: Callable[[], None],
) -> tuple[Drawn, ...]:
    """Return what each step costs and shows; `reference` holds a frame for each exposure."""
    views = [subject.prepare(step) for step in steps]
    try:
        took = in_turns([_draw(view, subject) for view in views], rounds=rounds, on_round=on_round)
        seen = _seen(subject)
        drawn = [
            _drawn(subject, step, view, reference, took=time, seen=seen)
            for step, view, time in zip(steps, views, took, strict=True)
        ]
    finally:
        for view in views:
            view.close()
    return _with_front(drawn)


def _draw(view: View, subject: Subject) -> Draw:
    exposures = subject.exposures
    return lambda number: view.draw(exposures[number % len(exposures)]).stage_ms


def _seen(subject: Subject) -> Bools:
    """Return the (h, w) pixels whose middles the mirror covers: outside nothing can be wrong."""
    _, seen = direction_from_pixel(subject.camera, pixel_centres(subject.camera)[:, :, 0])
    return seen


def _drawn(
    subject: Subject,
    step: Step,
    view: View,
    reference: Sequence[Image],
    *,
    took: Took,
    seen: Bools,
) -> Drawn:
    frames = [view.draw(exposure).rgb for exposure in subject.exposures]
    error = image_error(list(zip(frames, reference, strict=True)), seen)
    cost = _cost(subject.camera, step, subject.plan(step), took=took, error=error)
    return Drawn(cost, frames[0])


def _cost(
    camera: OmniCamera, step: Step, plan: RenderPlan, *, took: Took, error: ImageError
) -> StepCost:
    bound = error_bound(camera, plan).geometric
    return StepCost(
        name=step.name,
        renderer=step.kind.value,
        polygons=plan.surface.polygons if isinstance(plan.surface, PolygonSplit) else 0,
        samples=plan.samples,
        face_size_px=plan.face_size_px,
        is_key=step.is_key,
        robot_lines=robot_lines(step, camera.width_px),
        ms=took.ms,
        processor_ms=took.processor_ms,
        stage_ms=took.stage_ms,
        bound_max_px=bound.max_px,
        bound_rms_px=bound.rms_px,
        bound_max_deg=bound.max_deg,
        rmse=error.rmse,
        psnr_db=error.psnr_db,
        ssim=error.ssim,
        is_on_front=False,
    )


def _with_front(drawn: Sequence[Drawn]) -> tuple[Drawn, ...]:
    """Mark the steps that no other beats in time and image error at once."""
    front = pareto_front([(one.cost.ms, one.cost.rmse) for one in drawn], least_gain=LEAST_GAIN)
    return tuple(
        replace(one, cost=replace(one.cost, is_on_front=index in front))
        for index, one in enumerate(drawn)
    )
