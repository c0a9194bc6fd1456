from __future__ import annotations

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.frames.plan.plans import DEFAULT_SAMPLES, plan_perspective_view
from catoptra_server.render.renderer_kind import RendererKind


@pytest.mark.parametrize(("requested", "samples"), [(0, DEFAULT_SAMPLES), (1, 1), (5, 5)])
def test_plan_takes_the_requested_samples_or_the_default(requested: int, samples: int) -> None:
    assert (
        plan_perspective_view(requested, kind=RendererKind.TRACE, reason="test").samples == samples
    )


def test_plan_when_printed_has_numbers_and_reason() -> None:
    plan = plan_perspective_view(3, kind=RendererKind.RASTER, reason="requested")
    assert str(plan) == "raster, 3^2 samples: requested"


@pytest.mark.parametrize("samples", [-1, 17])
def test_plan_with_impossible_samples_is_rejected(samples: int) -> None:
    with pytest.raises(DomainError, match="1 to 16"):
        plan_perspective_view(samples, kind=RendererKind.TRACE, reason="test")
