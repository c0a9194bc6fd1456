"""The page about the Gymnasium environment and its example, with servers that they start."""

from __future__ import annotations

import importlib.util
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest

from helpers.configs import REPOSITORY
from helpers.documents import read_blocks
from helpers.server_process import DEADLINE_S

pytest.importorskip("gymnasium", reason="the extra gym is not installed: make setup installs it")

PAGE = REPOSITORY / "docs/environment.md"
PROGRAM = REPOSITORY / "examples/learn_to_drive.py"


def test_block_of_the_page_prints_an_episode(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = read_blocks(PAGE, "python")
    exec(compile(block, str(PAGE), "exec"), {})
    shapes, *steps = capsys.readouterr().out.splitlines()
    assert shapes == "{'image': (360, 360, 3), 'odometry': (3,)}"
    assert len(steps) == 5
    assert steps[-1].startswith("0.5 [")


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("learn_to_drive", PROGRAM)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def env(example: ModuleType) -> Iterator[object]:
    env = example.CatoptraEnv(example.measure_approach, example.choose_start, step_s=0.3)
    yield env
    env.close()


def test_example_sees_the_goal_at_its_bearing(example: ModuleType, env) -> None:
    directions = example.find_directions(env)
    for seed in range(5):
        observation, info = env.reset(seed=seed)
        x_m, y_m, yaw_rad = info["pose"]
        bearing_rad = math.atan2(example.GOAL_M[1] - y_m, example.GOAL_M[0] - x_m) - yaw_rad
        seen_rad = example.find_yellow_bearing(observation["image"], directions)
        # The yellow halves of two beacons pull the mean by some hundredths.
        assert abs(math.remainder(seen_rad - bearing_rad, math.tau)) < 0.15


def test_policy_that_the_page_prints_drives_to_the_goal(example: ModuleType, env) -> None:
    (printed,) = read_blocks(PAGE, "text")
    policy = np.array([float(n) for n in re.findall(r"(?:speed|gain) (\S\d\.\d+)", printed)[-2:]])
    directions = example.find_directions(env)
    learned_m, reversed_m = (
        example.evaluate(env, directions, values, 1, 30) for values in (policy, -policy)
    )
    # The goal is 2.7 m to 4.3 m from the starts, and reached at 0.8 m.
    assert learned_m > 1.9
    assert reversed_m < learned_m


def test_example_when_repeated_prints_the_same() -> None:
    options = ("--generations", "1", "--candidates", "2", "--steps", "3")
    command = [sys.executable, str(PROGRAM), *options]
    first, second = (
        subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=True)
        for _ in range(2)
    )
    assert re.fullmatch(r"generation 1: \S+ m nearer, the best .* gain \S+\n", first.stdout)
    assert first.stdout == second.stdout
