"""How an eye is drawn: by its numbers, or by what its dial and measured costs say.

Nothing is measured before somebody turns a dial. Then every renderer that could draw is measured
for this camera, once: the rates are kept on disk. While frames are drawn their real times correct
the prediction by a factor a renderer. Belongs to the thread that made the renderers.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.plan.candidates import candidates
from catoptra_server.plan.cost_model import CostModel, Measured, Rates, fitted
from catoptra_server.plan.error_bound import ErrorBound, error_bound
from catoptra_server.plan.planner import PlanChoice, choose, ladder
from catoptra_server.plan.render_plan import RendererKind, RenderPlan, plan_from_wish
from catoptra_server.render.calibration import measured
from catoptra_server.render.choice import Choice
from catoptra_server.render.cost_cache import CostCache
from catoptra_server.render.renderer import Exposure, Renderer
from catoptra_server.robot.render_wish import Surface

log = logging.getLogger(__name__)

Measure = Callable[
    [Renderer, RendererKind, OmniCamera, Surface, Sequence[Exposure]], list[Measured]
]
# Frames are a few times slower or faster than was measured, not more: else something else happened.
_LARGEST_FACTOR = 10.0


class Planning:
    """The renderers that could draw a scene, and what their frames cost."""

    def __init__(
        self, choice: Choice, cache: CostCache | None = None, *, measure: Measure = measured
    ) -> None:
        self._choice = choice
        self._renderers: dict[RendererKind, Renderer] = {choice.kind: choice.renderer}
        self._others = dict(choice.others)
        self._cache = cache
        self._measure = measure
        self._models: dict[tuple[OmniCamera, Surface], CostModel] = {}
        self._factors: dict[RendererKind, float] = {}

    @property
    def kind(self) -> RendererKind:
        """Return the kind of renderer that draws where nothing says otherwise."""
        return self._choice.kind

    @property
    def why(self) -> str:
        """Return why that one was taken."""
        return self._choice.reason

    def renderer(self, kind: RendererKind) -> Renderer:
        """Return a renderer of a kind, made now if it was not needed before."""
        if kind not in self._renderers:
            self._renderers[kind] = self._others[kind]()
            log.info("%s", self._renderers[kind].describe())
        return self._renderers[kind]

    def choose(self, eye: OmniEye, exposures: Sequence[Exposure]) -> PlanChoice:
        """Return how to draw an eye; `exposures` are what is measured if a dial asks for it."""
        plan = plan_from_wish(eye.wish, eye.camera, kind=self.kind, why=self.why)
        bound = _bound_or_none(eye.camera, plan)
        if not eye.wish.dial.is_set:
            return PlanChoice(plan, bound)
        if bound is None:
            why = f"no dial can be kept where an error has no bound; {self.why}"
            return PlanChoice(replace(plan, reason=why), None, keeps_word=False)
        model = self._model(eye, exposures)
        kinds = [kind for kind in RendererKind if kind in self._renderers]
        steps = ladder(
            eye.camera, candidates(eye.wish.surface, eye.camera, kinds), _Costs(self, model)
        )
        return choose(eye.camera, steps, eye.wish.dial)

    def predicted_ms(self, eye: OmniEye, plan: RenderPlan) -> float | None:
        """Return what a plan is expected to cost now; None where its costs were never measured."""
        model = self._models.get(_key(eye))
        return _Costs(self, model).ms(plan) if model else None

    def factor(self, kind: RendererKind) -> float:
        """Return by how much frames take longer than was measured."""
        return self._factors.get(kind, 1.0)

    def correct(self, eye: OmniEye, plan: RenderPlan, median_ms: float) -> None:
        """Take note of what frames really take."""
        model = self._models.get(_key(eye))
        if model is not None:
            factor = median_ms / model.ms(plan)
            self._factors[plan.renderer] = min(max(factor, 1.0 / _LARGEST_FACTOR), _LARGEST_FACTOR)

    def _model(self, eye: OmniEye, exposures: Sequence[Exposure]) -> CostModel:
        key = _key(eye)
        if key not in self._models:
            self._make_others()
            rates: dict[str, Rates] = {}
            for kind, renderer in self._renderers.items():
                rates.update(self._rates(kind, renderer, eye, exposures))
            self._models[key] = CostModel(eye.camera, rates)
        return self._models[key]

    def _make_others(self) -> None:
        """Make what else could draw; what cannot be had after all is no choice."""
        for kind in list(self._others):
            try:
                self.renderer(kind)
            except RendererUnavailableError as error:
                del self._others[kind]
                log.info("%s is no choice: %s", kind.value, error)

    def _rates(
        self,
        kind: RendererKind,
        renderer: Renderer,
        eye: OmniEye,
        exposures: Sequence[Exposure],
    ) -> Mapping[str, Rates]:
        key = (
            self._cache.key(renderer.describe(), eye.camera, eye.wish.surface)
            if self._cache
            else ""
        )
        kept = self._cache.read(key) if self._cache else None
        if kept is not None:
            log.info("costs of %s are known from before", kind.value)
            return kept
        rates = fitted(
            eye.camera, self._measure(renderer, kind, eye.camera, eye.wish.surface, exposures)
        ).rates
        log.info("costs of %s measured: %s", kind.value, rates)
        if self._cache:
            self._cache.write(key, rates)
        return rates

    def close(self) -> None:
        """Free all renderers."""
        for renderer in self._renderers.values():
            renderer.close()


class _Costs:
    """The costs of one camera, corrected by what frames really took."""

    def __init__(self, planning: Planning, model: CostModel) -> None:
        self._planning = planning
        self._model = model

    def ms(self, plan: RenderPlan) -> float:
        return self._model.ms(plan) * self._planning.factor(plan.renderer)


def _key(eye: OmniEye) -> tuple[OmniCamera, Surface]:
    """Return what rates depend on."""
    return eye.camera, eye.wish.surface


def _bound_or_none(camera: OmniCamera, plan: RenderPlan) -> ErrorBound | None:
    try:
        return error_bound(camera, plan)
    except DomainError as error:
        log.info("the error of this plan has no bound: %s", error)
        return None
