from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from catoptra_server.config.bundled_files import bundled_files, find_configuration
from catoptra_server.startup import StartupConfig, read_startup_config
from catoptra_studies.effects.decision_experiment import MOTIONS, WORLDS, choose_places


@cache
def load_world(name: str) -> StartupConfig:
    robot = find_configuration("robots", "p2at_omni_real")
    return read_startup_config([robot], find_configuration("worlds", name))


def test_worlds_are_all_bundled_ones() -> None:
    assert WORLDS == tuple(path.stem for path in bundled_files("worlds"))


@pytest.mark.parametrize("world", WORLDS)
def test_half_of_the_places_of_each_world_are_near_obstacles(world: str) -> None:
    places = choose_places(world, load_world(world), 40, seed=0)
    assert len(places) == 40
    assert sum(place.is_near for place in places) == 20
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
