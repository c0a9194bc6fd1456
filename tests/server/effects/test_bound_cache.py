from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar, cast

import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import NUM_RINGS, Effect, EffectBound, SceneSummary, ShadowLoss
from catoptra_server.effects.effect_plan import BoundCache
from catoptra_server.world.world_description import Twist
from helpers.effect_measurement import CAMERA, make_any_effect

NAMES = [effect_type.name for effect_type in EFFECT_TYPES]
# Effects that read nothing with the defaults of their keys, since they then do nothing.
ACTIVE_PARAMETERS = {
    "RollingShutter": {"readout_s": 0.03},
    "Fog": {"density_per_m": 0.1},
    "Misalignment": {"x_m": 0.001, "pitch_rad": 0.01},
}

DAYLIGHT = SceneSummary(1.0)
MOVING = replace(DAYLIGHT, scene_twist=Twist((1.0, 0.5, 0.0), (0.0, 0.3, 2.0)))
NEAR = replace(MOVING, min_distances_m=(0.2,) * NUM_RINGS, max_distance_m=3.0)
# Every field differs from its default.
FULL = SceneSummary(
    2.0,
    min_distances_m=(0.2,) * NUM_RINGS,
    max_distance_m=3.0,
    background_radiance=(0.2, 0.3, 0.4),
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
)
# Each field alone as in FULL, and each field alone as in DAYLIGHT: both sides of every branch.
SUMMARIES = [
    replace(one, **{each.name: getattr(other, each.name)})
    for one, other in ((DAYLIGHT, FULL), (FULL, DAYLIGHT))
    for each in fields(SceneSummary)
]


@dataclass(frozen=True)
class DistanceEffect:
    """Effect of speed over distance that records the summaries of its computed bounds."""

    summaries: list[SceneSummary] = field(default_factory=list, hash=False)

    name: ClassVar[str] = "Distance"
    changes_scene: ClassVar[bool] = True
    reads: ClassVar[frozenset[str]] = frozenset({"scene_twist", "min_distances_m"})

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
    return recording.reads


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
    cache = BoundCache(effect, CAMERA)
    assert [cache.get(first), cache.get(then)] == [
        DistanceEffect().bound(first, CAMERA),
        DistanceEffect().bound(then, CAMERA),
    ]
    assert len(effect.summaries) == times


def test_bound_after_hundreds_of_others_is_evicted_and_computed_again() -> None:
    effect = DistanceEffect()
    cache = BoundCache(effect, CAMERA)
    for step in range(600):
        cache.get(replace(NEAR, min_distances_m=(1.0 + step,) * NUM_RINGS))
    again = cache.get(replace(NEAR, min_distances_m=(1.0,) * NUM_RINGS))
    assert again.value == MOVING.scene_twist.speed_m_s
    assert len(effect.summaries) == 601


@pytest.mark.parametrize("name", NAMES)
def test_bound_from_the_cache_is_that_of_the_effect(name: str) -> None:
    effect = active_effect(name)
    cache = BoundCache(effect, CAMERA)
    for summary in (*SUMMARIES, *SUMMARIES):
        assert cache.get(summary) == effect.bound(summary, CAMERA)
