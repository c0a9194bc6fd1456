"""Candidates of one camera with their bounds and times, from measured costs of all renderers."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.candidate_plans import generate_candidate_plans
from catoptra_server.planning.cost_cache import CostCache
from catoptra_server.planning.cost_model import (
    CostModel,
    PlanTiming,
    Rates,
    describe_rates,
    fit_cost_model,
    grows_with_quantities,
)
from catoptra_server.planning.error_bound import error_bound
from catoptra_server.planning.plan_choice import PlanOption
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.render.render_settings import MirrorSurface
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.faults import log_fault
from catoptra_server.world.camera_state import CameraState

log = logging.getLogger(__name__)

# Of a renderer whose costs make no sense, beside programs that use the processors.
_MAX_MEASUREMENTS = 3

MeasureCosts = Callable[
    [Renderer, RendererKind, OmniCamera, MirrorSurface, Sequence[CameraState]], list[PlanTiming]
]


@dataclass(frozen=True, slots=True, eq=False)
class CandidateTable:
    """Everything of one camera's candidates that no accuracy target changes."""

    model: CostModel
    options: tuple[PlanOption, ...]
    """All candidates with their bounds, and times that are not corrected yet."""


class RendererCalibration:
    """Measured costs of the renderers of one scene, kept on disk."""

    def __init__(
        self, renderers: RendererPool, cache: CostCache | None, measure: MeasureCosts
    ) -> None:
        """Create a calibration that has measured nothing.

        Args:
            renderers: Renderers to measure.
            cache: Costs that earlier servers measured; None measures anew.
            measure: Measures the calibration plans of a renderer.
        """
        self._renderers = renderers
        self._cache = cache
        self._measure = measure

    def make_table(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> CandidateTable:
        """Measure all renderers for a camera, and bound all its candidates."""
        model, kinds = self._measure_renderers(camera, camera_states)
        plans = generate_candidate_plans(camera.render_settings.surface, camera.camera, kinds)
        options = (
            PlanOption(
                plan,
                error_bound(camera.camera, plan).outline_error_px,
                model.predict_frame_ms(plan),
            )
            for plan in plans
        )
        return CandidateTable(model, tuple(options))

    def _measure_renderers(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> tuple[CostModel, list[RendererKind]]:
        """Costs of all renderers that can be measured, and their kinds."""
        rates: dict[str, Rates] = {}
        measured = []
        # Measured before candidates are listed: a renderer that fails is no candidate.
        for kind in self._renderers.create_all():
            try:
                rates.update(self._find_rates(kind, camera, camera_states))
                measured.append(kind)
            except Exception:
                log_fault(log, "%s failed to render for a measurement and is left out", kind.value)
                self._renderers.renew(kind)
        if not measured:
            raise RendererUnavailableError("no renderer could be measured: see the server's log")
        return CostModel(camera.camera, rates), measured

    def _find_rates(
        self, kind: RendererKind, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> Mapping[str, Rates]:
        renderer, surface = self._renderers.get(kind), camera.render_settings.surface
        key = ""
        if self._cache:
            key = self._cache.make_key(renderer.describe(), camera.camera, surface)
            stored = self._cache.read(key)
            # Files of earlier releases may hold costs that were measured beside other programs.
            if stored is not None and all(map(grows_with_quantities, stored.values())):
                log.info("costs of %s read from the cache", kind.value)
                return stored
        for _ in range(_MAX_MEASUREMENTS):
            timings = self._measure(renderer, kind, camera.camera, surface, camera_states)
            rates = fit_cost_model(camera.camera, timings).rates
            log.info("costs of %s measured: %s", kind.value, describe_rates(rates))
            if all(map(grows_with_quantities, rates.values())):
                if self._cache:
                    self._cache.write(key, rates)
                return rates
        log.warning(
            "costs of %s do not grow with samples: other programs used the processors meanwhile; "
            "they are not stored, and are measured again after the next start",
            kind.value,
        )
        return rates
