"""The simulation's loop with a fake client, a fake view and a fake clock: no thread, no waiting.

Everything is posted beforehand; what the loop calls posts the Stop.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.wire.commands import COMMANDS, Command, Drive, GetConf, Init, Step
from catoptra_protocol.wire.connection import ControlServer
from catoptra_protocol.wire.reports import (
    Greeting,
    GroundTruthReading,
    Report,
    Result,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.imaging.drawing import developed
from catoptra_server.imaging.frame import Frame
from catoptra_server.imaging.shot import SCREEN, CameraChannel, Channel, ScreenChannel, Shot
from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.meshes import build_scene
from catoptra_server.simulation import (
    Asked,
    Clock,
    Drawn,
    Fleet,
    FrameWanted,
    LandmarksSought,
    Left,
    Simulation,
    Stop,
)
from helpers.robots import CAMERA, FakeClient, FakeView, FakeViews, noisy_p2at, p2at, walled_world

INIT = Init("OmniP2AT", name="R", location_m=(0.0, 0.0, 0.0))


def simulation_of(
    description: RobotDescription | None = None,
    *,
    clock: Clock = Clock.LOCKSTEP,
    seed: int = 1,
    monotonic: Callable[[], float] = lambda: 0.0,
    put_frame: Callable[[Frame], None] = lambda frame: None,
    view: FakeView | None = None,
    frame_skip: int = 1,
) -> Simulation:
    world = walled_world()
    described = description or p2at()
    fleet, views = Fleet([described], world, build_scene(world), seed=seed), FakeViews(view)

    def draw(shot: Shot) -> None:
        frame = developed(shot, views, monotonic=monotonic)
        simulation.post(Drawn(shot.channel))
        put_frame(frame)

    simulation = Simulation(
        fleet,
        clock=clock,
        draw=draw,
        refuse=lambda channel: None,
        frame_skip=frame_skip,
        monotonic=monotonic,
    )
    return simulation


def conversation(
    *commands: Command, seed: int = 1, description: RobotDescription | None = None
) -> FakeClient:
    """Return a client that has sent these commands to a lockstep simulation."""
    simulation, client = simulation_of(description, seed=seed), FakeClient()
    for command in commands:
        simulation.post(Asked(client, command))
    simulation.post(Stop())
    simulation.run()
    return client


def results(client: FakeClient) -> list[Result]:
    return [report for report in client.reports if isinstance(report, Result)]


def as_bytes(client: FakeClient) -> bytes:
    return b"".join(map(line_from_report, client.reports))


def test_step_when_of_200_ms_prints_multiples_of_it() -> None:
    client = conversation(INIT, *(100 * [Step(0.2)]))
    lines = [line_from_report(result) for result in results(client)]
    assert lines[0] == b"RES {Time 0.2000} {Type Step} {Name Clock} {Status OK}\r\n"
    assert [line.split(b"}")[0].rpartition(b" ")[2] for line in lines] == [
        f"{(i + 1) / 5:.4f}".encode() for i in range(100)
    ]


@pytest.mark.parametrize("time_s", [0.013, 1.0 / 3.0, 0.02, 0.05, 7e-9])
def test_step_when_no_multiple_of_a_tick_adds_up(time_s: float) -> None:
    client = conversation(INIT, *(300 * [Step(time_s)]))
    # A step counts whole nanoseconds.
    assert results(client)[-1].time_s == pytest.approx(300 * round(time_s * 1e9) / 1e9, abs=1e-12)


def test_step_when_done_ends_with_a_whole_cycle_and_its_result() -> None:
    client = conversation(INIT, Step(0.1))
    assert [r.WORD for r in client.batches[-1]] == ["SEN", "SEN", "STA", "RES"]
    truth = client.batches[-1][1]
    assert isinstance(truth, GroundTruthReading)
    assert truth.time_s == 0.1


def test_step_when_reports_fall_due_on_the_way_delivers_them_in_order() -> None:
    client = conversation(INIT, Step(0.5))
    times = [r.time_s for r in client.reports if isinstance(r, GroundTruthReading)]
    assert times == [0.0, 0.2, 0.4, 0.5]


def test_step_when_of_0_s_reads_the_sensors_and_no_time_passes() -> None:
    client = conversation(INIT, Step(0.0))
    assert [r.WORD for r in client.batches[-1]] == ["SEN", "SEN", "STA", "RES"]
    assert results(client) == [Result(0.0, "Step", "Clock", "OK")]


@pytest.mark.parametrize("time_s", [-0.1, -1e-12, 60.001, 1e300])
def test_step_when_negative_or_too_long_fails_and_no_time_passes(time_s: float) -> None:
    client = conversation(INIT, Step(time_s), Step(0.1))
    assert [(r.time_s, r.status) for r in results(client)] == [(0.0, "Failed"), (0.1, "OK")]
    assert [report.WORD for report in client.batches[1]] == ["RES"]


def test_step_when_of_a_minute_is_the_longest() -> None:
    assert results(conversation(Step(60.0))) == [Result(60.0, "Step", "Clock", "OK")]


def test_step_when_there_is_no_robot_is_answered_by_its_result_alone() -> None:
    client = conversation(Drive(1.0, 1.0), GetConf("Robot"), Step(0.2))
    assert client.reports == [Result(0.2, "Step", "Clock", "OK")]


def test_time_when_nobody_steps_stands_still() -> None:
    client = conversation(INIT, Drive(2.0, 2.0), Step(0.0))
    truth = [r for r in client.reports if isinstance(r, GroundTruthReading)][-1]
    assert (truth.time_s, truth.location_m[0]) == (0.0, 0.0)


def test_drive_when_for_2_s_at_2_rad_s_goes_0_52_m_by_the_robot_s_own_account() -> None:
    client = conversation(INIT, Drive(2.0, 2.0), Step(2.0))
    truth = [r for r in client.reports if isinstance(r, GroundTruthReading)][-1]
    assert truth.location_m[0] == pytest.approx(0.52, abs=1e-9)


DANCE = [
    INIT,
    *(c for i in range(20) for c in (Drive(1.0 + 0.1 * i, 2.0 - 0.1 * i), Step(0.13))),
]


def test_run_when_repeated_gives_the_same_bytes() -> None:
    one, other = (conversation(*DANCE, description=noisy_p2at()) for _ in range(2))
    assert as_bytes(one) == as_bytes(other)


def test_run_when_the_seed_or_the_name_differs_gives_others() -> None:
    one = conversation(*DANCE, description=noisy_p2at())
    by_seed = conversation(*DANCE, description=noisy_p2at(), seed=2)
    renamed = Init("OmniP2AT", name="S", location_m=INIT.location_m)
    by_name = conversation(renamed, *DANCE[1:], description=noisy_p2at())
    assert len({as_bytes(one), as_bytes(by_seed), as_bytes(by_name)}) == 3


def test_run_when_another_robot_is_there_gives_the_same_bytes() -> None:
    alone = conversation(*DANCE, description=noisy_p2at())
    simulation, client, other = simulation_of(noisy_p2at()), FakeClient(), FakeClient()
    simulation.post(Asked(other, Init("OmniP2AT", name="Other", location_m=(9.0, 1.0, 0.0))))
    simulation.post(Asked(other, Drive(1.0, -1.0)))
    for command in DANCE:
        simulation.post(Asked(client, command))
    simulation.post(Stop())
    simulation.run()
    assert as_bytes(client) == as_bytes(alone)


def test_run_when_pictures_are_drawn_meanwhile_gives_the_same_bytes() -> None:
    alone = conversation(*DANCE, description=noisy_p2at())
    simulation, client = simulation_of(noisy_p2at()), FakeClient()
    for command in DANCE:
        simulation.post(FrameWanted())
        simulation.post(Asked(client, command))
    simulation.post(Stop())
    simulation.run()
    assert as_bytes(client) == as_bytes(alone)


def test_robot_when_its_client_left_is_gone() -> None:
    simulation, one, other = simulation_of(), FakeClient(), FakeClient()
    for request in (Asked(one, INIT), Left(one), Asked(other, INIT), Asked(other, Step(0.2))):
        simulation.post(request)
    simulation.post(Stop())
    simulation.run()
    assert len(one.batches) == 1
    assert results(other)


_BLOCKS = st.lists(
    st.tuples(
        st.sampled_from(["Type", "Name", "ClassName", "Location", "Start", "Left", "Time", "X"]),
        st.text(alphabet=st.characters(max_codepoint=255, exclude_characters="\r\n"), max_size=300),
    ),
    max_size=4,
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted(COMMANDS)), _BLOCKS), max_size=5))
def test_commands_when_arbitrary_have_only_answers_that_can_be_sent(
    said: list[tuple[str, list[tuple[str, str]]]],
) -> None:
    server, client = ControlServer(), FakeClient()
    server.send(Greeting("BotDeathMatch", "walls"))
    lines = [f"{word} " + "".join(f"{{{n} {v}}}" for n, v in blocks) for word, blocks in said]
    simulation = simulation_of()
    whole = ("INIT {ClassName OmniP2AT} {Location 0,0,0}", *lines, "STEP {Time 0.1}", "")
    for command in server.receive("\r\n".join(whole).encode("latin-1")):
        # A step of a minute is right, but three thousand ticks long.
        if not (isinstance(command, Step) and command.time_s > 1.0):
            simulation.post(Asked(client, command))
    simulation.post(Stop())
    simulation.run()
    assert results(client)[-1].status == "OK"
    assert all(line_from_report(report).endswith(b"\r\n") for report in client.reports)


class Frames:
    """Keeps frames; stops the simulation after some."""

    def __init__(self, count: int) -> None:
        self.simulation: Simulation | None = None
        self.frames: list[Frame] = []
        self._count = count

    def put(self, frame: Frame) -> None:
        self.frames.append(frame)
        assert self.simulation is not None
        done = len(self.frames) == self._count
        self.simulation.post(Stop() if done else FrameWanted(channel=frame.channel))


def frames_of(count: int, *requests: object, view: FakeView) -> list[Frame]:
    """Return the first frames of a lockstep simulation that was asked things first."""
    keeper = Frames(count)
    keeper.simulation = simulation_of(put_frame=keeper.put, view=view)
    for request in requests:
        keeper.simulation.post(request)  # type: ignore[arg-type] # the callers pass requests
    keeper.simulation.run()
    return keeper.frames


def test_frame_when_wanted_by_many_is_drawn_once() -> None:
    view, client = FakeView(), FakeClient()
    (frame,) = frames_of(1, Asked(client, INIT), *(5 * [FrameWanted()]), view=view)
    assert len(view.exposures) == 1
    assert (frame.sequence, frame.caption.camera, frame.time_s) == (1, "OmniCam", 0.0)
    np.testing.assert_array_equal(frame.rgb, 1)


def test_frame_when_asked_for_after_a_step_shows_the_new_place() -> None:
    view, client = FakeView(), FakeClient()
    asked = [Asked(client, c) for c in (INIT, Drive(2.0, 2.0), Step(1.0))]
    (frame,) = frames_of(1, *asked, FrameWanted(), view=view)
    assert frame.time_s == 1.0
    assert frame.caption.world_from_robot.translation[0] == pytest.approx(0.26)


def test_frame_when_wanted_while_it_is_drawn_is_not_drawn_twice() -> None:
    view, drawn = FakeView(), []

    def wanted_meanwhile(frame: Frame) -> None:
        """Stand for a client that asks for frame 1 while it is drawn."""
        drawn.append(frame)
        simulation.post(FrameWanted(newer_than=0))
        simulation.post(FrameWanted(newer_than=0))
        simulation.post(Stop())

    simulation = simulation_of(put_frame=wanted_meanwhile, view=view)
    simulation.post(FrameWanted(newer_than=0))
    simulation.run()
    assert [frame.sequence for frame in drawn] == [1]


def test_frames_when_wanted_again_are_numbered() -> None:
    frames = frames_of(3, FrameWanted(), view=FakeView())
    assert [frame.sequence for frame in frames] == [1, 2, 3]


def test_camera_when_nobody_watches_is_not_drawn() -> None:
    view = FakeView()
    simulation, client = simulation_of(view=view), FakeClient()
    for command in (INIT, Step(5.0)):
        simulation.post(Asked(client, command))
    simulation.post(Stop())
    simulation.run()
    assert view.exposures == []


class Ticking:
    """A clock that goes on by a fixed step with every look at it, after some jumps."""

    def __init__(self, step_s: float, *jumps_s: float) -> None:
        self._now_s = 100.0
        self._step_s = step_s
        self._jumps_s = list(jumps_s)

    def __call__(self) -> float:
        self._now_s += self._jumps_s.pop(0) if self._jumps_s else self._step_s
        return self._now_s


class Impatient(FakeClient):
    """A client that stops the simulation when its status is of a time or later."""

    def __init__(self, until_s: float) -> None:
        super().__init__()
        self.simulation: Simulation | None = None
        self._until_s = until_s

    def deliver(self, reports: Sequence[Report]) -> None:
        super().deliver(reports)
        if any(isinstance(r, VehicleStatus) and r.time_s >= self._until_s for r in reports):
            assert self.simulation is not None
            self.simulation.post(Stop())


def watched_realtime(
    until_s: float, monotonic: Callable[[], float], *commands: Command
) -> Impatient:
    client = Impatient(until_s)
    client.simulation = simulation_of(clock=Clock.REALTIME, monotonic=monotonic)
    for command in (INIT, *commands):
        client.simulation.post(Asked(client, command))
    client.simulation.run()
    return client


def test_realtime_when_the_clock_goes_on_runs_in_ticks() -> None:
    # 30 ms a look, so that no wait is needed: the loop never sees a tick that is not over.
    client = watched_realtime(1.0, Ticking(0.03), Drive(2.0, 2.0))
    truths = [r for r in client.reports if isinstance(r, GroundTruthReading)]
    assert [t.time_s for t in truths] == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert truths[-1].location_m[0] == pytest.approx(0.26, abs=1e-9)


def test_realtime_when_asked_to_step_fails() -> None:
    client = watched_realtime(0.2, Ticking(0.03), Step(0.1))
    assert [result.status for result in results(client)] == ["Failed"]


def test_realtime_when_far_behind_goes_on_from_now(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        client = watched_realtime(0.2, Ticking(0.03, 0.0, 0.0, 7.0))
    assert "7.0 s behind" in caplog.text
    times = [r.time_s for r in client.reports if isinstance(r, VehicleStatus)]
    assert times == [0.0, 0.2]


def test_realtime_when_frames_have_an_interval_keeps_it() -> None:
    camera = dataclasses.replace(CAMERA, frame_interval_s=0.1)
    keeper = Frames(4)
    keeper.simulation = simulation_of(
        p2at(omni_camera=camera),
        clock=Clock.REALTIME,
        monotonic=Ticking(0.03),
        put_frame=keeper.put,
    )
    keeper.simulation.post(FrameWanted())
    keeper.simulation.run()
    times = np.array([frame.time_s for frame in keeper.frames])
    # A tick is what the interval can be missed by.
    assert (np.diff(times) >= 0.1 - 1e-9).all()
    assert (np.diff(times) < 0.2).all()


@pytest.mark.parametrize(
    ("channel", "least_s"), [(SCREEN, 0.2), (ScreenChannel(1), 0.2), (CameraChannel("R", ""), 0.0)]
)
def test_realtime_when_frames_are_skipped_exposes_the_screen_rarely_and_no_other_camera(
    channel: Channel, least_s: float
) -> None:
    keeper = Frames(4)
    simulation = keeper.simulation = simulation_of(
        clock=Clock.REALTIME, monotonic=Ticking(0.01), put_frame=keeper.put, frame_skip=10
    )
    simulation.post(Asked(FakeClient(), INIT))
    simulation.post(FrameWanted(channel=channel))
    simulation.run()
    gaps = np.diff([frame.time_s for frame in keeper.frames])
    assert (gaps >= least_s - 1e-9).all()
    assert (gaps < least_s + 0.15).all()


def test_landmarks_when_sought_are_answered_with_the_time_and_none_without_such_a_camera() -> None:
    simulation, told = simulation_of(), list[object]()
    client = FakeClient()
    simulation.post(Asked(client, INIT))
    simulation.post(Asked(client, Step(0.5)))
    for name in ("R", "Other"):
        channel = CameraChannel(name, "")
        simulation.post(LandmarksSought(channel, lambda *answer: told.append(answer)))
    simulation.post(Stop())
    simulation.run()
    assert told == [(0.5, ()), (0.5, None)]


def test_camera_of_the_screen_s_robot_when_a_mere_viewer_leaves_goes_on_counting() -> None:
    frames, drawn = list[Frame](), CameraChannel("", "")

    def put(frame: Frame) -> None:
        frames.append(frame)
        if len(frames) == 1:
            simulation.post(Left(FakeClient()))
        simulation.post(Stop() if len(frames) == 2 else FrameWanted(channel=drawn))

    simulation = simulation_of(put_frame=put)
    for request in (Asked(FakeClient(), INIT), FrameWanted(channel=drawn)):
        simulation.post(request)
    simulation.run()
    assert [frame.sequence for frame in frames] == [1, 2]
