"""The simulation's loop with a fake client, a fake view and a fake clock: no thread, no waiting.

All events are posted beforehand; a callback of the loop posts StopRequested.
"""

from __future__ import annotations

import dataclasses
import itertools
import logging
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.usarsim.commands import (
    COMMAND_PARSERS,
    Command,
    Drive,
    DriveJoints,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    JointCommand,
    LinkCommand,
    MisPkg,
    MultiDrive,
    Note,
    SetCommand,
    SetViewports,
    ShareControl,
    StepCommand,
    Stepper,
    Trace,
)
from catoptra_protocol.usarsim.control_connection import ControlServer
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    Greeting,
    GroundTruthReading,
    Report,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Channel,
    Frame,
    FrameComposition,
    FrameRendered,
    FrameRequest,
    FrameRequested,
    ImagePortChannel,
    ViewRequest,
)
from catoptra_server.frames.render_thread import render_frame
from catoptra_server.simulation.events import (
    AccuracyTargetChanged,
    Client,
    ClientDisconnected,
    CommandReceived,
    Fault,
    LandmarksRequested,
    ResetRequested,
    StepRequested,
    StepResult,
    StopRequested,
)
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.fleet_cameras import FleetCameras
from catoptra_server.simulation.loop import ClockMode, Simulation
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.world.scene_mesh import build_scene
from helpers.loopback import DEADLINE_S
from helpers.robots import (
    CAMERA,
    ENCODER,
    GPS,
    GROUND_TRUTH,
    INS,
    ODOMETRY,
    RFID,
    SCANNER,
    SONAR,
    TACHOMETER,
    TOUCH,
    VICTIMS,
    FakeClient,
    FakeView,
    FakeViewProvider,
    make_noisy_p2at,
    make_p2at,
    make_walled_world,
)

INIT = Init("OmniP2AT", name="R", location_m=(0.0, 0.0, 0.0))
# Built once: hundreds of simulations are made.
WORLD = make_walled_world()
SCENE = build_scene(WORLD)


def make_simulation(
    description: RobotDescription | None = None,
    *,
    clock: ClockMode = ClockMode.LOCKSTEP,
    seed: int = 1,
    monotonic: Callable[[], float] = lambda: 0.0,
    put_frame: Callable[[Frame], None] = lambda frame: None,
    view: FakeView | None = None,
    frame_skip: int = 1,
) -> Simulation:
    described = description or make_p2at()
    fleet, views = Fleet([described], WORLD, SCENE, seed=seed), FakeViewProvider(view)

    def draw(frame_request: FrameRequest) -> None:
        frame = render_frame(frame_request, views, monotonic=monotonic)
        simulation.post(FrameRendered(frame_request.channel))
        put_frame(frame)

    simulation = Simulation(
        fleet,
        clock=clock,
        render=draw,
        reject=lambda channel, reason: None,
        frame_skip=frame_skip,
        monotonic=monotonic,
    )
    return simulation


def run_commands(
    *commands: Command, seed: int = 1, description: RobotDescription | None = None
) -> FakeClient:
    """Client that has sent these commands to a lockstep simulation."""
    simulation, client = make_simulation(description, seed=seed), FakeClient()
    for command in commands:
        post_command(simulation, client, command)
    run_until_served(simulation)
    return client


def post_command(simulation: Simulation, client: FakeClient, command: Command) -> None:
    """Post a command as the control port does: a step has a RES as its reply."""
    if isinstance(command, StepCommand):
        simulation.post(StepRequested(client, command.time_s, partial(_deliver_step, client)))
    else:
        simulation.post(CommandReceived(client, command))


def _deliver_step(client: FakeClient, step: StepResult) -> None:
    status = "Failed" if step.failure else "OK"
    client.deliver([*step.readings, CommandResult(step.time_s, "Step", "Clock", status)])


def run_until_served(simulation: Simulation) -> None:
    """Run a simulation until all work posted so far is served."""
    simulation.post(ResetRequested(FakeClient(), lambda: post_stop(simulation)))
    simulation.run()


def post_stop(simulation: Simulation) -> None:
    simulation.post(StopRequested())


COMMANDS: tuple[Command, ...] = (
    Init("OmniP2AT", location_m=(1.0, 0.0, 0.0)),
    Drive(1.0, 1.0),
    DriveJoints((JointCommand("CameraPan", 0.1),)),
    MultiDrive((("CameraPan", 0.1),)),
    MisPkg("CameraPanTilt", (LinkCommand(1, 0.1),)),
    SetCommand("Odometry", opcode="RESET"),
    SetViewports("SingleView"),
    Trace(enabled=True),
    GetConf("Robot"),
    GetGeo("Robot"),
    GetStartPoses(),
    StepCommand(0.02),
    Stepper(),
    Note("ekf", "{}"),
    ShareControl(True),
)


def test_commands_when_listed_are_all_of_the_protocol() -> None:
    assert {type(command) for command in COMMANDS} == set(get_args(Command))


@pytest.mark.parametrize("is_spawned", [True, False])
@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: type(command).__name__)
def test_command_when_of_the_protocol_is_handled(
    command: Command, is_spawned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    run_commands(*([INIT] if is_spawned else []), command)
    # A command without a case raises in `Fleet.execute`, and is logged as a fault.
    assert "failed and was dropped" not in caplog.text


def results(client: FakeClient) -> list[CommandResult]:
    return [report for report in client.reports if isinstance(report, CommandResult)]


def report_bytes(client: FakeClient) -> bytes:
    return b"".join(map(line_from_report, client.reports))


def test_step_when_of_200_ms_prints_multiples_of_it() -> None:
    client = run_commands(INIT, *(100 * [StepCommand(0.2)]))
    lines = [line_from_report(result) for result in results(client)]
    assert lines[0] == b"RES {Time 0.2000} {Type Step} {Name Clock} {Status OK}\r\n"
    assert [line.split(b"}")[0].rpartition(b" ")[2] for line in lines] == [
        f"{(i + 1) / 5:.4f}".encode() for i in range(100)
    ]


@pytest.mark.parametrize("time_s", [0.013, 1.0 / 3.0, 0.02, 0.05, 7e-9])
def test_step_when_no_multiple_of_a_tick_adds_up(time_s: float) -> None:
    client = run_commands(INIT, *(150 * [StepCommand(time_s)]))
    # A step counts whole nanoseconds.
    assert results(client)[-1].time_s == pytest.approx(150 * round(time_s * 1e9) / 1e9, abs=1e-12)


def test_step_when_done_ends_with_a_whole_cycle_and_its_result() -> None:
    client = run_commands(INIT, StepCommand(0.1))
    assert [r.WORD for r in client.batches[-1]] == ["SEN", "SEN", "STA", "RES"]
    truth = client.batches[-1][1]
    assert isinstance(truth, GroundTruthReading)
    assert truth.time_s == 0.1


def test_step_when_reports_become_due_delivers_them_in_order() -> None:
    client = run_commands(INIT, StepCommand(0.5))
    times = [r.time_s for r in client.reports if isinstance(r, GroundTruthReading)]
    assert times == [0.0, 0.2, 0.4, 0.5]


def test_step_when_of_0_s_reads_the_sensors_and_no_time_passes() -> None:
    client = run_commands(INIT, StepCommand(0.0))
    assert [r.WORD for r in client.batches[-1]] == ["SEN", "SEN", "STA", "RES"]
    assert results(client) == [CommandResult(0.0, "Step", "Clock", "OK")]


@pytest.mark.parametrize("time_s", [-0.1, -1e-12, 60.001, 1e300])
def test_step_when_negative_or_too_long_fails_and_no_time_passes(time_s: float) -> None:
    client = run_commands(INIT, StepCommand(time_s), StepCommand(0.1))
    assert [(r.time_s, r.status) for r in results(client)] == [(0.0, "Failed"), (0.1, "OK")]
    assert [report.WORD for report in client.batches[1]] == ["RES"]


def test_step_when_of_a_minute_is_the_longest() -> None:
    assert results(run_commands(StepCommand(60.0))) == [CommandResult(60.0, "Step", "Clock", "OK")]


def test_step_when_slower_than_the_budget_of_a_tick_does_not_delay_the_next() -> None:
    client, steps = FakeClient(), list[StepResult]()

    def reply(step: StepResult) -> None:
        steps.append(step)
        if len(steps) < 3:
            simulation.post(StepRequested(client, 0.1, reply))
        else:
            post_stop(simulation)

    simulation = make_simulation(monotonic=TickingClock(1.0))
    simulation.post(StepRequested(client, 0.1, reply))
    # A daemon: a simulation that waits for ever must not keep the test run alive.
    thread = threading.Thread(target=simulation.run, daemon=True)
    thread.start()
    thread.join(DEADLINE_S)
    assert len(steps) == 3


def test_step_without_a_robot_has_only_a_result() -> None:
    client = run_commands(Drive(1.0, 1.0), GetConf("Robot"), StepCommand(0.2))
    assert client.reports == [CommandResult(0.2, "Step", "Clock", "OK")]


@pytest.mark.parametrize("has_robot", [False, True])
def test_step_of_a_connection_that_has_not_declared_itself_needs_a_robot(has_robot: bool) -> None:
    client, steps = FakeClient(), list[StepResult]()
    simulation = make_simulation()

    def reply(step: StepResult) -> None:
        steps.append(step)
        post_stop(simulation)

    if has_robot:
        simulation.post(CommandReceived(client, INIT))
    simulation.post(StepRequested(client, 0.1, reply, is_declared=False))
    simulation.run()
    (result,) = steps
    assert result.time_s == (0.1 if has_robot else 0.0)
    assert ("has not sent STEPPER" in result.failure) is not has_robot


def test_time_without_steps_stands_still() -> None:
    client = run_commands(INIT, Drive(2.0, 2.0), StepCommand(0.0))
    truth = [r for r in client.reports if isinstance(r, GroundTruthReading)][-1]
    assert (truth.time_s, truth.location_m[0]) == (0.0, 0.0)


DRIVE_COMMANDS = [
    INIT,
    *(c for i in range(20) for c in (Drive(1.0 + 0.1 * i, 2.0 - 0.1 * i), StepCommand(0.13))),
]


def test_run_when_the_seed_or_the_name_differs_gives_others() -> None:
    one = run_commands(*DRIVE_COMMANDS, description=make_noisy_p2at())
    by_seed = run_commands(*DRIVE_COMMANDS, description=make_noisy_p2at(), seed=2)
    renamed = Init("OmniP2AT", name="S", location_m=INIT.location_m)
    by_name = run_commands(renamed, *DRIVE_COMMANDS[1:], description=make_noisy_p2at())
    assert len({report_bytes(one), report_bytes(by_seed), report_bytes(by_name)}) == 3


def test_run_when_another_robot_is_there_gives_the_same_bytes() -> None:
    alone = run_commands(*DRIVE_COMMANDS, description=make_noisy_p2at())
    simulation, client, other = make_simulation(make_noisy_p2at()), FakeClient(), FakeClient()
    simulation.post(
        CommandReceived(other, Init("OmniP2AT", name="Other", location_m=(9.0, 1.0, 0.0)))
    )
    simulation.post(CommandReceived(other, Drive(1.0, -1.0)))
    for command in DRIVE_COMMANDS:
        post_command(simulation, client, command)
    run_until_served(simulation)
    assert report_bytes(client) == report_bytes(alone)


def test_run_with_frames_gives_the_same_bytes() -> None:
    alone = run_commands(*DRIVE_COMMANDS, description=make_noisy_p2at())
    simulation, client = make_simulation(make_noisy_p2at()), FakeClient()
    for command in DRIVE_COMMANDS:
        simulation.post(FrameRequested())
        post_command(simulation, client, command)
    run_until_served(simulation)
    assert report_bytes(client) == report_bytes(alone)


def test_robot_when_reset_is_removed_and_its_name_is_free() -> None:
    simulation, one, other = make_simulation(), FakeClient(), FakeClient()
    for request in (
        CommandReceived(one, INIT),
        ResetRequested(one, lambda: None),
        CommandReceived(other, INIT),
    ):
        simulation.post(request)
    post_command(simulation, other, StepCommand(0.2))
    run_until_served(simulation)
    assert len(one.batches) == 1
    assert other.spawns == [("R", None)]
    assert results(other)


_BLOCKS = st.lists(
    st.tuples(
        st.sampled_from(["Type", "Name", "ClassName", "Location", "Start", "Left", "Time", "X"]),
        st.text(alphabet=st.characters(max_codepoint=255, exclude_characters="\r\n"), max_size=300),
    ),
    max_size=4,
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted(COMMAND_PARSERS)), _BLOCKS), max_size=5))
def test_arbitrary_commands_have_replies_that_can_be_sent(
    messages: list[tuple[str, list[tuple[str, str]]]],
) -> None:
    server, client = ControlServer(), FakeClient()
    server.send(Greeting("BotDeathMatch", "walls"))
    lines = [f"{word} " + "".join(f"{{{n} {v}}}" for n, v in blocks) for word, blocks in messages]
    simulation = make_simulation()
    whole = ("INIT {ClassName OmniP2AT} {Location 0,0,0}", *lines, "STEP {Time 0.1}", "")
    for command in server.receive("\r\n".join(whole).encode("latin-1")):
        # A step of a minute is right, but three thousand ticks long.
        if not (isinstance(command, StepCommand) and command.time_s > 1.0):
            post_command(simulation, client, command)
    run_until_served(simulation)
    assert results(client)[-1].status == "OK"
    assert all(line_from_report(report).endswith(b"\r\n") for report in client.reports)


class FrameCollector:
    """Stores frames; stops the simulation after some."""

    def __init__(self, count: int) -> None:
        self.simulation: Simulation | None = None
        self.frames: list[Frame] = []
        self._count = count

    def put(self, frame: Frame) -> None:
        self.frames.append(frame)
        assert self.simulation is not None
        done = len(self.frames) == self._count
        self.simulation.post(StopRequested() if done else FrameRequested(channel=frame.channel))


def collect_frames(count: int, *requests: object, view: FakeView) -> list[Frame]:
    """First frames of a lockstep simulation after some events."""
    keeper = FrameCollector(count)
    keeper.simulation = make_simulation(put_frame=keeper.put, view=view)
    for request in requests:
        keeper.simulation.post(request)  # type: ignore[arg-type] # the callers pass requests
    keeper.simulation.run()
    return keeper.frames


def test_frame_when_requested_several_times_is_rendered_once() -> None:
    view, client = FakeView(), FakeClient()
    (frame,) = collect_frames(
        1, CommandReceived(client, INIT), *(5 * [FrameRequested()]), view=view
    )
    assert len(view.camera_states) == 1
    assert (frame.sequence, frame.metadata.camera, frame.time_s) == (1, "OmniCam", 0.0)
    np.testing.assert_array_equal(frame.rgb, 1)


def test_frame_after_a_step_shows_the_new_pose() -> None:
    view, client = FakeView(), FakeClient()
    posted = [CommandReceived(client, c) for c in (INIT, Drive(2.0, 2.0))]
    step = StepRequested(client, 1.0, lambda result: None)
    (frame,) = collect_frames(1, *posted, step, FrameRequested(), view=view)
    assert frame.time_s == 1.0
    assert frame.metadata.world_from_robot.translation[0] == pytest.approx(0.26)


def test_frame_when_requested_during_rendering_is_rendered_once() -> None:
    view, drawn = FakeView(), []

    def wanted_meanwhile(frame: Frame) -> None:
        """Request frame 1 while it is rendered, as a client would."""
        drawn.append(frame)
        simulation.post(FrameRequested(newer_than=0))
        simulation.post(FrameRequested(newer_than=0))
        simulation.post(StopRequested())

    simulation = make_simulation(put_frame=wanted_meanwhile, view=view)
    simulation.post(FrameRequested(newer_than=0))
    simulation.run()
    assert [frame.sequence for frame in drawn] == [1]


def test_frames_of_one_tick_are_composed_once_unless_a_command_comes_between(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    composed: list[Channel] = []
    compose = FleetCameras.compose_frame

    def count_compose(cameras: FleetCameras, channel: Channel) -> FrameComposition | None:
        composed.append(channel)
        return compose(cameras, channel)

    monkeypatch.setattr(FleetCameras, "compose_frame", count_compose)
    view, client = FakeView(), FakeClient()
    frames = collect_frames(4, CommandReceived(client, INIT), FrameRequested(), view=view)
    assert (len(frames), len(composed)) == (4, 1)
    # Requests and work of one turn: frames show the effect of all work before them.
    posted = [CommandReceived(client, INIT), StepRequested(client, 0.02, lambda result: None)]
    frames = collect_frames(2, FrameRequested(), *posted, view=view)
    assert [frame.metadata.robot for frame in frames] == ["R", "R"]
    assert len(composed) == 2


@pytest.mark.parametrize("clock", ClockMode)
def test_frame_after_a_command_shows_its_effect_without_a_tick(clock: ClockMode) -> None:
    client, names = FakeClient(), []

    def spawn_after_the_first(frame: Frame) -> None:
        names.append(frame.metadata.robot)
        simulation.post(CommandReceived(client, INIT))
        simulation.post(FrameRequested() if len(names) == 1 else StopRequested())

    simulation = make_simulation(clock=clock, put_frame=spawn_after_the_first, view=FakeView())
    simulation.post(FrameRequested())
    simulation.run()
    assert names == ["", "R"]


def test_frame_of_a_driving_robot_is_captured_at_once_by_the_thread_that_requests_it() -> None:
    threads: list[threading.Thread] = []
    times_s: list[float] = []

    def put(frame: Frame) -> None:
        threads.append(threading.current_thread())
        times_s.append(frame.time_s)
        if threads[-1] is not threading.main_thread() or len(threads) > 500:
            simulation.post(StopRequested())
            return
        other = threading.Thread(target=simulation.post, args=(FrameRequested(),))
        other.start()
        other.join()

    now_s = itertools.count(0.0, 5e-4)
    simulation = make_simulation(
        clock=ClockMode.REALTIME, put_frame=put, monotonic=now_s.__next__, view=FakeView()
    )
    client = FakeClient()
    for command in (INIT, Drive(1.0, 1.0)):
        post_command(simulation, client, command)
    simulation.post(FrameRequested())
    simulation.run()
    # A later instant of the same tick, a part of 20 ms.
    assert threads[-1] is not threads[-2]
    assert times_s[-2] < times_s[-1] < times_s[-2] + 0.02


def test_frame_under_lockstep_is_captured_by_the_simulation_alone() -> None:
    keeper = FrameCollector(2)
    keeper.simulation = make_simulation(put_frame=keeper.put)
    keeper.simulation.post(FrameRequested())
    assert keeper.frames == []
    keeper.simulation.run()
    keeper.simulation.post(FrameRequested())
    assert len(keeper.frames) == 2


def test_camera_without_requests_is_not_rendered() -> None:
    view = FakeView()
    simulation, client = make_simulation(view=view), FakeClient()
    for command in (INIT, StepCommand(5.0)):
        post_command(simulation, client, command)
    run_until_served(simulation)
    assert view.camera_states == []


class TickingClock:
    """A clock that advances by a fixed step with every reading, after some jumps."""

    def __init__(self, step_s: float, *jumps_s: float) -> None:
        self._now_s = 100.0
        self._step_s = step_s
        self._jumps_s = list(jumps_s)

    def __call__(self) -> float:
        self._now_s += self._jumps_s.pop(0) if self._jumps_s else self._step_s
        return self._now_s


class StoppingClient(FakeClient):
    """A client that stops the simulation when its status is of a time or later."""

    def __init__(self, until_s: float) -> None:
        super().__init__()
        self.simulation: Simulation | None = None
        self._until_s = until_s

    def deliver(self, reports: Sequence[Report]) -> None:
        super().deliver(reports)
        if any(isinstance(r, VehicleStatus) and r.time_s >= self._until_s for r in reports):
            assert self.simulation is not None
            self.simulation.post(StopRequested())


def run_realtime(
    until_s: float, monotonic: Callable[[], float], *commands: Command
) -> StoppingClient:
    client = StoppingClient(until_s)
    client.simulation = make_simulation(clock=ClockMode.REALTIME, monotonic=monotonic)
    for command in (INIT, *commands):
        post_command(client.simulation, client, command)
    client.simulation.run()
    return client


def test_realtime_runs_in_ticks_of_the_clock() -> None:
    # 30 ms a reading, so that no wait is needed: every tick has passed when the loop reads.
    client = run_realtime(1.0, TickingClock(0.03), Drive(2.0, 2.0))
    truths = [r for r in client.reports if isinstance(r, GroundTruthReading)]
    assert [t.time_s for t in truths] == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    # DRIVE waits for the ticks that INIT's readings of the clock took; then 5.2 mm a tick.
    num_ticks = truths[-1].location_m[0] / 0.0052
    assert num_ticks == pytest.approx(round(num_ticks), abs=1e-6)
    assert 35 < num_ticks < 50


def test_realtime_when_stepped_fails() -> None:
    client = run_realtime(0.2, TickingClock(0.03), StepCommand(0.1))
    assert [result.status for result in results(client)] == ["Failed"]


def test_realtime_far_behind_continues_from_the_present(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        client = run_realtime(0.2, TickingClock(0.03, 0.0, 0.0, 7.0))
    assert "lags by 7." in caplog.text
    times = [r.time_s for r in client.reports if isinstance(r, VehicleStatus)]
    assert times == [0.0, 0.2]


def test_realtime_that_lags_captures_frames_between_a_few_ticks() -> None:
    keeper = FrameCollector(6)
    clock = TickingClock(0.06)  # three ticks pass with every reading

    def put_after_a_command(frame: Frame) -> None:
        # The next frame is left to the simulation while work is waiting.
        simulation.post(CommandReceived(FakeClient(), GetStartPoses()))
        keeper.put(frame)

    simulation = keeper.simulation = make_simulation(
        clock=ClockMode.REALTIME, monotonic=clock, put_frame=put_after_a_command
    )
    simulation.post(FrameRequested())
    simulation.run()
    times = np.array([frame.time_s for frame in keeper.frames])
    assert (np.diff(times) <= 4 * 0.02 + 1e-9).all()


def test_realtime_when_frames_have_an_interval_keeps_it() -> None:
    camera = dataclasses.replace(CAMERA, min_frame_interval_s=0.1)
    keeper = FrameCollector(4)
    keeper.simulation = make_simulation(
        make_p2at(omni_cameras=(camera,)),
        clock=ClockMode.REALTIME,
        monotonic=TickingClock(0.03),
        put_frame=keeper.put,
    )
    # Without a robot there is no camera, and no interval of one.
    keeper.simulation.post(CommandReceived(FakeClient(), INIT))
    keeper.simulation.post(FrameRequested())
    keeper.simulation.run()
    times = np.array([frame.time_s for frame in keeper.frames])
    # The interval can be missed by one tick.
    assert (np.diff(times) >= 0.1 - 1e-9).all()
    assert (np.diff(times) < 0.2).all()


@pytest.mark.parametrize(
    ("channel", "least_s"),
    [(IMAGE_PORT, 0.2), (ImagePortChannel(1), 0.2), (CameraChannel("R", ""), 0.0)],
)
def test_realtime_with_frame_skip_limits_the_image_port_alone(
    channel: Channel, least_s: float
) -> None:
    keeper = FrameCollector(4)
    simulation = keeper.simulation = make_simulation(
        clock=ClockMode.REALTIME, monotonic=TickingClock(0.01), put_frame=keeper.put, frame_skip=10
    )
    simulation.post(CommandReceived(FakeClient(), INIT))
    simulation.post(FrameRequested(channel=channel))
    simulation.run()
    gaps = np.diff([frame.time_s for frame in keeper.frames])
    assert (gaps >= least_s - 1e-9).all()
    assert (gaps < least_s + 0.15).all()


def test_landmarks_when_requested_have_the_time_and_none_without_the_camera() -> None:
    simulation, replies = make_simulation(), list[object]()
    client = FakeClient()
    simulation.post(CommandReceived(client, INIT))
    post_command(simulation, client, StepCommand(0.5))
    for name in ("R", "Other"):
        channel = CameraChannel(name, "")
        reply = LandmarksRequested(client, channel, lambda *answer: replies.append(answer))
        simulation.post(reply)
    run_until_served(simulation)
    assert replies == [(0.5, ()), (0.5, None)]


def test_camera_when_another_client_disconnects_keeps_its_count() -> None:
    frames, drawn = list[Frame](), CameraChannel("", "")

    def put(frame: Frame) -> None:
        frames.append(frame)
        if len(frames) == 1:
            simulation.post(ClientDisconnected(FakeClient()))
        simulation.post(StopRequested() if len(frames) == 2 else FrameRequested(channel=drawn))

    simulation = make_simulation(put_frame=put)
    for request in (CommandReceived(FakeClient(), INIT), FrameRequested(channel=drawn)):
        simulation.post(request)
    simulation.run()
    assert [frame.sequence for frame in frames] == [1, 2]


class _FaultyFleet(Fleet):
    """A fleet in which the work of one client raises."""

    faulty: FakeClient | None = None

    def execute(self, client: Client, command: Command, time_s: float) -> None:
        self._raise_for(client)
        super().execute(client, command, time_s)

    def set_accuracy_target(self, event: AccuracyTargetChanged) -> tuple[ViewRequest | None, str]:
        self._raise_for(event.client)
        return super().set_accuracy_target(event)

    def _raise_for(self, client: Client) -> None:
        if client is self.faulty:
            raise ZeroDivisionError("command")


def make_faulty_simulation(rejected: list[tuple[Channel, str]] | None = None) -> Simulation:
    fleet: Any = _FaultyFleet([make_p2at()], WORLD, SCENE, seed=1)
    find = fleet.cameras.find

    def find_or_raise(channel: CameraChannel) -> object:
        if channel.robot == "faulty":
            raise ZeroDivisionError("camera")
        return find(channel)

    fleet.cameras.find = find_or_raise
    return Simulation(
        fleet,
        clock=ClockMode.LOCKSTEP,
        render=lambda request: None,
        reject=lambda *rejection: (rejected if rejected is not None else []).append(rejection),
    )


def fleet_of(simulation: Simulation) -> _FaultyFleet:
    fleet = simulation._fleet
    assert isinstance(fleet, _FaultyFleet)
    return fleet


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: type(command).__name__)
def test_command_when_raising_is_dropped_and_other_clients_go_on(
    command: Command, caplog: pytest.LogCaptureFixture
) -> None:
    simulation, faulty, other = make_faulty_simulation(), FakeClient(), FakeClient()
    fleet_of(simulation).faulty = faulty
    for client, each in ((other, INIT), (faulty, command), (other, StepCommand(0.2))):
        post_command(simulation, client, each)
    run_until_served(simulation)
    assert [result.status for result in results(other)] == ["OK"]
    if not isinstance(command, StepCommand):  # time is nobody's robot: a step raises nowhere here
        assert "CommandReceived of a client failed and was dropped" in caplog.text
    # Replies in words, wherever the command has one.
    assert len(faulty.rejections) == isinstance(command, Init)
    if isinstance(command, SetCommand):
        assert [result.status for result in results(faulty)] == ["Failed"]


def test_requests_when_raising_are_answered_by_a_fault() -> None:
    simulation, faulty, replies = make_faulty_simulation(), FakeClient(), list[object]()
    fleet_of(simulation).faulty = faulty
    for channel in (CameraChannel("faulty", ""), CameraChannel("R", "")):
        simulation.post(
            LandmarksRequested(faulty, channel, lambda *reply: replies.append(reply[1]))
        )
    simulation.post(
        AccuracyTargetChanged(faulty, "", 1.0, None, lambda *reply: replies.append(reply[0]))
    )
    run_until_served(simulation)
    assert [type(reply) for reply in replies] == [Fault, type(None), Fault]


def test_frame_when_its_composition_raises_is_rejected_in_words() -> None:
    rejected = list[tuple[Channel, str]]()
    simulation = make_faulty_simulation(rejected)
    channels = (CameraChannel("faulty", ""), CameraChannel("nobody", ""))
    for channel in channels:
        simulation.post(FrameRequested(channel=channel))
    run_until_served(simulation)
    simulation = make_faulty_simulation(rejected)
    assert rejected == []  # stopped before the capture

    def stop_after_two(channel: Channel, reason: str) -> None:
        rejected.append((channel, reason))
        if len(rejected) == 2:
            post_stop(simulation)

    simulation = Simulation(
        fleet_of(simulation),
        clock=ClockMode.LOCKSTEP,
        render=lambda request: None,
        reject=stop_after_two,
    )
    for channel in channels:
        simulation.post(FrameRequested(channel=channel))
    simulation.run()
    assert [bool(reason) for _, reason in rejected] == [True, False]


SENSORS = (
    *(ODOMETRY, GROUND_TRUTH, SCANNER, SONAR, INS, ENCODER),
    *(TACHOMETER, TOUCH, RFID, VICTIMS, GPS),
)


class _RaisingInstrument:
    """An instrument of which one method raises."""

    def __init__(self, instrument: Any, method: str) -> None:
        self._instrument = instrument
        self._method = method

    def __getattr__(self, name: str) -> object:
        if name == self._method:
            raise ZeroDivisionError(name)
        return getattr(self._instrument, name)


@pytest.mark.parametrize("method", ["read", "update"])
@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: type(sensor).__name__)
def test_robot_when_a_sensor_raises_is_removed_and_others_go_on(
    sensor: object, method: str, caplog: pytest.LogCaptureFixture
) -> None:
    description = make_p2at(sensors=(sensor,))
    simulation, faulty, other = make_simulation(description), FakeClient(), FakeClient()
    post_command(simulation, faulty, INIT)
    post_command(simulation, other, Init("OmniP2AT", name="S", location_m=(0.0, 1.5, 0.0)))
    run_until_served(simulation)
    robot = simulation._fleet.find_robot(faulty)
    assert robot is not None
    raising: Any = _RaisingInstrument(robot.sensors[0].instrument, method)
    robot.sensors[0] = dataclasses.replace(robot.sensors[0], instrument=raising)
    simulation._is_stopped = False
    post_command(simulation, faulty, StepCommand(0.4))
    post_command(simulation, other, StepCommand(0.4))
    run_until_served(simulation)
    assert simulation._fleet.find_robot(faulty) is None
    assert len(faulty.disconnections) == 1
    assert "robot R failed and is removed" in caplog.text
    assert results(other)[-1].time_s == 0.8
    assert other.batches[-1][0].WORD == "SEN"


def test_step_when_its_client_leaves_ends_early_and_others_are_served() -> None:
    simulation, leaving, other = make_simulation(), FakeClient(), FakeClient()

    class LeavingClient(FakeClient):
        def deliver(self, reports: Sequence[Report]) -> None:
            super().deliver(reports)
            if len(self.batches) == 3:
                simulation.post(ClientDisconnected(self))

    leaving = LeavingClient()
    post_command(simulation, leaving, INIT)
    post_command(simulation, leaving, StepCommand(60.0))
    post_command(simulation, leaving, StepCommand(60.0))
    post_command(simulation, other, StepCommand(0.2))
    run_until_served(simulation)
    assert results(other)[-1].time_s < 1.0


def test_simulation_when_stopped_during_a_long_step_ends_within_a_tick() -> None:
    client = StoppingClient(0.4)
    simulation = client.simulation = make_simulation()
    post_command(simulation, client, INIT)
    post_command(simulation, client, StepCommand(60.0))
    simulation.run()
    assert max(r.time_s for r in client.reports if isinstance(r, VehicleStatus)) == 0.4


def test_realtime_when_flooded_ticks_on_and_serves_others_first() -> None:
    # Each reading of the clock takes 1 ms: some commands exhaust the budget of a tick.
    client, flooding = StoppingClient(0.4), FakeClient()
    simulation = make_simulation(clock=ClockMode.REALTIME, monotonic=TickingClock(0.001))
    client.simulation = simulation
    for _ in range(10_000):
        simulation.post(CommandReceived(flooding, GetStartPoses()))
    post_command(simulation, client, INIT)
    simulation.run()
    # The report of 0.4 s stopped the simulation while most of the flood was waiting.
    assert 0.4 <= max(r.time_s for r in client.reports) < 0.8
    assert 0 < len(flooding.batches) < 1000
