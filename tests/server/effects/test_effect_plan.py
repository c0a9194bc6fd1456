"""Decisions on effects: by criterion, by setting, by the frame, each with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar, cast

import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import (
    EFFECT_TYPES,
    NO_EFFECT_SETTINGS,
    NO_SPILL,
    NUM_RINGS,
    UNCHANGED,
    DecisionBasis,
    Effect,
    EffectBound,
    EffectChange,
    EffectMode,
    EffectSetting,
    EffectSettings,
    Gains,
    SceneSummary,
    ShadowLoss,
    Threshold,
    summary_fields,
)
from catoptra_server.effects.effect_plan import (
    NO_EFFECTS,
    EffectPlan,
    apply_scene_effects,
    describe_changes,
    format_decisions,
    plan_effects,
)
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.effects.scene.shadows import Shadows
from catoptra_server.effects.sensor.blooming import Blooming
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.world.objects import CameraState, scene_twist_in_mirror
from catoptra_server.world.world_description import AT_REST, Twist
from helpers.effect_measurement import (
    CAMERA,
    DRIVING_STATE,
    DYNAMIC_OBJECT,
    make_any_effect,
    make_baked_map,
)

DAYLIGHT = SceneSummary(1.0)
FINE, COARSE = Quantisation(12), Quantisation(8)


def make_settings(*pairs: tuple[object, EffectMode], threshold: float = 0.5) -> EffectSettings:
    # Any share of the pixels: the largest change alone decides.
    return EffectSettings(tuple(EffectSetting(*pair) for pair in pairs), threshold, 1.0)  # type: ignore[arg-type]


def decide(
    *pairs: tuple[object, EffectMode], threshold: float = 0.5, summary: SceneSummary = DAYLIGHT
) -> EffectPlan:
    """Plan of effects with their modes."""
    return plan_effects(make_settings(*pairs, threshold=threshold), summary, CAMERA)


@pytest.mark.parametrize(
    ("effect", "mode", "is_on"),
    [
        (COARSE, EffectMode.AUTO, True),
        (FINE, EffectMode.AUTO, False),
        (FINE, EffectMode.ALWAYS, True),
        (COARSE, EffectMode.NEVER, False),
    ],
)
def test_effect_runs_when_the_criterion_or_the_file_enables_it(
    effect: Quantisation, mode: EffectMode, is_on: bool
) -> None:
    plan = decide((effect, mode))
    assert plan.decisions[0].enabled is is_on
    assert plan.image_effects == ((effect,) if is_on else ())


def test_reason_when_the_file_decides_states_it_and_the_bound_stays() -> None:
    (decision,) = decide((COARSE, EffectMode.NEVER)).decisions
    assert decision.reason.startswith("never by setting; ")
    assert decision.bound > decision.threshold == 0.5


def test_threshold_when_the_user_moves_it_decides() -> None:
    assert decide((FINE, EffectMode.AUTO), threshold=0.1).image_effects == (FINE,)


def test_threshold_when_in_pixels_decides_on_what_is_bounded_in_pixels() -> None:
    passing = replace(
        DAYLIGHT, min_distances_m=(1.0,) * NUM_RINGS, scene_twist=Twist((0.5, 0.0, 0.0))
    )
    named = (
        EffectSetting(MotionBlur(0.1), EffectMode.AUTO),
        EffectSetting(COARSE, EffectMode.AUTO),
    )
    plan = plan_effects(EffectSettings(named), passing, CAMERA)
    bound = plan.find_displacement_px("MotionBlur")
    assert plan.find_displacement_px("Quantisation") == 0.0
    for threshold_px, is_on in ((0.99 * bound, True), (1.01 * bound, False)):
        plan = plan_effects(EffectSettings(named, threshold_px=threshold_px), passing, CAMERA)
        assert [one.enabled for one in plan.decisions] == [is_on, True]
    assert plan_effects(EffectSettings(named), passing, CAMERA).decisions[0].enabled


def test_bound_when_an_effect_runs_before_is_that_of_what_reaches_it() -> None:
    blooming, longer = Blooming(0.1, 8.0), Exposure(0.04, 0.02)
    alone = decide((blooming, EffectMode.AUTO))
    behind = decide((longer, EffectMode.AUTO), (blooming, EffectMode.AUTO))
    left_out = decide((longer, EffectMode.NEVER), (blooming, EffectMode.AUTO))
    assert [plan.image_effects for plan in (alone, behind, left_out)] == [
        (),
        (longer, blooming),
        (),
    ]


def test_bound_of_light_above_the_well_counts_what_spills_over_beside() -> None:
    vignetting, blooming = make_any_effect("Vignetting"), Blooming(0.1, 8.0)
    bright, dim = SceneSummary(3.0), SceneSummary(0.9)
    both = (vignetting, EffectMode.AUTO), (blooming, EffectMode.AUTO)
    bound, alone = (decide(*one, summary=bright).decisions[0].bound for one in (both, both[:1]))
    # Black between white that falls from three wells to less.
    assert bound >= alone + grey_level(0.1 * 2.0) - 1e-9
    # Below the well no pixel's own light grows.
    bound, alone = (decide(*one, summary=dim).decisions[0].bound for one in (both, both[:1]))
    assert bound == alone
    thresholds = decide(*both, summary=bright).thresholds
    assert [one.spill for one in thresholds.values()] == [(1.0, pytest.approx(0.1)), NO_SPILL]


def test_bound_of_an_exposure_that_fills_the_wells_counts_what_spills_over_beside() -> None:
    longer, blooming = make_any_effect("Exposure", {"exposure_s": 0.05}), Blooming(0.1, 8.0)
    both = (longer, EffectMode.AUTO), (blooming, EffectMode.AUTO)
    bound, alone = (
        decide(*one, summary=SceneSummary(0.9)).decisions[0].bound for one in (both, both[:1])
    )
    factor = 0.05 * 60.0
    assert bound >= alone + grey_level(0.1 * (0.9 * factor - 1.0)) - 0.01


def test_decision_when_nothing_changed_is_not_made_again() -> None:
    settings = make_settings((COARSE, EffectMode.AUTO))
    assert plan_effects(settings, DAYLIGHT, CAMERA) is plan_effects(
        settings, SceneSummary(1.0), CAMERA
    )


def test_summary_needs_the_fields_of_all_named_effects() -> None:
    assert summary_fields(NO_EFFECT_SETTINGS) == frozenset()
    fog = Fog(0.1, 1, 1, 1)
    settings = make_settings((COARSE, EffectMode.AUTO), (fog, EffectMode.NEVER))
    assert summary_fields(settings) == COARSE.reads | fog.reads


def test_plan_when_no_effect_is_named_is_empty_and_reports_it() -> None:
    assert plan_effects(NO_EFFECT_SETTINGS, DAYLIGHT, CAMERA) == NO_EFFECTS
    assert "no effects" in str(NO_EFFECTS)


def test_plan_when_printed_is_a_table_with_a_row_an_effect() -> None:
    head, row = str(decide((FINE, EffectMode.AUTO))).splitlines()
    assert head.split() == [
        *("effect", "basis", "change", "bound", "threshold", "visible", "allowed"),
        *("px", "ms", "reason"),
    ]
    assert row.split()[:5] == ["Quantisation", "off", "proved", "0.402", "0.5"]
    assert row.endswith("a converter of 12 bits")


def plan_always(*effects: Effect, camera_state: CameraState = DRIVING_STATE) -> EffectPlan:
    """Plan with all of some effects enabled, for a camera that drives past a surface at 1 m."""
    twist = scene_twist_in_mirror(camera_state)
    summary = SceneSummary(1.0, (1.0,) * NUM_RINGS, scene_twist=twist)
    settings = tuple(EffectSetting(effect, EffectMode.ALWAYS) for effect in effects)
    return plan_effects(EffectSettings(settings), summary, CAMERA)


def test_ego_body_when_self_view_is_enabled_comes_after_all_objects() -> None:
    ego_body = replace(DYNAMIC_OBJECT, world_from_object=Pose.from_rpy((0, 0, 0)))
    state = replace(DRIVING_STATE, ego_body=ego_body)
    objects = (DYNAMIC_OBJECT,)
    assert apply_scene_effects(state, plan_always()).objects == objects
    assert apply_scene_effects(state, plan_always(SelfView())).objects == (*objects, ego_body)
    assert apply_scene_effects(DRIVING_STATE, plan_always(SelfView())).objects == objects


def test_shadows_when_enabled_are_cast() -> None:
    assert not apply_scene_effects(DRIVING_STATE, plan_always()).has_shadows
    assert apply_scene_effects(DRIVING_STATE, plan_always(Shadows())).has_shadows


def test_shutter_when_objects_move_has_the_time_samples_that_both_displacements_need() -> None:
    plan = plan_always(MotionBlur(0.04), RollingShutter(0.03))
    shutter = apply_scene_effects(DRIVING_STATE, plan).shutter
    assert shutter is not None
    assert (shutter.exposure_s, shutter.readout_s) == (0.04, 0.03)
    blur_px, skew_px = map(plan.find_displacement_px, ("MotionBlur", "RollingShutter"))
    steps = blur_px + 8.0 * skew_px
    assert shutter.num_time_samples == pytest.approx(steps, abs=1.0)
    assert shutter.num_time_samples > 2


def test_shutter_when_nothing_moves_is_none() -> None:
    still = replace(DRIVING_STATE, twist=AT_REST)
    plan = plan_always(MotionBlur(0.04), RollingShutter(0.03), camera_state=still)
    assert apply_scene_effects(still, plan).shutter is None
    assert apply_scene_effects(DRIVING_STATE, plan_always()).shutter is None


def test_changes_name_the_effects_that_are_decided_otherwise() -> None:
    modes = (COARSE, EffectMode.AUTO), (Exposure(0.02, 0.01), EffectMode.ALWAYS)
    off, on = (decide(*modes, threshold=levels) for levels in (300.0, 0.0))
    now, before = on.decisions, off.decisions
    assert describe_changes(now, now) == ""
    assert describe_changes(before, now) == f"Quantisation on ({now[0].reason})"
    assert describe_changes(now, before) == f"Quantisation off ({before[0].reason})"


@pytest.mark.parametrize(("change", "is_on"), [(0.5, False), (0.501, True), (0.0, False)])
def test_frame_when_it_measures_an_effect_decides(change: float, is_on: bool) -> None:
    plan = decide((COARSE, EffectMode.AUTO))
    assert plan.thresholds == {"Quantisation": Threshold(0.5)}
    (decision,) = plan.decide_by_frame({"Quantisation": EffectChange(change)})
    assert (decision.enabled, decision.change) == (is_on, change)
    assert decision.basis is DecisionBasis.MEASURED
    assert decision.bound == plan.decisions[0].bound
    assert decision.reason == f"at most {change:.3g} in this frame; {plan.decisions[0].reason}"


@pytest.mark.parametrize(
    ("change", "share", "is_on"),
    [(3.1, 2e-4, False), (3.1, 2e-3, True), (4.1, 2e-4, True), (0.4, 1.0, False)],
)
def test_frame_decides_by_the_largest_change_and_by_the_share_that_changes_visibly(
    change: float, share: float, is_on: bool
) -> None:
    settings = replace(make_settings((COARSE, EffectMode.AUTO)), max_change=4.0, visible_share=1e-3)
    plan = plan_effects(settings, DAYLIGHT, CAMERA)
    assert plan.thresholds == {"Quantisation": Threshold(4.0, visible_share=1e-3)}
    (decision,) = plan.decide_by_frame({"Quantisation": EffectChange(change, share)})
    assert (decision.enabled, decision.threshold, decision.share_threshold) == (is_on, 4.0, 1e-3)
    assert decision.visible_share == (share if change > 0.5 else 0.0)
    if change == 3.1:
        counted = f"at most 3.1 levels in any pixel, more than 0.5 in {100 * share:.2g} % of them"
        assert decision.reason.startswith(counted)
        assert counted in format_decisions((decision,), {})


@pytest.mark.parametrize(("max_change", "share", "is_on"), [(4, 0.99, True), (4, 1, False)])
def test_bound_above_half_a_level_proves_nothing_of_the_share(
    max_change: float, share: float, is_on: bool
) -> None:
    settings = make_settings((Quantisation(9), EffectMode.AUTO))
    settings = replace(settings, max_change=max_change, visible_share=share)
    (decision,) = plan_effects(settings, DAYLIGHT, CAMERA).decisions
    assert 0.5 < decision.bound < max_change
    assert (decision.enabled, decision.visible_share) == (is_on, 1.0)


def test_effect_that_is_only_seen_has_no_number_that_nobody_measured() -> None:
    dark = SceneSummary(0.1, ego_body_max_radiance=0.2, ego_body_max_angle_rad=0.5)
    plan = decide((SelfView(), EffectMode.AUTO), summary=dark)
    for seen, change in ((math.inf, None), (0.0, 0.0)):
        (decision,) = plan.decide_by_frame({"SelfView": EffectChange(seen)})
        assert (decision.enabled, decision.change) == (seen > 0.0, change)
        assert decision.reason.startswith("seen in" if seen else "at most 0 in")


def test_frame_when_it_measures_nothing_leaves_the_proof() -> None:
    plan = decide((COARSE, EffectMode.AUTO))
    (proved,) = plan.decisions
    said = replace(proved, reason=f"this renderer cannot measure it; {proved.reason}")
    assert plan.decide_by_frame({}) == (said,)
    assert plan.decide_by_frame({"Blooming": EffectChange(3.0)}) == (said,)
    assert proved.basis is DecisionBasis.PROVED
    for undecided in (decide((COARSE, EffectMode.ALWAYS)), decide((FINE, EffectMode.AUTO))):
        assert undecided.decide_by_frame({}) == undecided.decisions


@pytest.mark.parametrize("mode", [EffectMode.ALWAYS, EffectMode.NEVER])
def test_threshold_of_an_effect_that_a_setting_decides_is_not_the_frames(mode: EffectMode) -> None:
    thresholds = decide((COARSE, mode)).thresholds
    assert len(thresholds) == (mode is EffectMode.ALWAYS)
    assert not any(one.is_measured for one in thresholds.values())


def test_threshold_of_an_effect_that_is_proved_off_is_not_the_frames() -> None:
    assert not decide((FINE, EffectMode.AUTO)).thresholds


def test_thresholds_when_only_proofs_count_are_none() -> None:
    settings = replace(make_settings((COARSE, EffectMode.AUTO)), basis=DecisionBasis.PROVED)
    thresholds = plan_effects(settings, DAYLIGHT, CAMERA).thresholds
    assert [one.is_measured for one in thresholds.values()] == [False]


@pytest.mark.parametrize(("depth_change", "expected"), [(3.0, [True, False]), (0.1, [False, True])])
def test_frame_when_depth_does_not_show_counts_the_blur_as_that_of_the_fixed_disc(
    depth_change: float, expected: list[bool]
) -> None:
    aperture = Aperture(4.0, 7.4e-6, 0.0)
    near = SceneSummary(1.0, min_distances_m=(0.2,) * NUM_RINGS)
    plan = decide(
        (DefocusByDepth(aperture), EffectMode.AUTO),
        (Defocus(aperture), EffectMode.AUTO),
        summary=near,
    )
    assert [one.enabled for one in plan.decisions] == [True, False]
    assert plan.decisions[1].included_in == "DefocusByDepth"
    decided = plan.decide_by_frame(
        {"DefocusByDepth": EffectChange(depth_change), "Defocus": EffectChange(40.0)}
    )
    assert [one.enabled for one in decided] == expected
    # By its own bound, not that of an effect which another includes.
    assert decided[1].bound == Defocus(aperture).bound(near, CAMERA).value
    assert ("DefocusByDepth includes" in decided[1].reason) == expected[0]


@pytest.mark.parametrize("named", [(), ((Defocus(Aperture(1.0, 7.4e-6, 0.0)), EffectMode.NEVER),)])
def test_depth_without_the_fixed_disc_counts_all_of_the_blur(
    named: tuple[tuple[Defocus, EffectMode], ...],
) -> None:
    by_depth = DefocusByDepth(Aperture(1.0, 7.4e-6, 0.0))
    plan = decide((by_depth, EffectMode.AUTO), *named, summary=DAYLIGHT)
    fixed = Defocus(by_depth.aperture).bound(DAYLIGHT, CAMERA)
    assert by_depth.bound(DAYLIGHT, CAMERA).value < 0.5 < fixed.value == plan.decisions[0].bound
    decided = plan.decide_by_frame(
        {"DefocusByDepth": EffectChange(0.1), "Defocus": EffectChange(40.0)}
    )
    assert decided[0].change == 40.0
    assert [one.enabled for one in decided] == [True, *(False for _ in named)]


NAMES = [*EFFECT_TYPES]
# Effects that read nothing with the defaults of their keys, since they then do nothing.
ACTIVE_PARAMETERS = {
    "RollingShutter": {"readout_s": 0.03},
    "Fog": {"density_per_m": 0.1},
    "Misalignment": {"x_m": 0.001, "pitch_rad": 0.01},
}

MOVING = replace(DAYLIGHT, scene_twist=Twist((1.0, 0.5, 0.0), (0.0, 0.3, 2.0)))
NEAR = replace(MOVING, min_distances_m=(0.2,) * NUM_RINGS, max_distance_m=3.0)
# Every field differs from its default.
FULL = SceneSummary(
    2.0,
    min_distances_m=(0.2,) * NUM_RINGS,
    max_distance_m=3.0,
    background_radiance=((0.2, 0.3, 0.4),) * 2,
    scene_twist=MOVING.scene_twist,
    max_object_rates_rad_s=(1.0,) * NUM_RINGS,
    max_shadow_loss=ShadowLoss(0.4, 0.1),
    max_shadow_loss_with_ego_body=ShadowLoss(0.5, 0.1),
    camera_key=(7, 11),
    ego_body_max_radiance=3.0,
    ego_body_max_angle_rad=0.5,
    ego_body_min_distances_m=(0.1,) * NUM_RINGS,
    attached_min_distances_m=(0.15,) * NUM_RINGS,
    included_effects=frozenset({("Defocus", "DefocusByDepth")}),
    light_bake=make_baked_map((0.5, 0.6, 1.0)),
    open_irradiance=(0.8, 0.8, 0.8),
)
# Each field alone as in FULL, and each field alone as in DAYLIGHT: both sides of every branch.
SUMMARIES = [
    replace(one, **{each.name: getattr(other, each.name)})
    for one, other in ((DAYLIGHT, FULL), (FULL, DAYLIGHT))
    for each in fields(SceneSummary)
]


@dataclass(frozen=True, eq=False)
class DistanceEffect:
    """Effect of speed over distance that records the summaries of its computed bounds."""

    summaries: list[SceneSummary] = field(default_factory=list)

    name: ClassVar[str] = "Distance"
    changes_scene: ClassVar[bool] = True
    reads: ClassVar[frozenset[str]] = frozenset({"scene_twist", "min_distances_m"})
    gains: ClassVar[Gains] = UNCHANGED

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        self.summaries.append(summary)
        speed = summary.scene_twist.speed_m_s
        return EffectBound(speed / min(summary.min_distances_m), "counted")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        return summary


class RecordingSummary:
    """Summary that records the names of the fields that are read, properties resolved."""

    def __init__(self, summary: SceneSummary) -> None:
        self._summary = summary
        self.reads: set[str] = set()

    def __getattr__(self, name: str) -> object:
        attribute = getattr(SceneSummary, name, None)
        if isinstance(attribute, property):
            assert attribute.fget is not None
            return attribute.fget(self)
        self.reads.add(name)
        return getattr(self._summary, name)


def active_effect(name: str) -> Effect:
    return make_any_effect(name, ACTIVE_PARAMETERS.get(name))


def find_reads(effect: Effect, summary: SceneSummary) -> set[str]:
    """Fields that an effect's criterion reads for one summary."""
    recording = RecordingSummary(summary)
    bound = effect.bound(cast(SceneSummary, recording), CAMERA)
    assert bound == effect.bound(summary, CAMERA)
    # The same in all frames of a camera.
    return recording.reads - {"gains"}


@pytest.mark.parametrize("name", NAMES)
def test_criterion_when_recorded_reads_the_fields_that_it_declares_and_no_others(name: str) -> None:
    effect = active_effect(name)
    reads = set().union(*(find_reads(effect, summary) for summary in SUMMARIES))
    assert sorted(reads) == sorted(effect.reads)


@pytest.mark.parametrize("name", NAMES)
def test_criterion_when_inactive_reads_no_undeclared_field(name: str) -> None:
    effect = make_any_effect(name)
    assert set().union(*(find_reads(effect, summary) for summary in SUMMARIES)) <= effect.reads


def test_recorder_when_a_field_is_undeclared_finds_it() -> None:
    assert find_reads(DistanceEffect(), FULL) == {"scene_twist", "min_distances_m"}
    assert RecordingSummary(FULL).visible_min_distances_m == (0.15,) * NUM_RINGS


def plan_bound(effect: Effect, summary: SceneSummary) -> float:
    """Bound of an effect in a plan of this effect alone."""
    settings = EffectSettings((EffectSetting(effect, EffectMode.AUTO),))
    return plan_effects(settings, summary, CAMERA).decisions[0].bound


@pytest.mark.parametrize(
    ("first", "then", "times"),
    [
        (NEAR, NEAR, 1),
        (NEAR, replace(NEAR, max_radiance=2.0), 1),
        (NEAR, replace(NEAR, max_distance_m=math.inf), 1),
        (NEAR, MOVING, 2),
        (DAYLIGHT, NEAR, 2),
    ],
)
def test_bound_is_computed_again_only_when_a_declared_field_has_changed(
    first: SceneSummary, then: SceneSummary, times: int
) -> None:
    effect = DistanceEffect()
    for summary in (first, then):
        assert plan_bound(effect, summary) == DistanceEffect().bound(summary, CAMERA).value
    assert len(effect.summaries) == times


def test_bound_after_hundreds_of_others_is_evicted_and_computed_again() -> None:
    effect = DistanceEffect()
    for step in (*range(600), 0):
        summary = replace(NEAR, min_distances_m=(1.0 + step,) * NUM_RINGS)
        assert plan_bound(effect, summary) == MOVING.scene_twist.speed_m_s / (1.0 + step)
    assert len(effect.summaries) == 601


@pytest.mark.parametrize("name", NAMES)
def test_bound_from_the_cache_is_that_of_the_effect(name: str) -> None:
    effect = active_effect(name)
    for summary in SUMMARIES:
        alone = replace(summary, included_effects=frozenset(), has_defocus=False)
        assert plan_bound(effect, alone) == effect.bound(alone, CAMERA).value
