"""Learn to drive to the yellow goal of the field by what the mirror camera sees.

Needs Gymnasium, and a server that can be started: `make setup`, or

    pip install catoptra-server 'catoptra-client[gym]'
    python examples/learn_to_drive.py

A policy of two parameters, a speed and a gain from the goal's bearing to the steering, is improved
by the cross-entropy method (Rubinstein 1999). The same seed prints the same numbers.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from catoptra_client.gym_environment import CatoptraEnv
from catoptra_client.robot_episodes import Observation, Transition
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel_grid
from catoptra_protocol.vectors import Vector3

GOAL_M, NEAR_M = np.array([2.7, 0.0]), 0.8  # the goal's posts end 0.15 m before its centre
NUM_BEST = 3  # policies of a generation that the next one follows
NUM_EPISODES = 3  # of each policy


def main() -> None:
    """Improve the policy, and print the mean distance that it comes nearer in an episode."""
    parser = argparse.ArgumentParser(description="Learn to drive to the yellow goal.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--generations", type=int, default=4)
    parser.add_argument("--candidates", type=int, default=8, help="policies of a generation")
    parser.add_argument("--steps", type=int, default=30, help="of an episode, 0.3 s each")
    parsed = parser.parse_args()
    env = CatoptraEnv(measure_approach, choose_start, step_s=0.3)
    try:
        improve_policy(env, parsed)
    finally:
        env.close()


def improve_policy(env: CatoptraEnv, parsed: argparse.Namespace) -> None:
    """Print what each generation of policies achieves, and draw the next one about its best."""
    generator = np.random.default_rng(parsed.seed)
    directions = find_directions(env)
    mean, deviation = np.zeros(2), np.full(2, 0.5)  # of speed and gain
    for generation in range(1, parsed.generations + 1):
        candidates = mean + deviation * generator.standard_normal((parsed.candidates, 2))
        # One seed for all: policies are compared from the same starts, with the same noise.
        seed = 1000 * parsed.seed + generation
        returns_m = np.array(
            [evaluate(env, directions, each, seed, parsed.steps) for each in candidates]
        )
        best = candidates[np.argsort(returns_m)[-NUM_BEST:]]
        mean, deviation = best.mean(axis=0), best.std(axis=0) + 0.05
        print(
            f"generation {generation}: {returns_m.mean():+.2f} m nearer, the best "
            f"{returns_m.max():+.2f} m; next speed {mean[0]:+.2f}, gain {mean[1]:+.2f}",
            flush=True,
        )


def choose_start(generator: np.random.Generator) -> Vector3:
    """A place in the half of the field without the goal, with any heading."""
    x_m, y_m, yaw_rad = generator.uniform((-1.5, -1.0, -math.pi), (0.0, 1.0, math.pi))
    return x_m, y_m, yaw_rad


def measure_approach(transition: Transition) -> tuple[float, bool]:
    """Metres that a step leads nearer to the goal, and whether it is reached."""
    before_m, after_m = (
        float(np.linalg.norm(info["pose"][:2] - GOAL_M))
        for info in (transition.info, transition.next_info)
    )
    return before_m - after_m, after_m < NEAR_M


def evaluate(
    env: CatoptraEnv, directions: Floats, policy: Floats, seed: int, num_steps: int
) -> float:
    """Mean over some episodes of the metres that a policy leads nearer to the goal."""
    total_m = 0.0
    for episode in range(NUM_EPISODES):
        # A seed for the first episode alone: it decides all that follow.
        observation, _ = env.reset(seed=None if episode else seed)
        for _ in range(num_steps):
            action = choose_action(observation, directions, policy)
            observation, reward, terminated, _, _ = env.step(action)
            total_m += reward
            if terminated:
                break
    return total_m / NUM_EPISODES


def choose_action(observation: Observation, directions: Floats, policy: Floats) -> Floats:
    """Speeds of the wheels: turn towards the yellow pixels."""
    speed, gain = policy
    steering = gain * find_yellow_bearing(observation["image"], directions)
    return np.clip(np.array((speed + steering, speed - steering)), -1.0, 1.0)


def find_yellow_bearing(rgb: np.ndarray, directions: Floats) -> float:
    """Mean bearing of the yellow pixels in radians, positive to the right; 0 without any."""
    red, green, blue = np.moveaxis(rgb.astype(int), -1, 0)
    is_yellow = (red > 150) & (green > 150) & (blue < 80)
    x, y, _ = directions[is_yellow].sum(axis=0) if is_yellow.any() else (1.0, 0.0, 0.0)
    return math.atan2(y, x)


def find_directions(env: CatoptraEnv) -> Floats:
    """Direction (h, w, 3) of each pixel of the environment's camera; the axis outside the rim."""
    camera = env.client.get_camera()
    assert isinstance(camera, OmniCamera), "the bundled robot has a mirror"
    u, v = np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5
    return direction_from_pixel_grid(camera, u, v)[0]


if __name__ == "__main__":
    main()
