from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.bound_cache import BoundCache
from catoptra_server.effects.effect import PIXELS, EffectBound, EffectType
from catoptra_server.effects.scene_summary import NUM_RINGS, SceneSummary
from catoptra_server.scene.twist import Twist
from helpers.effect_measurement import CAMERA

DAYLIGHT = SceneSummary(1.0)
MOVING = replace(DAYLIGHT, scene_twist=Twist((1.0, 0.5, 0.0), (0.0, 0.3, 2.0)))
NEAR = replace(MOVING, min_distances_m=(0.2,) * NUM_RINGS, max_distance_m=3.0)


@dataclass(frozen=True)
class DistanceEffect:
    """Asks how near the scene is, but only of a camera that moves; takes note of when."""

    summaries: list[SceneSummary] = field(default_factory=list, hash=False)

    name: ClassVar[str] = "Nearest"
    unit: ClassVar[str] = PIXELS

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        self.summaries.append(summary)
        speed = summary.scene_twist.speed_m_s
        return EffectBound(speed / min(summary.min_distances_m) if speed else 0.0, "counted")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        return summary


@pytest.mark.parametrize(
    ("first", "then", "times"),
    [
        (NEAR, NEAR, 1),
        (NEAR, replace(NEAR, max_radiance=2.0), 1),
        (NEAR, replace(NEAR, max_distance_m=math.inf), 1),
        (NEAR, MOVING, 2),
        (DAYLIGHT, replace(DAYLIGHT, min_distances_m=NEAR.min_distances_m), 1),
        (DAYLIGHT, NEAR, 2),
    ],
)
def test_bound_is_found_again_only_when_something_changed_that_it_asked_for(
    first: SceneSummary, then: SceneSummary, times: int
) -> None:
    effect = DistanceEffect()
    kept = BoundCache(effect, CAMERA)
    assert [kept.get(first), kept.get(then)] == [
        DistanceEffect().bound(first, CAMERA),
        DistanceEffect().bound(then, CAMERA),
    ]
    assert len(effect.summaries) == times


def test_bound_when_thousands_were_found_since_is_forgotten_and_found_again() -> None:
    effect = DistanceEffect()
    kept = BoundCache(effect, CAMERA)
    for step in range(600):
        kept.get(replace(NEAR, min_distances_m=(1.0 + step,) * NUM_RINGS))
    assert (
        kept.get(replace(NEAR, min_distances_m=(1.0,) * NUM_RINGS)).value
        == MOVING.scene_twist.speed_m_s
    )
    assert len(effect.summaries) == 601


@pytest.mark.parametrize("kind", EFFECT_TYPES, ids=lambda kind: kind.name)
def test_bound_that_is_kept_is_that_of_the_effect(kind: EffectType) -> None:
    effect = kind.factory(**{p.field: p.default for p in kind.parameters})
    kept = BoundCache(effect, CAMERA)
    for summary in (DAYLIGHT, MOVING, NEAR, DAYLIGHT, NEAR):
        assert kept.get(summary) == effect.bound(summary, CAMERA)
