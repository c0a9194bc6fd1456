"""Gymnasium environment of one robot on a lockstep server; see docs/environment.md.

Needs the extra `gym`. An episode is a new robot of `robot_episodes`.
"""

from __future__ import annotations

import math
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_client.frame_sources import StreamClient
from catoptra_client.robot_episodes import (
    Info,
    Observation,
    RewardFunction,
    RobotEpisodes,
    StartFunction,
)
from catoptra_client.server_process import serve_stream
from catoptra_protocol.errors import CatoptraError, DomainError

try:
    import gymnasium
except ImportError as error:
    raise ImportError("no Gymnasium here: pip install 'catoptra-client[gym]'") from error

ENVIRONMENT_ID = "Catoptra-v0"
"""Name for `gymnasium.make`, once this module is imported."""
# Finite, as Gymnasium's checker wants it, and farther than any drive or range.
_MAX_M = 1e6
_ODOMETRY_LIMITS = np.array((_MAX_M, _MAX_M, math.pi), np.float32)


class CatoptraEnv(gymnasium.Env):  # type: ignore[misc] # untyped where Gymnasium is not installed
    """A robot that sees by its camera and is driven by its wheel speeds.

    Action: speeds (2,) of the left and right wheels, as fractions of the maximum in [-1, 1].
    Observation: `image`, `odometry`, `scan` and channels of `robot_episodes.observe`. Info: true
    `pose` (3,), m, m, rad in the world frame, and `time_s` since the start. `client` is the robot's
    connection, for its other sensors: do not `reset`, `spawn` or `step` by it.

    Constructor, `reset` and `step` raise what `StreamClient` raises: ConnectionLostError and
    DeadlineExceededError end the episode, and `reset` begins another if the server is there. A
    server that the environment started itself is not started again: close the environment and make
    a new one. For robots without Gymnasium use `robot_episodes.RobotEpisodes`.

    Example:
        ```python
        env = CatoptraEnv(reward, start, step_s=0.1)
        try:
            observation, info = env.reset(seed=7)
            for _ in range(100):
                observation, gain, terminated, truncated, info = env.step([0.6, 0.4])
                if terminated:
                    observation, info = env.reset()
        finally:
            env.close()
        ```
    """

    client: StreamClient

    def __init__(
        self,
        reward: RewardFunction,
        start: StartFunction,
        *,
        robot: str = "p2at_omni",
        world: str = "four_legged_2006",
        server_seed: int = 0,
        server_arguments: Sequence[str] = (),
        address: tuple[str, int] | None = None,
        robot_class: str = "",
        camera: str = "",
        size_px: tuple[int, int] | None = None,
        channels: Sequence[str] = (),
        step_s: float = 0.1,
        render_mode: str | None = None,
        timeout_s: float = 60.0,
    ) -> None:
        """Start a server, or connect to a running one, and spawn a robot to know the spaces.

        Args:
            reward: Reward of a step, and whether the step ends the episode.
            start: Start pose of an episode.
            robot, world: Files of the server's robot and world, or names of bundled ones.
            server_seed, server_arguments: Its seed and further arguments, such as `--threads 1`.
            address: Host and stream port of a running server, which replaces the four above.
            robot_class, camera: Empty = the server's first class, the robot's first camera.
            size_px: Width and height of a mirror's picture, of a server that is started; None = the
                camera's own.
            channels: Channels of ground truth in the observation, such as `range` and `ids`; ranges
                without a surface are 1e6 m.
            step_s: Simulated seconds of a step.
            render_mode: `rgb_array` for the camera's image, or None.
            timeout_s: Limit of each wait for the server.

        Raises:
            CatoptraError: There is no server, it has other robots or no lockstep, or rejects class,
                camera or channel; or a size is wanted of a running server.

        An exception, KeyboardInterrupt and errors of `start` included, ends a server that was
        started.
        """
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 1.0 / step_s}
        self.render_mode, self._reward, self._start = render_mode, reward, start
        self._stack = ExitStack()
        # Where `close` is not called.
        self._finalizer = weakref.finalize(self, self._stack.close)
        try:
            if address is None:
                robot_file = Path(robot)
                if size_px is not None:
                    folder = self._stack.enter_context(tempfile.TemporaryDirectory())
                    robot_file = _write_sized_robot(Path(folder), robot, *size_px)
                files, arguments = (robot_file, Path(world)), tuple(server_arguments)
                server = serve_stream(
                    *files, seed=server_seed, timeout_s=timeout_s, extra_arguments=arguments
                )
                self.client = self._stack.enter_context(server)
            elif size_px is not None:
                raise CatoptraError("the picture's size is the running server's: leave size_px out")
            else:
                client = StreamClient.connect(*address, timeout_s=timeout_s)
                self.client = self._stack.enter_context(client)
            self._episodes = RobotEpisodes(
                self.client,
                robot_class=robot_class,
                camera=camera,
                step_s=step_s,
                channels=channels,
            )
            generator = np.random.default_rng(0)
            observation, _ = self._episodes.begin(generator, start(generator))
            if size_px not in (None, observation["image"].shape[1::-1]):
                raise CatoptraError(
                    f"size_px is of the camera of a mirror: {robot} has another, of "
                    "ResolutionX and ResolutionY in its file"
                )
        except BaseException:
            self.close()
            raise
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = _find_space(observation)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode: a new robot at a new start pose; no server is restarted.

        Args:
            seed: Seed of this and the following episodes; None continues.
            options: `start` is a start pose, which replaces that of the start function.

        Returns:
            First observation and info, for the caller to keep and to write into.

        Raises:
            CatoptraError: The server has another robot, or rejects the start pose.
            ConnectionLostError, DeadlineExceededError: As in `StreamClient`; call again to retry.

        The random numbers follow from the seed: the same seed gives the same episodes, byte for
        byte, but not after a `reset` that raised, which has drawn from the generator: pass a seed
        again.
        """
        super().reset(seed=seed)
        generator = self.np_random
        start = (options or {}).get("start")
        return self._episodes.begin(generator, self._start(generator) if start is None else start)

    def step(self, action: npt.ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Drive for `step_s`; observation, reward, whether the episode ended, False, and info.

        The episode never ends by its length, so the fourth value is False: wrap the environment in
        `gymnasium.wrappers.TimeLimit`. After the end `step` goes on with the same robot; `reset`
        begins an episode.

        Args:
            action: Speeds (2,) of the left and right wheels in [-1, 1].

        Raises:
            DomainError: The action is not two numbers in [-1, 1]; nothing has moved. Clip it, for
                example with `gymnasium.wrappers.ClipAction`.
            ConnectionLostError, DeadlineExceededError: As in `StreamClient`. The step may have been
                executed: `reset` instead of repeating it.

        KeyboardInterrupt during a step leaves it in between likewise.
        """
        speeds = np.array(action, np.float64)
        if speeds.shape != (2,) or not (np.abs(speeds) <= 1.0).all():
            raise DomainError(f"an action is two wheel speeds in [-1, 1], not {action!r}")
        transition = self._episodes.advance(speeds)
        reward, terminated = self._reward(transition)
        observation, info = transition.next_observation, transition.next_info
        return observation, float(reward), bool(terminated), False, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """The newest image, (h, w, 3) RGB; None without a render mode.

        That of the last `reset` or `step`, copied: nothing is requested and nothing is raised. For
        an image with other settings or labels use `client.get_frame`.
        """
        return self._episodes.newest[0]["image"].copy() if self.render_mode else None

    def close(self) -> None:
        """Remove the robot, and end the server if it was started.

        May be called twice; also done when the environment is collected, or the program ends. Any
        later `reset` or `step` raises `zmq.ZMQError`.
        """
        self._stack.close()


def _write_sized_robot(folder: Path, robot: str, width_px: int, height_px: int) -> Path:
    """File of a robot whose mirror's camera has another size."""
    base = Path(robot).resolve() if Path(robot).exists() else robot
    size = f"ResolutionX={width_px}\nResolutionY={height_px}\n"
    section = f"[Catoptra.OmniCaptureCamera]\n{size}"
    path = folder / "robot.ini"
    path.write_text(f"[Configuration]\nBasedOn={base}\n{section}", encoding="utf-8")
    return path


def _find_space(observation: Observation) -> gymnasium.spaces.Dict:
    """Space of all observations that have the shapes of this one."""
    box, limit = gymnasium.spaces.Box, _ODOMETRY_LIMITS
    limits_of = {"image": (0, 255), "odometry": (-limit, limit), "scan": (0.0, _MAX_M)}
    limits_of |= {"ids": (0, 65535), "classes": (0, 65535), "agreement": (0, 255), "valid": (0, 1)}
    return gymnasium.spaces.Dict(
        {
            name: box(*limits_of.get(name, (-_MAX_M, _MAX_M)), v.shape, v.dtype.type)
            for name, v in observation.items()
        }
    )


if ENVIRONMENT_ID not in gymnasium.registry:
    gymnasium.register(ENVIRONMENT_ID, f"{__name__}:{CatoptraEnv.__name__}")
