"""Prepared views of eyes, on demand: a camera that nobody watches is never prepared.

Robots of one class share a view, and a camera that zooms, or is asked for another accuracy, asks
for another one. What was not drawn for longest is closed first. Where a time budget is broken, or
leaves room for long, the plan is chosen again. Belongs to the thread that made the renderer.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

from catoptra_protocol.optics.frames import Pose
from catoptra_server.effects.decide import NO_EFFECTS, EffectPlan, decide
from catoptra_server.effects.effect import light_is_enough
from catoptra_server.imaging.planning import Planning
from catoptra_server.imaging.shot import Eye, OmniEye, Take
from catoptra_server.plan.budget_watch import BudgetWatch, Verdict
from catoptra_server.plan.error_bound import ErrorBound
from catoptra_server.plan.perspective_plan import PerspectivePlan, plan_perspective
from catoptra_server.plan.planner import PlanChoice
from catoptra_server.plan.render_plan import RenderPlan
from catoptra_server.render.renderer import Exposure, OmniView, RenderedImage, View
from catoptra_server.render.staging import staged

log = logging.getLogger(__name__)

# Clients choose fields of view: without a limit each would leave a view behind. A robot has a few
# cameras; a view of 320 x 240 px at 2 x 2 samples holds some 4 MB.
CAPACITY = 16
# What is measured where nobody says what is seen.
_SOMEWHERE = (Exposure(Pose.identity()),)

Plan = RenderPlan | PerspectivePlan


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """How an eye is drawn, and the median milliseconds of its last frames, None before 30."""

    choice: PlanChoice
    median_ms: float | None


@dataclass(slots=True, eq=False)
class _Prepared:
    """A view and the plan that it follows. choice, effects: of an omnidirectional camera's last
    frame.

    verdict: of its last frames. has_given_up: nothing is faster, and that was said.
    """

    plan: Plan
    view: View
    watch: BudgetWatch
    choice: PlanChoice | None = None
    effects: EffectPlan = NO_EFFECTS
    verdict: Verdict = Verdict.KEPT
    has_given_up: bool = False


@dataclass(slots=True)
class Published:
    """The bounds of what is prepared, by eye; any thread may read them."""

    _bounds: dict[Eye, ErrorBound | None] = field(default_factory=dict)

    def bound(self, eye: Eye) -> ErrorBound | None:
        """Return the bound by which an eye is drawn; None where it is not, or has none."""
        return self._bounds.get(eye)

    def put(self, eye: Eye, bound: ErrorBound | None) -> None:
        """Publish a bound."""
        self._bounds[eye] = bound

    def remove(self, eye: Eye) -> None:
        """Take a bound back."""
        self._bounds.pop(eye, None)


class Views:
    """The views of one scene; closing them frees the renderers, too.

    places: exposures to measure frames from where a dial asks what they cost.
    """

    def __init__(
        self,
        planning: Planning,
        *,
        capacity: int = CAPACITY,
        places: Sequence[Exposure] = _SOMEWHERE,
        published: Published | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._planning = planning
        self._capacity = capacity
        self._places = places
        self._published = published or Published()
        self._clock = clock
        self._prepared: dict[Eye, _Prepared] = {}  # the last drawn at the end

    def __len__(self) -> int:
        """Return how many views are prepared."""
        return len(self._prepared)

    def draw(self, take: Take) -> RenderedImage:
        """Return the picture of a take; its eye is prepared when it is drawn for the first time."""
        prepared = self._used(take.eye)
        if isinstance(take.eye, OmniEye) and prepared.verdict is not Verdict.KEPT:
            self._choose_again(take.eye, prepared)
        if not isinstance(take.eye, OmniEye):
            return prepared.view.draw(take.exposure)
        begin_s = self._clock()
        picture = self._omni_picture(take.eye, take.exposure, prepared)
        self._note(take.eye, prepared, 1e3 * (self._clock() - begin_s))
        return picture

    def _omni_picture(self, eye: OmniEye, exposure: Exposure, prepared: _Prepared) -> RenderedImage:
        """Return the picture with those effects that the exposure calls for."""
        view = cast(OmniView, prepared.view)
        if not eye.effects.wishes:
            return view.draw(exposure)
        plan = self._effects(eye, exposure)
        if prepared.effects is NO_EFFECTS or plan.running != prepared.effects.running:
            log.info("effects:\n%s", plan)
        prepared.effects = plan
        picture = view.draw(staged(exposure, plan), plan.active)
        return replace(picture, effects=plan.decisions)

    def plan(self, eye: Eye) -> Plan:
        """Return how an eye is drawn."""
        return self._used(eye).plan

    def bound(self, eye: Eye) -> ErrorBound | None:
        """Return how far off outlines may be; None of what has no bound: ordinary cameras."""
        choice = self._used(eye).choice
        return choice.bound if choice else None

    def choice(self, eye: OmniEye) -> ViewState:
        """Return how an eye is or would be drawn; it is not prepared for that."""
        prepared = self._prepared.get(eye)
        if prepared is None or prepared.choice is None:
            return ViewState(self._planning.choose(eye, self._places), None)
        return ViewState(prepared.choice, prepared.watch.median_ms)

    def _used(self, eye: Eye) -> _Prepared:
        prepared = self._prepared.pop(eye, None) or self._prepare(eye)
        self._prepared[eye] = prepared
        return prepared

    def _prepare(self, eye: Eye) -> _Prepared:
        while len(self._prepared) >= self._capacity:
            oldest = next(iter(self._prepared))
            self._published.remove(oldest)
            self._prepared.pop(oldest).view.close()
        if isinstance(eye, OmniEye):
            choice = self._planning.choose(eye, self._places)
            watch = BudgetWatch(eye.wish.dial.budget_ms)
            return _Prepared(choice.plan, self._view(eye, choice), watch, choice)
        kind = self._planning.kind
        flat = plan_perspective(0, kind=kind, why=self._planning.why)
        view = self._planning.renderer(kind).prepare_perspective(eye, flat.samples)
        return _Prepared(flat, view, BudgetWatch(0.0))

    def _view(self, eye: OmniEye, choice: PlanChoice) -> View:
        """Return a view by a choice, and say so."""
        camera = eye.camera
        log.info("plan of %d x %d px: %s", camera.width_px, camera.height_px, choice)
        log.info("its outlines: %s", choice.bound or "no bound is known")
        self._published.put(eye, choice.bound)
        return self._planning.renderer(choice.plan.renderer).prepare(camera, choice.plan)

    def _effects(self, eye: OmniEye, exposure: Exposure) -> EffectPlan:
        """Return which effects an exposure calls for."""
        renderer = self._planning.renderer(self._planning.kind)
        if light_is_enough(eye.effects):
            return decide(eye.effects, renderer.light_summary(exposure), eye.camera)
        return decide(eye.effects, renderer.summary(exposure, eye.camera), eye.camera)

    def _note(self, eye: OmniEye, prepared: _Prepared, ms: float) -> None:
        """Take note of a frame's time, and of what it says of the plan."""
        choice, watch = prepared.choice, prepared.watch
        assert choice is not None, "an omnidirectional eye's plan was chosen"
        better = choice.better
        better_ms = self._planning.predicted_ms(eye, better.plan) if better else None
        verdict = watch.note(ms, better_ms=better_ms)
        is_known = verdict is Verdict.BROKEN and prepared.has_given_up
        prepared.verdict = Verdict.KEPT if is_known else verdict
        median_ms = watch.median_ms
        if median_ms is not None and choice.ms is not None:
            self._planning.correct(eye, choice.plan, median_ms)

    def _choose_again(self, eye: OmniEye, prepared: _Prepared) -> None:
        """Follow another plan, if there is one that keeps the budget better than this one."""
        verdict, prepared.verdict = prepared.verdict, Verdict.KEPT
        choice = self._planning.choose(eye, self._places)
        median_ms, budget_ms = prepared.watch.median_ms, eye.wish.dial.budget_ms
        log.info(
            "%.1f ms a frame (median), %g ms asked: %s",
            *(median_ms, budget_ms, "too slow" if verdict is Verdict.BROKEN else "room for more"),
        )
        prepared.watch.replanned(verdict)
        is_same = prepared.plan == replace(choice.plan, reason=prepared.plan.reason)
        prepared.has_given_up = is_same and verdict is Verdict.BROKEN
        if is_same:
            log.info("there is nothing better to do: %s", choice)
            prepared.plan, prepared.choice = choice.plan, choice
            return
        prepared.view.close()
        prepared.view = self._view(eye, choice)
        prepared.plan, prepared.choice = choice.plan, choice

    def close(self) -> None:
        """Free all views, and the renderers."""
        for prepared in self._prepared.values():
            prepared.view.close()
        self._prepared.clear()
        self._planning.close()
