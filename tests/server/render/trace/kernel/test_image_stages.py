"""Stages are made of an effect's numbers and maps, once a camera."""

from __future__ import annotations

import pytest

from catoptra_server.render.trace.kernel.image import STAGE_MAKERS, make_stage
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, make_effect


@pytest.mark.parametrize("name", STAGE_MAKERS)
def test_maps_of_a_camera_are_made_once(name: str) -> None:
    one, other = (make_stage(make_effect(name), CAMERA, CAPTURE_CONTEXT, None) for _ in range(2))
    assert one is not None
    assert other is not None
    assert list(one.struct.maps) == list(other.struct.maps)


def test_threshold_is_the_stages_and_none_draws_everywhere() -> None:
    effect = make_effect("Vignetting")
    for threshold, expected in ((None, -1.0), (0.0, 0.0), (0.5, 0.5)):
        stage = make_stage(effect, CAMERA, CAPTURE_CONTEXT, threshold)
        assert stage is not None
        assert stage.struct.threshold == expected


def test_effect_without_native_code_has_no_stage() -> None:
    class Unknown:
        name = "Unknown"

    assert make_stage(Unknown(), CAMERA, CAPTURE_CONTEXT, None) is None  # type: ignore[arg-type]
