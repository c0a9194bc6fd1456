"""Plans by numbers and by targets, with reasons; sizes of views; limits of long exposures."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MAX_FIVE_FACE_RIM_RAD, Face
from catoptra_protocol.optics.mirrors import HyperbolicMirror, SphericalMirror
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import SceneSummary
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.effects.scene.baked_light import BakedLight
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.faces import max_face_size_px
from catoptra_server.frames.plan.planner import generate_candidate_plans
from catoptra_server.frames.plan.plans import (
    DEFAULT_FACE_SAMPLES,
    DEFAULT_SAMPLES,
    MAX_EXPOSURE_RAYS,
    PerspectivePlan,
    PlanChoice,
    PlanOption,
    choose_by_settings,
    choose_plan,
    explain_limit,
    explain_raster,
    limit_time_samples,
    max_incidence_rad,
    omni_view_size,
    pareto_front,
    perspective_view_size,
    plan_from_settings,
    plan_view_size,
)
from catoptra_server.render.renderer import AccuracyTarget, PerPixel, RenderPlan, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import ViewSize
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState, DynamicObject, Shutter
from helpers.dynamic_objects import ROBOT_MESH, place_cube
from helpers.effect_measurement import make_baked_map
from helpers.mirror_checks import make_camera
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=360)


def plan_raster(
    settings: RenderSettings, *, rim_deg: float = 120.0, width_px: int = 360
) -> RenderPlan:
    camera = make_omni_camera(width_px=width_px, rim_deg=rim_deg)
    return plan_from_settings(settings, camera, kind=RendererKind.RASTER, reason="requested")


def test_plan_by_default_has_a_texel_a_pixel() -> None:
    plan = plan_raster(RenderSettings())
    assert (plan.samples, plan.face_samples) == (DEFAULT_SAMPLES, DEFAULT_FACE_SAMPLES)
    # Square texels would need 1.01 image widths; texels of two densities a little less.
    assert plan.face_size_px == 360
    assert plan.face_size_px == max_face_size_px(plan.face_regions)
    assert plan.faces == (Face.N, Face.E, Face.S, Face.W, Face.C)


def test_plan_takes_explicit_numbers() -> None:
    plan = plan_raster(
        RenderSettings(Tessellation(8, 8), samples=3, face_size_px=100, face_samples=4)
    )
    assert (plan.samples, plan.face_size_px, plan.face_samples) == (3, 100, 4)
    assert plan.surface == Tessellation(8, 8)
    assert {(part.columns_per_unit, part.rows_per_unit) for part in plan.face_regions} == {(50, 50)}


@pytest.mark.parametrize(("rim_deg", "faces"), [(120.0, 5), (125.26, 5), (125.27, 6), (150.0, 6)])
def test_plan_when_the_rim_looks_above_125_deg_has_a_sixth_face(rim_deg: float, faces: int) -> None:
    assert len(plan_raster(RenderSettings(), rim_deg=rim_deg).faces) == faces


def test_incidence_of_an_exact_mirror_ends_at_the_rim() -> None:
    assert max_incidence_rad(CAMERA, PerPixel()) == CAMERA.rim_rad


def test_incidence_of_a_coarse_mesh_is_higher_than_the_rim() -> None:
    four, many = (max_incidence_rad(CAMERA, Tessellation(s, s)) for s in (4, 4096))
    # 90 deg + atan(tan 30 deg / cos 45 deg)
    assert math.degrees(four) == pytest.approx(129.23, abs=0.01)
    assert CAMERA.rim_rad < many < CAMERA.rim_rad + 1e-6
    assert four > MAX_FIVE_FACE_RIM_RAD


def test_incidence_when_the_rim_is_below_the_horizon_is_the_rim() -> None:
    camera = make_omni_camera(rim_deg=80.0)
    assert max_incidence_rad(camera, Tessellation(4, 4)) == camera.rim_rad


SMALL = make_omni_camera(width_px=100)


def test_view_of_settings_has_their_samples_and_the_texels_of_five_faces() -> None:
    settings = RenderSettings(PerPixel(), samples=3, face_size_px=64, face_samples=2)
    size = omni_view_size(SMALL, settings, effect_bytes_per_px=500)
    assert (size.num_pixels, size.samples_per_pixel, size.samples_per_texel) == (10_000, 9, 2)
    # Side faces up to the rim of 120 degrees, 45 degrees of them above the horizon in the corners.
    assert 4 * 64 * 64 < size.num_texels <= 5 * 64 * 64
    assert size.effect_bytes_per_px == 500


def test_view_of_a_trace_plan_has_no_faces() -> None:
    plan = make_plan(SMALL)
    assert plan_view_size(SMALL, plan).num_texels > 0
    assert plan_view_size(SMALL, replace(plan, renderer=RendererKind.TRACE)).num_texels == 0


@pytest.mark.parametrize(("width", "height"), [(320, 240), (1, 1)])
def test_view_of_a_perspective_camera_has_four_samples_a_pixel(width: int, height: int) -> None:
    size = perspective_view_size(PerspectiveCamera(width, height, 1.0))
    assert size == ViewSize(width * height, 4)


def test_rays_of_a_mirror_without_a_viewpoint_have_origins() -> None:
    ball = make_camera(SphericalMirror(0.03, 0.2), 100)
    exact, one = (
        omni_view_size(camera, RenderSettings(), effect_bytes_per_px=0)
        for camera in (ball, replace(ball, is_approximated=True))
    )
    assert exact == replace(one, has_origins=True)
    assert exact.num_bytes > one.num_bytes


def test_plan_when_printed_has_numbers_and_reason() -> None:
    plan = PerspectivePlan(RendererKind.RASTER, 3, "requested")
    assert str(plan) == "raster, 3^2 samples: requested"


@pytest.mark.parametrize("samples", [-1, 17])
def test_plan_with_impossible_samples_is_rejected(samples: int) -> None:
    with pytest.raises(DomainError, match="1 to 16"):
        PerspectivePlan(RendererKind.TRACE, samples, "test")


KINDS = tuple(RendererKind)


class FakeCostPredictor:
    """Costs a sample and a million texels."""

    def __init__(self, *, trace_ms: float = 5.0, raster_ms: float = 5.0) -> None:
        self._trace_ms, self._raster_ms = trace_ms, raster_ms

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        if plan.renderer is RendererKind.TRACE:
            return self._trace_ms * plan.samples**2
        texels = sum(part.num_texels for part in plan.face_regions) * plan.face_samples
        return self._raster_ms * (plan.samples**2 / 4 + 1e-6 * texels)


def make_front(costs: FakeCostPredictor) -> tuple[PlanOption, ...]:
    plans = generate_candidate_plans(PerPixel(), CAMERA, KINDS)
    return pareto_front(
        PlanOption(plan, error_bound(CAMERA, plan).outline_error_px, costs.predict_frame_ms(plan))
        for plan in plans
    )


def choose_for(target: AccuracyTarget, costs: FakeCostPredictor | None = None) -> PlanChoice:
    return choose_plan(CAMERA, make_front(costs or FakeCostPredictor()), target)


def test_pareto_front_rises_in_cost_and_accuracy() -> None:
    steps = make_front(FakeCostPredictor())
    assert len(steps) > 8
    for lower, higher in itertools.pairwise(steps):
        assert lower.predicted_ms < higher.predicted_ms
        assert lower.error_bound_px > higher.error_bound_px


@pytest.mark.parametrize(("tolerance_px", "samples"), [(2.0, 1), (0.5, 2), (0.1, 8)])
def test_reachable_tolerance_takes_the_cheapest_plan_within(
    tolerance_px: float, samples: int
) -> None:
    choice = choose_for(AccuracyTarget(max_error_px=tolerance_px), FakeCostPredictor(raster_ms=1e3))
    assert choice.target_met
    assert choice.bound is not None
    assert choice.bound.outline_error_px <= tolerance_px
    assert (choice.plan.renderer, choice.plan.samples) == (RendererKind.TRACE, samples)
    assert choice.faster is None or choice.faster.error_bound_px > tolerance_px
    assert f"within {tolerance_px:g} px" in choice.plan.reason


def test_unreachable_tolerance_takes_the_most_accurate_plan_and_reports_so() -> None:
    choice = choose_for(AccuracyTarget(max_error_px=0.01))
    assert not choice.target_met
    assert choice.plan.samples == 8
    assert choice.more_accurate is None
    assert choice.plan.reason == "chosen as the most accurate"
    assert choice.excess == (
        "0.01 px is not met: edge 0.0884 of 0.0884 px (8 x 8 samples a pixel: more would help)"
    )
    assert choice.text == f"{choice.plan.description}: {choice.excess}; {choice.plan.reason}"


def test_budget_takes_the_most_accurate_plan_within() -> None:
    choice = choose_for(AccuracyTarget(budget_ms=21.0))
    assert choice.target_met
    assert choice.predicted_ms == 20.0
    assert choice.more_accurate is not None
    assert choice.more_accurate.predicted_ms > 21.0
    assert choice.plan.reason == "chosen as the most accurate within 21 ms"


def test_too_small_budget_takes_the_cheapest_plan_and_reports_so() -> None:
    choice = choose_for(AccuracyTarget(budget_ms=0.1))
    assert not choice.target_met
    assert choice.faster is None
    assert choice.plan.reason.startswith("no plan fits into 0.1 ms: the cheapest takes about ")


def test_tolerance_within_the_budget_is_as_cheap_as_without_a_budget() -> None:
    both, alone = choose_for(AccuracyTarget(0.5, 30.0)), choose_for(AccuracyTarget(0.5))
    assert both.plan.description == alone.plan.description
    assert both.target_met


def test_tolerance_beyond_the_budget_yields_to_the_budget_and_reports_so() -> None:
    choice = choose_for(AccuracyTarget(0.1, 30.0))
    assert not choice.target_met
    assert choice.predicted_ms is not None
    assert choice.predicted_ms <= 30.0
    assert choice.plan.reason == "chosen as the most accurate within 30 ms"
    assert choice.excess.startswith("0.1 px is not met: edge 0.354 of 0.354 px")


@pytest.mark.parametrize(
    ("costs", "kind"),
    [
        (FakeCostPredictor(trace_ms=1.0, raster_ms=100.0), RendererKind.TRACE),
        (FakeCostPredictor(trace_ms=100.0, raster_ms=0.1), RendererKind.RASTER),
    ],
)
def test_choice_takes_the_faster_renderer(costs: FakeCostPredictor, kind: RendererKind) -> None:
    assert choose_for(AccuracyTarget(max_error_px=2.0), costs).plan.renderer is kind


def test_choice_when_printed_has_time_and_neighbours() -> None:
    text = str(choose_for(AccuracyTarget(budget_ms=21.0)))
    assert "about 20.0 ms a frame" in text
    assert "next better trace" in text
    assert "next cheaper " in text


TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def make_spec(k: float, *, width_px: int = 64, **settings: int | str) -> OmniCameraSpec:
    camera = make_omni_camera(mirror=HyperbolicMirror(k, 0.1), width_px=width_px, rim_deg=90.0)
    return OmniCameraSpec(camera, RenderSettings(**settings))  # type: ignore[arg-type]


@pytest.mark.parametrize("k", [2.1, 2.001, 2.00001])
def test_renderer_that_can_show_the_image_is_kept(k: float) -> None:
    choice = choose_by_settings(make_spec(k), RASTER, "test", usable=[TRACE, RASTER])
    assert (choice.plan.renderer, choice.plan.reason) == (RASTER, "test")


def test_mirror_next_to_two_takes_the_renderer_without_faces_and_says_why() -> None:
    choice = choose_by_settings(make_spec(2.0 + 1e-9), RASTER, "test", usable=[TRACE, RASTER])
    assert choice.plan.renderer is TRACE
    assert choice.plan.reason.startswith("the faces of raster would displace this camera's image")
    assert choice.bound is not None
    assert choice.bound.geometric.max_px < 1.0


@pytest.mark.parametrize("usable", [[RASTER], []])
def test_mirror_next_to_two_without_another_renderer_is_an_error(
    usable: list[RendererKind],
) -> None:
    with pytest.raises(DomainError, match="by 50 of 64 px: choose the renderer trace"):
        choose_by_settings(make_spec(2.0 + 1e-9), RASTER, "test", usable=usable)


def test_renderer_that_a_client_requests_is_not_replaced() -> None:
    spec = make_spec(2.0 + 1e-9, renderer="raster")
    with pytest.raises(DomainError, match="choose the renderer trace"):
        choose_by_settings(spec, RASTER, "as requested", usable=[TRACE, RASTER])


def test_faces_of_a_configured_size_are_as_coarse_as_configured() -> None:
    spec = make_spec(2.5, width_px=640, face_size_px=8)
    choice = choose_by_settings(spec, RASTER, "test", usable=[TRACE, RASTER])
    assert choice.plan.renderer is RASTER


LARGE = make_omni_camera(width_px=640)
MOVING = CameraState(Pose.identity(), shutter=Shutter(0.02, 0.0, 1e6))


def plan_large(samples: int) -> RenderPlan:
    settings = RenderSettings(samples=samples)
    return plan_from_settings(settings, LARGE, kind=RendererKind.TRACE, reason="test")


def count_time_samples(state: CameraState, samples: int) -> int:
    limited = limit_time_samples(state, LARGE, plan_large(samples))
    assert limited.shutter is not None
    return limited.shutter.num_time_samples


@pytest.mark.parametrize(("samples", "time_samples"), [(1, 64), (2, 20), (4, 5), (8, 2)])
def test_time_samples_fall_with_the_samples_of_the_plan(samples: int, time_samples: int) -> None:
    assert count_time_samples(MOVING, samples) == time_samples


def test_few_time_samples_are_not_changed() -> None:
    calm = replace(MOVING, shutter=Shutter(0.02, 0.0, 4.0))
    assert count_time_samples(calm, 2) == 4


# Of 20.48 time samples without objects: the rays of a sphere of radius 1 m are those of the cone
# around it, all from within.
@pytest.mark.parametrize(
    ("distance_m", "time_samples"),
    [(50.0, 20), (math.sqrt(2.0), 17), (1.0 + 1e-12, 13), (0.9, 10), (0.0, 10)],
)
def test_near_objects_take_time_samples(distance_m: float, time_samples: int) -> None:
    ball = place_cube(distance_m, 0.0, 0.0, size_m=2.0 / math.sqrt(3.0))
    assert ball.mesh.radius_m == pytest.approx(1.0)
    assert count_time_samples(replace(MOVING, objects=(ball,)), 2) == time_samples


def test_many_far_objects_stay_within_the_budget_by_their_triangles() -> None:
    far = DynamicObject(ROBOT_MESH, Pose.from_rpy((90.0, 0.0, 0.0)))
    count = count_time_samples(replace(MOVING, objects=200 * (far,)), 1)
    pixels = LARGE.width_px * LARGE.height_px
    assert count < MAX_EXPOSURE_RAYS / (pixels + 200 * 20 * len(ROBOT_MESH))
    assert count >= 2


def test_raster_states_the_gloss_that_it_does_not_draw() -> None:
    decisions = tuple(EffectDecision(name, True, 9.0, 1.0, "polished") for name in ("Gloss", "Fog"))
    gloss, fog = explain_raster(decisions, plan_raster(RenderSettings()))
    assert (gloss.enabled, gloss.bound, fog.enabled) == (False, 9.0, True)
    assert gloss.reason == "raster does not draw it, up to the bound; polished"
    traced = plan_from_settings(RenderSettings(), CAMERA, kind=RendererKind.TRACE, reason="")
    assert explain_raster(decisions, traced) is decisions


def test_raster_states_the_shade_that_it_does_not_draw() -> None:
    summary = SceneSummary(1.0, light_bake=make_baked_map((0.2, 0.5, 1.0)), has_bodies=True)
    bound = BakedLight().bound(replace(summary, open_irradiance=(1.0, 1.0, 1.0)), CAMERA)
    decisions = (EffectDecision("BakedLight", True, bound.value, 1.0, bound.reason),)
    (light,) = explain_raster(decisions, plan_raster(RenderSettings()))
    assert light.enabled
    assert light.reason.startswith("raster draws no shade of bodies; light differs")


def test_decisions_name_the_limit_at_the_effects_of_the_shutter() -> None:
    decisions = tuple(
        EffectDecision(name, name != "RollingShutter", 9.0, 0.5, "fast")
        for name in ("RollingShutter", "MotionBlur", "Fog")
    )
    limited = limit_time_samples(MOVING, LARGE, plan_large(2))
    explained = explain_limit(decisions, MOVING, limited)
    assert [one.reason for one in explained] == [
        "fast",
        "fast; 20 of 64 time samples, limited by the budget of a frame",
        "fast",
    ]
    assert explain_limit(decisions, limited, limited) is decisions
    assert explain_limit(decisions, CameraState(Pose.identity()), limited) is decisions
