"""Episodes of one robot on a lockstep server: spawn, drive for a while, observe.

The server's random numbers follow from its seed, the name of a robot and the ticks since its spawn.
An episode is therefore a new robot, named by a generator: the same generator gives the same
episodes without a restart of the server. An observation is a frame and the readings of its time as
named arrays. Gymnasium's interface to episodes is `gym_environment`.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_client.frame import Frame
from catoptra_client.frame_sources import ImageEncoding, StreamClient
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.usarsim.readings import OdometryReading, RangeScanReading
from catoptra_protocol.usarsim.reports import Report
from catoptra_protocol.vectors import Vector3

_FAR = 1e6
Observation = dict[str, npt.NDArray[Any]]


def observe(frame: Frame, reports: Iterable[Report]) -> Observation:
    """Arrays of what a robot measures, for the caller to keep and to write into.

    Args:
        frame: Frame of the robot's camera.
        reports: Readings of all its sensors.

    Returns:
        `image` (h, w, 3) uint8 RGB; `odometry` (3,) float32, x and y in metres and yaw in radians
        in [-pi, pi] from the pose of spawning; `scan` (n,) float32, ranges in metres from right to
        left. The latter two if the reports have them, and of several sensors the first. Channels of
        the frame's labels by their names, 1e6 m where a range is infinite and 0 for no number.
    """
    observation: Observation = {"image": frame.rgb.copy()}
    if frame.labels is not None:
        for name, values in frame.labels.truth.channels.items():
            finite = np.nan_to_num(values, posinf=_FAR) if values.dtype.kind == "f" else values
            observation[name] = finite.astype(values.dtype)
    for report in reports:
        if isinstance(report, OdometryReading):
            # Wrapped again: a heading just below pi is printed as more than pi.
            pose = (report.x_m, report.y_m, math.remainder(report.yaw_rad, math.tau))
            observation.setdefault("odometry", np.array(pose, np.float32))
        elif isinstance(report, RangeScanReading):
            observation.setdefault("scan", np.array(report.ranges_m, np.float32))
    return observation


def describe_pose(frame: Frame) -> dict[str, Floats]:
    """True pose of the robot at the exposure, in the world, in metres and radians.

    Returns:
        `pose` (3,), x, y and yaw; `z_roll_pitch` (3,), z downwards.

    Raises:
        DomainError: The frame has no pose, as those of the image port.
    """
    if frame.world_from_robot is None:
        raise DomainError("only the stream sends the robot's pose with a frame")
    x_m, y_m, z_m = frame.world_from_robot.translation
    roll, pitch, yaw = frame.world_from_robot.to_rpy()
    return {"pose": np.array((x_m, y_m, yaw)), "z_roll_pitch": np.array((z_m, roll, pitch))}


Info = dict[str, Any]
# Start pose by the environment's generator: x and y in metres, yaw in radians, in the world frame.
StartFunction = Callable[[np.random.Generator], Vector3]


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


class RobotEpisodes:
    """The robot of a client, a new one each episode."""

    def __init__(
        self,
        client: StreamClient,
        *,
        robot_class: str,
        camera: str,
        step_s: float,
        channels: Sequence[str] = (),
    ) -> None:
        """Spawn nothing yet.

        Args:
            client: Connection of the robot.
            robot_class: Class of the robot; empty = the server's first one.
            camera: Name of the camera; empty = the robot's first one.
            step_s: Simulated seconds of a step.
            channels: Channels of ground truth to observe.
        """
        self._client = client
        self._class_name = robot_class or client.get_status().class_names[0]
        self._camera, self._step_s, self._channels = camera, step_s, tuple(channels)

    @property
    def newest(self) -> tuple[Observation, Info]:
        """What the robot observed last; not a copy."""
        return self._last

    def begin(self, generator: np.random.Generator, start: Vector3) -> tuple[Observation, Info]:
        """Replace the robot by a new one at x, y and yaw; what the new one observes.

        Raises:
            CatoptraError: The server has other robots, or rejects class or camera.
        """
        self._name = f"Gym{generator.integers(2**63)}"
        x_m, y_m, yaw_rad = map(float, start)
        self._client.reset()
        self._client.spawn(
            self._class_name,
            name=self._name,
            location_m=(x_m, y_m, 0.0),
            rotation_rad=(0.0, 0.0, yaw_rad),
        )
        names = [robot.name for robot in self._client.get_state().robots]
        if names != [self._name]:
            raise CatoptraError(
                f"the server has other robots ({', '.join(names)}): an environment needs a server "
                "of its own, since a step advances the time of all robots"
            )
        self._num_steps = 0
        return self._observe(self._client.step(0.0))

    def advance(self, speeds: npt.NDArray[np.float64]) -> Transition:
        """Drive for a step by (2,) fractions of the largest wheel speeds, left and right."""
        self._client.drive(*(100.0 * speeds).tolist(), normalized=True)
        reports = self._client.step(self._step_s)
        self._num_steps += 1
        before = self._last
        return Transition(*before, speeds, *self._observe(reports))

    def _observe(self, reports: Iterable[Report]) -> tuple[Observation, Info]:
        """Observation and info of the present, from the readings of all sensors and a frame."""
        frame = self._client.get_frame(
            encoding=ImageEncoding.RAW,
            robot=self._name,
            camera=self._camera,
            channels=self._channels,
        )
        observation = observe(frame, reports)
        # Counted from the start: differences of the server's times would round by its age.
        info: Info = {**describe_pose(frame), "time_s": self._num_steps * self._step_s}
        # Copies: the caller may write into what is returned.
        self._last = copy.deepcopy((observation, info))
        return observation, info
