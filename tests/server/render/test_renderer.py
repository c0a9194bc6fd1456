"""What needs no renderer: plans and their regions, stages, time samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import (
    FaceCamera,
    FaceRegion,
    FaceWindow,
    RenderPlan,
    RenderSettings,
    StageClock,
    advance,
    sample_shutter,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.trace_engine import camera_states
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import Shutter
from helpers.effect_measurement import DRIVING_STATE
from helpers.motion_reference import camera_state_after, driving_camera_state
from helpers.worlds import make_omni_camera


@pytest.mark.parametrize("face", list(Face))
def test_face_is_a_square_camera_of_90_degrees_turned(face: Face) -> None:
    camera = FaceCamera(face, 64)
    corner, valid = camera.perspective_camera.direction_from_pixel(np.array([64.0, 64.0]))
    assert valid
    np.testing.assert_allclose(corner / corner[0], (1.0, 1.0, 1.0), rtol=1e-15)
    assert np.array_equal(camera.mirror_from_camera, MIRROR_FROM_FACE_ROTATIONS[face])


def test_stages_are_named_in_order_and_each_waits_for_the_device() -> None:
    waits: list[str] = []
    clock = StageClock(lambda: waits.append("finish"))
    clock.end_stage("faces")
    clock.end_stage("mirror")
    assert list(clock.stage_ms) == ["faces", "mirror"]
    assert all(ms >= 0.0 for ms in clock.stage_ms.values())
    assert waits == ["finish", "finish"]


def test_camera_state_without_a_shutter_is_its_only_time_sample() -> None:
    ((sharp_state, weights),) = sample_shutter(DRIVING_STATE, 3)
    assert sharp_state is DRIVING_STATE
    assert weights.tolist() == [1.0, 1.0, 1.0]


def test_time_samples_are_sharp_and_advanced_by_every_motion() -> None:
    lasting = replace(DRIVING_STATE, shutter=Shutter(0.04, 0.0, 3))
    for (sharp_state, _), time_s in zip(
        sample_shutter(lasting, 2), (-0.04 / 3, 0.0, 0.04 / 3), strict=True
    ):
        expected = camera_state_after(DRIVING_STATE, time_s)
        assert sharp_state.shutter is None
        pairs = zip(
            (sharp_state.world_from_mirror, sharp_state.objects[0].world_from_object),
            (expected.world_from_mirror, expected.objects[0].world_from_object),
            strict=True,
        )
        for pose, other in pairs:
            np.testing.assert_allclose(pose.rotation, other.rotation, atol=1e-12)
            np.testing.assert_allclose(pose.translation, other.translation, atol=1e-12)


def test_time_samples_without_weight_in_any_row_are_left_out() -> None:
    # Two rows in a readout of four slots without exposure: the middles of two slots.
    lasting = replace(DRIVING_STATE, shutter=Shutter(0.0, 0.04, 4))
    assert [weights.tolist() for _, weights in sample_shutter(lasting, 2)] == [
        [1.0, 0.0],
        [0.0, 1.0],
    ]


def test_camera_state_advanced_by_no_time_is_unchanged() -> None:
    same = advance(DRIVING_STATE, 0.0)
    np.testing.assert_array_equal(
        same.world_from_mirror.translation, DRIVING_STATE.world_from_mirror.translation
    )


def test_trajectory_without_a_shutter_is_the_camera_state_itself() -> None:
    assert camera_states(DRIVING_STATE) == (DRIVING_STATE,)


def test_trajectory_is_evenly_spaced_from_the_begin_of_an_exposure_to_its_end() -> None:
    # 114 degrees in a second: 4 poses for 0.04 s of exposure and readout.
    turning = driving_camera_state(DRIVING_STATE.world_from_mirror, 0.5, 114.0)
    states = camera_states(replace(turning, shutter=Shutter(0.01, 0.03, 9.0)))
    assert len(states) == 4
    for state, time_s in zip(states, (-0.02, -0.02 / 3, 0.02 / 3, 0.02), strict=True):
        expected = camera_state_after(turning, time_s).world_from_mirror
        np.testing.assert_allclose(state.world_from_mirror.rotation, expected.rotation, atol=1e-12)


def test_trajectory_of_a_minute_of_spinning_has_a_limited_number_of_poses() -> None:
    spinning = driving_camera_state(DRIVING_STATE.world_from_mirror, 0.0, 720.0)
    assert len(camera_states(replace(spinning, shutter=Shutter(60.0, 0.0, 64.0)))) == 257


def test_size_of_a_region_is_window_times_density() -> None:
    region = FaceRegion(Face.N, FaceWindow(top=-0.5), columns_per_unit=100.0, rows_per_unit=50.0)
    assert region.size_texels == (200.0, 75.0)
    assert region.num_texels == 15_000.0


@pytest.mark.parametrize(
    ("window", "is_empty"),
    [
        (FaceWindow(), False),
        (FaceWindow(top=1.0), True),
        (FaceWindow(left=0.2, right=0.2), True),
        (FaceWindow(top=0.999), False),
    ],
)
def test_window_without_area_is_empty(window: FaceWindow, is_empty: bool) -> None:
    assert window.is_empty is is_empty


CAMERA = make_omni_camera(width_px=360)


def make_plan(settings: RenderSettings, kind: RendererKind = RendererKind.RASTER) -> RenderPlan:
    return plan_from_settings(settings, CAMERA, kind=kind, reason="requested")


@pytest.mark.parametrize("samples", [-1, 17])
def test_plan_without_or_with_too_many_samples_is_rejected(samples: int) -> None:
    with pytest.raises(DomainError, match="1 to 16"):
        make_plan(RenderSettings(samples=samples))


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        (
            RenderSettings(samples=1),
            "raster, per pixel, 1^2 samples, faces NESWC of 360 px: requested",
        ),
        (RenderSettings(Tessellation(32, 32)), "raster, 32 x 32 polygons (uv), 2^2 samples"),
    ],
)
def test_plan_when_printed_has_numbers_and_reason(settings: RenderSettings, text: str) -> None:
    assert text in str(make_plan(settings))


def test_plan_of_trace_when_printed_has_no_faces() -> None:
    plan = make_plan(RenderSettings(), RendererKind.TRACE)
    assert str(plan) == "trace, per pixel, 2^2 samples: requested"
