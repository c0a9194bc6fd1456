"""Gymnasium environment of one robot on a lockstep server, for reinforcement learning.

Needs the extra `gym`. The server's random numbers follow from its seed, the name of a robot and the
ticks since its spawn. An episode is therefore a new robot, named by the environment's generator:
the same seed gives the same episodes without a restart of the server. See docs/environment.md.
"""

from __future__ import annotations

import copy
import math
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_client.frame_sources import ImageEncoding, StreamClient
from catoptra_client.robot_observation import Observation, find_planar_pose, observe
from catoptra_client.server_process import serve_stream
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.usarsim.reports import Report
from catoptra_protocol.vectors import Vector3

try:
    import gymnasium
except ImportError as error:
    raise ImportError("no Gymnasium here: pip install 'catoptra-client[gym]'") from error

Info = dict[str, Any]
# Start pose by the environment's generator: x and y in metres, yaw in radians, in the world frame.
StartFunction = Callable[[np.random.Generator], Vector3]

# Finite, as Gymnasium's checker wants it, and farther than any drive or range.
_MAX_M = 1e6
_ODOMETRY_LIMITS = np.array((_MAX_M, _MAX_M, math.pi), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Transition:
    """A step, with action, observations and info as in `CatoptraEnv`."""

    observation: Observation
    info: Info
    action: npt.NDArray[np.float64]
    next_observation: Observation
    next_info: Info


# Reward of a step, and whether the step ends the episode.
RewardFunction = Callable[[Transition], tuple[float, bool]]


class CatoptraEnv(gymnasium.Env):  # type: ignore[misc] # untyped where Gymnasium is not installed
    """A robot that sees by its camera and is driven by its wheel speeds.

    Action: speeds (2,) of the left and right wheels, as fractions of the maximum in [-1, 1].
    Observation: `image`, `odometry` and `scan` of `robot_observation.observe`. Info: true `pose`
    (3,), x and y in metres and yaw in radians in the world frame, and `time_s` since the start.
    Calls also raise the errors of `StreamClient`.
    """

    client: StreamClient
    """Connection of the robot, for its other sensors; `step` alone advances the time."""

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
        step_s: float = 0.1,
        render_mode: str | None = None,
        timeout_s: float = 60.0,
    ) -> None:
        """Start a server, or connect to a running one, and spawn a robot to know the spaces.

        Args:
            reward: Reward of a step, and whether the step ends the episode.
            start: Start pose of an episode.
            robot: File of the server's robot, or name of a bundled one.
            world: File of its world, likewise.
            server_seed: Its seed.
            server_arguments: Its further arguments, such as `--threads 1` beside other servers.
            address: Host and stream port of a running server, which replaces the four above.
            robot_class: Class of the robot; empty = the server's first one.
            camera: Name of the camera; empty = the robot's first one.
            step_s: Simulated seconds of a step.
            render_mode: `rgb_array` for the camera's image, or None.
            timeout_s: Limit of each wait for the server.

        Raises:
            CatoptraError: There is no server, it has other robots or no lockstep, or rejects class
                or camera.
        """
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 1.0 / step_s}
        self.render_mode, self._camera, self._step_s = render_mode, camera, step_s
        self._reward, self._start = reward, start
        self._stack = ExitStack()
        # Ends the server with the environment or the program where `close` is not called.
        self._finalizer = weakref.finalize(self, self._stack.close)
        try:
            if address is None:
                server = serve_stream(
                    *(Path(robot), Path(world)),
                    seed=server_seed,
                    timeout_s=timeout_s,
                    extra_arguments=tuple(server_arguments),
                )
                self.client = self._stack.enter_context(server)
            else:
                client = StreamClient.connect(*address, timeout_s=timeout_s)
                self.client = self._stack.enter_context(client)
            self._class_name = robot_class or self.client.get_status().class_names[0]
            observation, _ = self._spawn(np.random.default_rng(0), {})
        except BaseException:
            self.close()
            raise
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = _find_space(observation)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode.

        Args:
            seed: Seed of this and the following episodes; None continues.
            options: `start` is a start pose, which replaces that of the start function.
        """
        super().reset(seed=seed)
        return self._spawn(self.np_random, options or {})

    def step(self, action: npt.ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Drive for `step_s`; observation, reward, whether the episode ended, False, and info.

        Raises:
            DomainError: The action is not two numbers in [-1, 1].
        """
        speeds = np.array(action, np.float64)
        if speeds.shape != (2,) or not (np.abs(speeds) <= 1.0).all():
            raise DomainError(f"an action is two wheel speeds in [-1, 1], not {action!r}")
        self.client.drive(*(100.0 * speeds).tolist(), normalized=True)
        reports = self.client.step(self._step_s)
        self._num_steps += 1
        before, (observation, info) = self._last, self._observe(reports)
        reward, terminated = self._reward(Transition(*before, speeds, observation, info))
        return observation, float(reward), bool(terminated), False, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """The newest image, (h, w, 3) uint8 RGB; None without a render mode."""
        return self._last[0]["image"].copy() if self.render_mode else None

    def close(self) -> None:
        """Remove the robot, and end the server if it was started."""
        self._stack.close()

    def _spawn(
        self, generator: np.random.Generator, options: Mapping[str, Any]
    ) -> tuple[Observation, Info]:
        """Replace the robot by a new one; what the new one observes."""
        self._name = f"Gym{generator.integers(2**63)}"
        start = options["start"] if "start" in options else self._start(generator)
        x_m, y_m, yaw_rad = map(float, start)
        self.client.reset()
        self.client.spawn(
            self._class_name,
            name=self._name,
            location_m=(x_m, y_m, 0.0),
            rotation_rad=(0.0, 0.0, yaw_rad),
        )
        names = [robot.name for robot in self.client.get_state().robots]
        if names != [self._name]:
            raise CatoptraError(
                f"the server has other robots ({', '.join(names)}): an environment needs a server "
                "of its own, since a step advances the time of all robots"
            )
        self._num_steps = 0
        return self._observe(self.client.step(0.0))

    def _observe(self, reports: Iterable[Report]) -> tuple[Observation, Info]:
        """Observation and info of the present, from the readings of all sensors and a frame."""
        frame = self.client.get_frame(
            encoding=ImageEncoding.RAW, robot=self._name, camera=self._camera
        )
        observation = observe(frame, reports)
        # Counted from the start: differences of the server's times would round by its age.
        info: Info = {"pose": find_planar_pose(frame), "time_s": self._num_steps * self._step_s}
        # Copies: the caller may write into what is returned.
        self._last = copy.deepcopy((observation, info))
        return observation, info


def _find_space(observation: Observation) -> gymnasium.spaces.Dict:
    """Space of all observations that have the shapes of this one."""
    limits_of = {
        "image": (0, 255),
        "odometry": (-_ODOMETRY_LIMITS, _ODOMETRY_LIMITS),
        "scan": (0.0, _MAX_M),
    }
    return gymnasium.spaces.Dict(
        {
            name: gymnasium.spaces.Box(*limits_of[name], values.shape, values.dtype.type)
            for name, values in observation.items()
        }
    )
