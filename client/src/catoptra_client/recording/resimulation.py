"""A recorded drive simulated again: its commands at their instants into a lockstep server.

Seed, options and configuration files are those of the recording. What was recorded must come again
to the byte: pose and readings of each state, picture and labels of each frame. Pictures that a
real-time server took between two ticks are taken from their recorded poses.

Domain: the recorded robot is alone in its world, and the recording has its commands from INIT on.
Under a lockstep clock that others stepped, too, their steps were whole ticks.
"""

from __future__ import annotations

import hashlib
import heapq
import importlib.util
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from catoptra_client.control_connection import ControlConnection, ServerAddress, open_connection
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.recording.recording import RecordedFrame, RecordedState, Recording
from catoptra_client.server_process import connect_stream, start_server
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.replies import CommandRecord
from catoptra_protocol.stream.requests import FrameVariant, GetFrameRequest
from catoptra_protocol.usarsim.commands import GetStartPoses, Init, command_from_message
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.reports import StartPoses

NS_PER_S = 1_000_000_000
_TICK_NS = 20_000_000
# Whole ticks, so that a long step has the ticks of one step.
_MAX_STEP_NS = NS_PER_S
_TIMEOUT_S = 60.0
# Observations of one instant that no command before them explains.
_MAX_UNMATCHED = 64
_OPTIONS = ("seed", "renderer", "dialect", "max-error-px", "budget-ms")
_Observation = RecordedFrame | RecordedState
# What is due, and when in ns.
_Item = tuple[int, _Observation | CommandRecord]


@dataclass(frozen=True, slots=True)
class Resimulation:
    """Outcome: what came again, up to the first difference."""

    span_s: float
    """Simulated time."""
    num_states: int
    num_frames: int
    difference: str = ""
    """Time, topic and values of the first difference; empty where all is the same."""


@contextmanager
def run_recorded_server(
    recording: Recording,
    *,
    files: Path | None = None,
    robot_files: tuple[Path, ...] = (),
    options: tuple[str, ...] = (),
) -> Iterator[ServerAddress]:
    """Run a lockstep server with the files and options of a recording.

    Args:
        recording: Recording.
        files: Folder with the recorded files and what these refer to; those that are not there,
            or of other contents, are taken from the server or from the recording.
        robot_files: Other robots than the recorded ones.
        options: Options of catoptra-server that take the place of the recorded ones.

    Raises:
        CatoptraError: A file is missing, or the server does not start.
    """
    recorded = recording.tables.get("catoptra_setup", {})
    with tempfile.TemporaryDirectory() as folder:
        names = [*recorded.get("robot", "").split("\n")] if not robot_files else []
        paths = [_find_file(recording, name, Path(folder), files) for name in names]
        arguments = [f"--robot={path}" for path in (*paths, *robot_files)]
        for key in ("world", "server-ini"):
            if key == "world" or key in recorded:
                path = _find_file(recording, recorded.get(key, ""), Path(folder), files)
                arguments.append(f"--{key}={path}")
        arguments += [f"--{key}={recorded[key]}" for key in _OPTIONS if key in recorded]
        ports = ("--control-port=0", "--image-port=0")
        log_file = Path(folder, "server.log")
        arguments += [*options, "--clock=lockstep", *ports]
        with start_server(tuple(arguments), log_file=log_file) as address:
            yield address


def _find_file(recording: Recording, name: str, folder: Path, files: Path | None) -> Path:
    """Recorded file: the user's, the same one of the server's, or written into a folder."""
    digest = recording.tables.get("catoptra_digests", {}).get(name, "")
    # Found, not imported: a client never loads the server's code.
    server = importlib.util.find_spec("catoptra_server")
    bundled = [Path(one, "configs") for one in (server and server.submodule_search_locations) or ()]
    folders = [one / kind for one in bundled for kind in ("robots", "worlds")]
    folders = [files, *folders] if files else folders
    for path in (one / Path(name).name for one in folders):
        with suppress(OSError):
            if hashlib.sha256(path.read_bytes()).hexdigest() == digest:
                return path
    if name not in recording.files:
        raise recording.error(
            f"the recorded file {name[:60]!r} is not there as it was: --files names its folder"
        )
    # Names of attachments have no folders.
    path = folder / name
    path.write_bytes(recording.files[name])
    return path


def resimulate(
    recording: Recording,
    *,
    files: Path | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
) -> Resimulation:
    """Simulate a recorded drive in a new process, and compare it with the recording.

    Args:
        recording: Recording.
        files: As in `run_recorded_server`.
        on_progress: Receives each simulation time.

    Raises:
        CatoptraError: The recording has no commands from INIT on, or other robots; or the server
            does not start.
    """
    with run_recorded_server(recording, files=files) as address, ExitStack() as stack:
        clock = stack.enter_context(connect_stream(address, timeout_s=_TIMEOUT_S))
        connection = open_connection(
            address.host, address.control_port, _TIMEOUT_S, server_kind="control"
        )
        owner = ControlConnection(connection, timeout_s=_TIMEOUT_S, clock=time.monotonic)
        stack.callback(owner.close)
        run = _Repetition(recording, clock, owner)
        for time_ns, event in _merge(recording):
            run.advance(time_ns)
            if isinstance(event, CommandRecord):
                run.execute(event)
            else:
                run.compare(event)
            if run.difference:
                break
            on_progress(time_ns / NS_PER_S)
        run.flush()
        first_s = recording.span_s[0]
        return Resimulation(
            run.time_ns / NS_PER_S - first_s, run.num_states, run.num_frames, run.difference
        )


def _merge(recording: Recording) -> Iterator[_Item]:
    """Frames, states and commands by the tick at which they were; frames first.

    Each kind is in order in the file; of all together a frame may follow a newer state.
    """
    is_realtime = recording.is_realtime

    def frame_ns(frame: RecordedFrame) -> int:
        time_ns = round(frame.time_s * NS_PER_S)
        # A picture between two ticks is taken after the second one.
        return -(-time_ns // _TICK_NS) * _TICK_NS if is_realtime else time_ns

    def list_frames() -> Iterator[_Item]:
        for one in recording.iter_events():
            if isinstance(one, RecordedFrame):
                yield frame_ns(one), one

    def list_states() -> Iterator[_Item]:
        for one in recording.iter_events():
            if isinstance(one, RecordedState):
                yield round(one.time_s * NS_PER_S), one

    def list_commands() -> Iterator[_Item]:
        for one in recording.iter_commands():
            yield round(one.time_s * NS_PER_S), one

    kinds = list_frames(), list_states(), list_commands()
    yield from heapq.merge(*kinds, key=lambda item: item[0])


@dataclass(slots=True, eq=False)
class _Repetition:
    """A drive that is simulated again."""

    recording: Recording
    clock: StreamClient
    """Steps the clock, and observes; it has no robot, whose sensors a step would read."""
    owner: ControlConnection
    time_ns: int = 0
    num_commands: int = 0
    num_states: int = 0
    num_frames: int = 0
    difference: str = ""
    unmatched: list[tuple[_Observation, str]] = field(default_factory=list)
    """Observations of this instant, and how they differ, from which a command may yet follow."""

    def advance(self, time_ns: int) -> None:
        """Let time pass; what is unmatched by then is a difference."""
        if time_ns <= self.time_ns:
            return
        self.flush()
        while not self.difference and self.time_ns < time_ns:
            step_ns = min(time_ns - self.time_ns, _MAX_STEP_NS)
            self.clock.step(step_ns / NS_PER_S)
            self.time_ns += step_ns

    def flush(self) -> None:
        """Report what is unmatched."""
        if self.unmatched and not self.difference:
            observation, reason = self.unmatched[0]
            self.difference = f"{observation.time_s:.4f} s, {reason}"

    def execute(self, record: CommandRecord) -> None:
        """Execute a command, and compare again what differed."""
        self.num_commands += 1
        command = command_from_message(parse_message(record.line))
        is_first = self.num_commands == 1
        if record.number != self.num_commands or isinstance(command, Init) is not is_first:
            raise self.recording.error(
                f"command {record.number} follows {self.num_commands - 1}: those from INIT on "
                "are not all there"
            )
        if command is None:
            raise self.recording.error(f"command {record.number} is none: {record.line[:60]!r}")
        if isinstance(command, Init):
            # The name that the robot got, from which its random numbers follow.
            command = replace(command, name=self.recording.robot)
        self.owner.send(command)
        # The reply to this one comes behind it.
        self.owner.send(GetStartPoses())
        self.owner.wait_for_report(StartPoses, "its start poses")
        again, self.unmatched = self.unmatched, []
        for observation, _ in again:
            self.compare(observation)

    def compare(self, observation: _Observation) -> None:
        """Compare a state or a frame with that of now."""
        is_frame = isinstance(observation, RecordedFrame)
        reason = (
            self._compare_frame(observation)
            if isinstance(observation, RecordedFrame)
            else self._compare_state(observation)
        )
        if reason:
            self.unmatched.append((observation, reason))
            if len(self.unmatched) > _MAX_UNMATCHED:
                self.flush()
            return
        self.num_frames += is_frame
        self.num_states += not is_frame

    def _compare_state(self, recorded: RecordedState) -> str:
        """Topic and values of a difference; empty for none."""
        before, state = recorded.state, self.clock.get_state(self.recording.robot)
        if len(before.robots) != 1:
            raise self.recording.error(
                f"{len(before.robots)} robots, of which one was recorded: it was not alone"
            )
        poses = [robot.world_from_robot for one in (before, state) for robot in one.robots]
        if len(poses) != 2 or poses[0] != poses[1]:
            places = " and ".join(str(pose.position_m) for pose in poses)
            return f"/catoptra/state: the robot is at {places}"
        for line, now in zip(before.reports, state.reports, strict=False):
            if line != now:
                return f"/catoptra/state: {line[:120]!r} is {now[:120]!r} now"
        num, num_now = len(before.reports), len(state.reports)
        return "" if num == num_now else f"/catoptra/state: {num} readings are {num_now} now"

    def _compare_frame(self, recorded: RecordedFrame) -> str:
        """Topic of a difference; empty for none."""
        header = recorded.header
        is_between = round(header.time_s * NS_PER_S) != self.time_ns
        variant = FrameVariant(
            picture=(header.camera_model or {}).get("Picture"),
            world_from_robot=header.world_from_robot if is_between else None,
        )
        names = tuple(one.name for one in header.labels.channels) if header.labels else ()
        request = GetFrameRequest(
            *(0, self.recording.robot, header.camera, header.encoding),
            *(None if variant == FrameVariant() else variant, names),
        )
        try:
            now, parts = self.clock.get_encoded_frame(request)
        except CatoptraError as error:
            return f"/{header.camera}/image/compressed: {error}"
        if now.world_from_robot != header.world_from_robot:
            return f"/catoptra/frame: pose {header.world_from_robot} is {now.world_from_robot} now"
        topics = ["image/compressed", *names]
        for topic, before, after in zip(topics, recorded.parts, parts, strict=True):
            if before != after:
                plan = "" if now.plan == header.plan else f"; the plan {header.plan} is {now.plan}"
                return f"/{header.camera}/{topic}: other bytes{plan}"
        return ""
