"""The Gymnasium environment: Gymnasium's checker, seeds, rewards, and servers that do not fit."""

from __future__ import annotations

import gc
import hashlib
import importlib
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.vectors import Vector3
from helpers.configs import ROBOTS, WORLDS, Edit, write_edited_copy
from helpers.server_process import DEADLINE_S, RunningServer, start_server

pytest.importorskip("gymnasium", reason="the extra gym is not installed: make setup installs it")

import gymnasium
from gymnasium.envs.registration import register, registry
from gymnasium.utils.env_checker import check_env

from catoptra_client import gym_environment
from catoptra_client.gym_environment import ENVIRONMENT_ID, CatoptraEnv
from catoptra_client.robot_episodes import Transition

ACTIONS = ((1.0, 0.4), (0.3, 0.5), (-0.2, 0.6))


def choose_start(generator: np.random.Generator) -> Vector3:
    """Free places of the rescue world's yard."""
    return -2.2 + generator.uniform(-0.1, 0.1), generator.uniform(-0.1, 0.1), 0.0


def measure_progress(transition: Transition) -> tuple[float, bool]:
    """Metres travelled along x; the episode ends after 0.25 s."""
    before, after = transition.info, transition.next_info
    return after["pose"][0] - before["pose"][0], after["time_s"] > 0.25


def write_robot(folder: Path) -> Path:
    """The bundled robot with all sensors and noise, its camera of 64 x 64 px with image noise."""
    base = write_edited_copy(
        ROBOTS / "p2at_omni.ini",
        folder,
        Edit("ResolutionX=360", "ResolutionX=64"),
        Edit("ResolutionY=360", "ResolutionY=64"),
    )
    full = (ROBOTS / "p2at_omni_full.ini").read_text(encoding="utf-8")
    path = folder / "noisy.ini"
    noise = "\n[Catoptra.OmniCaptureCamera]\nShotNoise=always\nReadNoise=always\n"
    path.write_text(full.replace("p2at_omni.ini", base.name, 1) + noise, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("robot"))


def make_env(robot: Path, **options: Any) -> CatoptraEnv:
    """An environment with a server of its own in the rescue world."""
    return CatoptraEnv(
        measure_progress,
        choose_start,
        robot=str(robot),
        world=str(WORLDS / "rescue.ini"),
        server_arguments=("--threads", "1"),
        **options,
    )


@pytest.fixture(scope="module")
def env(robot: Path) -> Iterator[CatoptraEnv]:
    env = make_env(robot)
    yield env
    env.close()


def hash_episode(env: CatoptraEnv, **reset: Any) -> str:
    """Hash of all that an episode returns."""
    digest = hashlib.sha256()
    observation, info = env.reset(**reset)
    for action in (*ACTIONS, None):
        digest.update(repr(sorted(observation)).encode())
        for name in sorted(observation):
            digest.update(observation[name].tobytes())
        digest.update(info["pose"].tobytes() + repr(info["time_s"]).encode())
        if action is not None:
            observation, reward, *_, info = env.step(action)
            digest.update(repr(reward).encode())
    return digest.hexdigest()


def test_environment_passes_gymnasiums_checker(robot: Path) -> None:
    register("CatoptraTest-v0", entry_point=lambda **options: make_env(robot, **options))
    try:
        made = gymnasium.make("CatoptraTest-v0")
        try:
            # With a specification the checker compares seeded episodes and every render mode.
            check_env(made.unwrapped)
        finally:
            made.close()
    finally:
        registry.pop("CatoptraTest-v0")


def test_registered_environment_has_size_range_and_ids_by_argument() -> None:
    options = {"size_px": (48, 40), "channels": ("range", "ids"), "world": "corridor"}
    made = gymnasium.make(
        ENVIRONMENT_ID,
        reward=measure_progress,
        start=lambda generator: (0.0, 0.0, 0.0),
        server_arguments=("--threads", "1"),
        **options,
    )
    try:
        observation, _ = made.reset(seed=1)
        shapes = {name: values.shape for name, values in observation.items()}
        assert shapes["image"] == (40, 48, 3)
        assert shapes["range"] == shapes["ids"] == (40, 48)
        assert made.observation_space.contains(observation)
        assert observation["ids"].max() > 1
        assert observation["range"].max() == np.float32(1e6), "outside the mirror"
    finally:
        made.close()


def test_size_of_a_lens_or_of_a_running_server_is_an_error() -> None:
    with pytest.raises(CatoptraError, match="camera of a mirror"):
        CatoptraEnv(
            measure_progress,
            lambda generator: (0.0, 0.0, 0.0),
            robot="p2at_fisheye",
            world="corridor",
            size_px=(32, 32),
        )
    with pytest.raises(CatoptraError, match="leave size_px out"):
        CatoptraEnv(measure_progress, choose_start, address=("127.0.0.1", 1), size_px=(32, 32))


def test_observation_has_image_odometry_and_scan(env: CatoptraEnv) -> None:
    observation, info = env.reset(seed=1)
    assert {name: values.shape for name, values in observation.items()} == {
        "image": (64, 64, 3),
        "odometry": (3,),
        "scan": (181,),
    }
    assert observation["image"].std() > 10.0
    assert observation["odometry"].tolist() == [0.0, 0.0, 0.0]
    assert 0.1 <= observation["scan"].min() < observation["scan"].max() <= 20.0
    assert info["time_s"] == 0.0
    assert env.observation_space.contains(observation)


def test_seed_when_repeated_gives_the_same_bytes_on_a_server_that_went_on(env: CatoptraEnv) -> None:
    first = [hash_episode(env, seed=7), hash_episode(env)]
    env.reset(seed=8)
    env.step((0.5, -0.5))
    assert [hash_episode(env, seed=7), hash_episode(env)] == first
    assert first[0] != first[1]


def test_seed_gives_the_same_bytes_on_another_server(env: CatoptraEnv, robot: Path) -> None:
    other = make_env(robot)
    try:
        assert hash_episode(other, seed=7) == hash_episode(env, seed=7)
    finally:
        other.close()


def test_seed_when_it_differs_changes_the_noise_of_one_start(env: CatoptraEnv) -> None:
    start = {"start": (-2.2, 0.0, 0.0)}
    (a, info_a), (b, info_b) = (env.reset(seed=seed, options=start) for seed in (7, 8))
    assert info_a["pose"].tolist() == info_b["pose"].tolist() == [-2.2, 0.0, 0.0]
    assert (a["scan"] != b["scan"]).any()
    assert (a["image"] != b["image"]).any()


def test_reward_function_receives_the_step_and_ends_the_episode(env: CatoptraEnv) -> None:
    env.reset(seed=1, options={"start": np.array((-2.2, 0.0, 0.0))})
    rewards, ends = zip(*(env.step((0.5, 0.5))[1:3] for _ in range(3)), strict=True)
    pose = env.step((0.0, 0.0))[-1]["pose"]
    assert all(reward > 0.0 for reward in rewards)
    assert sum(rewards) == pytest.approx(pose[0] + 2.2, abs=1e-9)
    assert ends == (False, False, True)


def test_full_speed_is_the_maximum_of_the_robot(env: CatoptraEnv) -> None:
    env.reset(seed=1)
    env.step((1.0, -0.5))
    (state,) = env.client.get_state().robots
    left, right = state.wheel_speeds_rad_s
    assert left > 1.0
    assert right == pytest.approx(-0.5 * left)


def test_returned_arrays_when_overwritten_do_not_reach_the_reward(robot: Path) -> None:
    seen: list[Transition] = []

    def record(transition: Transition) -> tuple[float, bool]:
        seen.append(transition)
        return 0.0, False

    env = CatoptraEnv(record, choose_start, robot=str(robot), world=str(WORLDS / "rescue.ini"))
    try:
        observation, info = env.reset(seed=1)
        observation["scan"][:] = 99.0
        info["pose"][:] = 99.0
        env.step((0.0, 0.0))
    finally:
        env.close()
    assert seen[0].observation["scan"].max() <= 20.0
    assert seen[0].info["pose"][0] < 0.0
    assert seen[0].action.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("action", [(1.1, 0.0), (0.0, float("nan")), (0.5,), 0.5])
def test_action_outside_the_space_is_rejected(env: CatoptraEnv, action: Any) -> None:
    env.reset(seed=1)
    with pytest.raises(DomainError, match="two wheel speeds"):
        env.step(action)


def test_render_returns_the_newest_image_in_its_mode_alone(robot: Path, env: CatoptraEnv) -> None:
    env.reset(seed=1)
    assert env.render() is None
    rendered = make_env(robot, render_mode="rgb_array")
    try:
        observation, _ = rendered.reset(seed=1)
        image = rendered.render()
        assert image is not None
        assert (image == observation["image"]).all()
    finally:
        rendered.close()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[RunningServer]:
    with start_server(tmp_path, "--clock", "lockstep") as running:
        yield running


def connect_env(server: RunningServer, **options: Any) -> CatoptraEnv:
    """An environment on a running server on the playing field."""
    return CatoptraEnv(
        measure_progress,
        lambda generator: (0.0, 0.0, 0.0),
        address=("127.0.0.1", server.stream_port),
        timeout_s=DEADLINE_S,
        **options,
    )


def test_environment_on_a_running_server_leaves_it_running(server: RunningServer) -> None:
    env = connect_env(server)
    assert set(env.observation_space) == {"image", "odometry"}
    env.close()
    env.close()
    with server.connect_stream() as client:
        assert client.get_state().robots == ()


def test_server_with_another_robot_is_rejected(server: RunningServer) -> None:
    with server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", name="Guest", location_m=(1.0, 1.0, 0.0))
        with pytest.raises(CatoptraError, match=r"other robots \(Guest.*server of its own"):
            connect_env(server)


def test_unknown_class_is_rejected_with_the_reason_of_the_server(server: RunningServer) -> None:
    with pytest.raises(CatoptraError, match=r"USARBot\.Unknown"):
        connect_env(server, robot_class="USARBot.Unknown")


def test_server_in_real_time_is_rejected(tmp_path: Path) -> None:
    with start_server(tmp_path) as server, pytest.raises(CatoptraError, match="--clock lockstep"):
        connect_env(server)


def test_server_of_a_forgotten_environment_ends(robot: Path) -> None:
    env = make_env(robot)
    _, _, port = env.client._socket.address.rpartition(":")
    socket.create_connection(("127.0.0.1", int(port)), DEADLINE_S).close()
    del env
    gc.collect()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", int(port)), DEADLINE_S)


def test_import_without_gymnasium_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "catoptra_client.gym_environment")
    with pytest.raises(ImportError, match=r"catoptra-client\[gym\]"):
        importlib.import_module("catoptra_client.gym_environment")
    # The module of the other tests is in place again.
    monkeypatch.undo()
    assert importlib.import_module("catoptra_client.gym_environment") is gym_environment
