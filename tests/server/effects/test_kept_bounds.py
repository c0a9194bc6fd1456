from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import pytest

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects import EFFECTS
from catoptra_server.effects.effect import PIXELS, Bound, Kind
from catoptra_server.effects.kept_bounds import KeptBounds
from catoptra_server.effects.scene_summary import RINGS, SceneSummary
from catoptra_server.scene.motion import Twist
from helpers.effects import CAMERA

DAY = SceneSummary(1.0)
MOVING = replace(DAY, motion=Twist((1.0, 0.5, 0.0), (0.0, 0.3, 2.0)))
NEAR = replace(MOVING, nearest_m=(0.2,) * RINGS, farthest_m=3.0)


@dataclass(frozen=True)
class Nearest:
    """Asks how near the scene is, but only of a camera that moves; takes note of when."""

    asked: list[SceneSummary] = field(default_factory=list, hash=False)

    name: ClassVar[str] = "Nearest"
    unit: ClassVar[str] = PIXELS

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        self.asked.append(summary)
        speed = summary.motion.speed_m_s
        return Bound(speed / min(summary.nearest_m) if speed else 0.0, "counted")

    def after(self, summary: SceneSummary) -> SceneSummary:
        return summary


@pytest.mark.parametrize(
    ("first", "then", "times"),
    [
        (NEAR, NEAR, 1),
        (NEAR, replace(NEAR, largest_radiance=2.0), 1),
        (NEAR, replace(NEAR, farthest_m=math.inf), 1),
        (NEAR, MOVING, 2),
        (DAY, replace(DAY, nearest_m=NEAR.nearest_m), 1),
        (DAY, NEAR, 2),
    ],
)
def test_bound_is_found_again_only_when_something_changed_that_it_asked_for(
    first: SceneSummary, then: SceneSummary, times: int
) -> None:
    effect = Nearest()
    kept = KeptBounds(effect, CAMERA)
    assert [kept.of(first), kept.of(then)] == [
        Nearest().bound(first, CAMERA),
        Nearest().bound(then, CAMERA),
    ]
    assert len(effect.asked) == times


def test_bound_when_thousands_were_found_since_is_forgotten_and_found_again() -> None:
    effect = Nearest()
    kept = KeptBounds(effect, CAMERA)
    for step in range(600):
        kept.of(replace(NEAR, nearest_m=(1.0 + step,) * RINGS))
    assert kept.of(replace(NEAR, nearest_m=(1.0,) * RINGS)).value == MOVING.motion.speed_m_s
    assert len(effect.asked) == 601


@pytest.mark.parametrize("kind", EFFECTS, ids=lambda kind: kind.name)
def test_bound_that_is_kept_is_that_of_the_effect(kind: Kind) -> None:
    effect = kind.make(**{p.field: p.default for p in kind.parameters})
    kept = KeptBounds(effect, CAMERA)
    for summary in (DAY, MOVING, NEAR, DAY, NEAR):
        assert kept.of(summary) == effect.bound(summary, CAMERA)
