"""The decision experiment: places, one trial, and `make effects` in small, 16 situations."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from catoptra_server.config.known_names import bundled_files, find_configuration
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.effects import EFFECT_TYPES
from catoptra_studies.effects.decision_experiment import (
    CONDITIONS,
    MOTIONS,
    WORLDS,
    DecisionStudy,
    TrialDecision,
    choose_places,
    run_decision_study,
)
from catoptra_studies.effects.decision_report import evaluate_decisions
from helpers.long_cases import quick_cases


@cache
def load_world(name: str) -> StartupConfig:
    robot = find_configuration("robots", "p2at_omni_real")
    return read_startup_config([robot], find_configuration("worlds", name))


BUNDLED = {one.stem: "Scenery=" in one.read_text() for one in bundled_files("worlds")}


def test_worlds_are_all_bundled_ones() -> None:
    assert tuple(BUNDLED) == WORLDS


# Furnished ones take minutes to bake.
@pytest.mark.parametrize(
    "world", [name for name, is_furnished in BUNDLED.items() if not is_furnished]
)
def test_half_of_the_places_of_each_world_are_near_obstacles(world: str) -> None:
    places = choose_places(world, load_world(world), 40, seed=0)
    assert len(places) == 40
    # Nothing stands on the airfield.
    assert sum(place.is_near for place in places) == (0 if world == "airfield" else 20)
    assert len({place.pose for place in places}) == 40


def test_robot_at_a_place_touches_nothing() -> None:
    # The corners of its base, in any heading, are inside the walls of the yard.
    startup = load_world("legacy")
    length_m, width_m, _ = startup.robots[0].drive.collision_size_m
    reach_m = 0.5 * math.hypot(length_m, width_m)
    for place in choose_places("legacy", startup, 200, seed=1):
        assert abs(place.pose.x_m) + reach_m < 10.0
        assert abs(place.pose.y_m) + reach_m < 8.0
        assert math.hypot(place.pose.x_m + 2.0, place.pose.y_m - 5.5) > reach_m + 0.27, "the barrel"


def test_places_behind_a_wall_are_not_reached() -> None:
    # Beside the sphere of rings its bounding box has corners, in which no start lies.
    places = choose_places("incidence_rings", load_world("incidence_rings"), 200, seed=0)
    assert max(math.hypot(place.pose.x_m, place.pose.y_m) for place in places) < 4.0


def test_rooms_behind_doors_are_reached() -> None:
    places = choose_places("corridor", load_world("corridor"), 200, seed=0)
    assert sum(abs(place.pose.y_m) > 1.2 for place in places) > 20


def test_places_follow_from_the_seed() -> None:
    startup = load_world("rescue")
    places = choose_places("rescue", startup, 8, seed=3)
    assert places == choose_places("rescue", startup, 8, seed=3)
    assert places != choose_places("rescue", startup, 8, seed=4)


def test_motions_are_those_of_a_p2at() -> None:
    drive = load_world("legacy").robots[0].drive
    max_speed_m_s = drive.max_speed_rad_s * drive.wheel_radius_m
    speeds = np.array([(motion.forward_m_s, motion.yaw_rate_rad_s) for motion in MOTIONS.values()])
    assert (np.hypot(speeds[:, 0], 0.24 * speeds[:, 1]) <= max_speed_m_s).all()
    assert not speeds[0].any()


def test_place_has_all_motions_and_all_effects_that_are_not_switched_off() -> None:
    study = DecisionStudy(1, worlds=("rescue",), width_px=48, num_processes=1)
    decisions = run_decision_study(study)
    assert list(dict.fromkeys(one.motion for one in decisions)) == list(MOTIONS)
    names = [one.effect for one in decisions if one.motion == "driving"]
    in_order = [name for name in EFFECT_TYPES if name in names]
    assert names == in_order
    # Automatic exposure is never on in the shipped camera; one of the two defocus effects acts.
    assert len(names) >= 20
    assert "AutoExposure" not in names
    assert decisions == run_decision_study(study), "a trial repeats itself"


def test_all_effects_and_both_kinds_of_places_are_tried_in_all_conditions() -> None:
    study = DecisionStudy(12, worlds=("four_legged_2006",), width_px=32, num_processes=1)
    decisions = run_decision_study(study)
    assert {one.effect for one in decisions} == set(EFFECT_TYPES) - {"Defocus"}
    parities = {(one.condition, one.place % 2) for one in decisions}
    assert parities == {(name, parity) for name in CONDITIONS for parity in (0, 1)}


def test_truth_of_a_world_s_own_light_is_that_without_it() -> None:
    decisions = run_decision_study(
        DecisionStudy(1, worlds=("meadow", "warehouse"), width_px=64, num_processes=1)
    )
    truths = {(one.world, one.effect): one.truth for one in decisions if one.motion == "at rest"}
    assert truths["meadow", "SkyRadiance"] > 10.0
    assert truths["warehouse", "SkyRadiance"] == truths["meadow", "BakedLight"] == 0.0
    assert truths["warehouse", "BakedLight"] > 10.0


def test_truth_of_motion_follows_the_motion() -> None:
    study = DecisionStudy(1, worlds=("four_legged_2006",), width_px=64, num_processes=1)
    decisions = run_decision_study(study)
    truths = {one.motion: one.truth for one in decisions if one.effect == "MotionBlur"}
    assert truths["at rest"] == 0.0
    assert truths["driving"] > 1.0


@pytest.fixture(scope="module", params=quick_cases([2, 5], 0))
def decisions(request: pytest.FixtureRequest) -> tuple[TrialDecision, ...]:
    """Decisions at some places of two worlds, in all motions."""
    worlds = ("four_legged_2006", "rescue")
    return run_decision_study(
        DecisionStudy(request.param, worlds=worlds, width_px=160, num_processes=1)
    )


def test_situations_are_worlds_times_places_times_motions(
    decisions: tuple[TrialDecision, ...],
) -> None:
    num_places = len({one.place for one in decisions})
    assert evaluate_decisions(decisions).num_situations == 2 * 4 * num_places


def test_all_criteria_of_the_experiment_are_met(decisions: tuple[TrialDecision, ...]) -> None:
    assert evaluate_decisions(decisions).failures == ()


def test_measured_changes_are_never_below_the_truth(decisions: tuple[TrialDecision, ...]) -> None:
    # At rest: in motion the frame is the mean of fewer instants than the truth.
    compared = [
        (one.effect, one.change, one.truth)
        for one in decisions
        if one.change is not None and one.motion == "at rest"
    ]
    assert len(compared) > 40
    # ReadNoise is stated up to 3.1 % below its truth, far above its threshold.
    below = [row for row in compared if row[1] < row[2] - 0.05 - 0.035 * row[2]]
    assert below == []


def test_both_sides_of_a_threshold_occur_so_that_a_decision_could_be_wrong(
    decisions: tuple[TrialDecision, ...],
) -> None:
    moving = [one.truth > one.threshold for one in decisions if one.effect == "MotionBlur"]
    assert any(moving)
    assert not all(moving)


def test_bounds_are_never_below_the_truth(decisions: tuple[TrialDecision, ...]) -> None:
    # Rounding apart: a bound may be the truth itself, and maps of gains are of 32 bits.
    below = [one for one in decisions if one.truth > one.bound + 1e-3]
    assert below == []


def test_processes_share_the_places_without_a_change() -> None:
    calls = []
    small = DecisionStudy(num_places=1, worlds=("rescue",), width_px=48, num_processes=1)
    alone = run_decision_study(small, on_place=lambda: calls.append(1))
    pair = DecisionStudy(num_places=1, worlds=("rescue",), width_px=48, num_processes=2)
    assert run_decision_study(pair) == alone
    assert calls == [1]
