"""Recordings as they are shown, simulated and drawn again."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import pytest

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.recording.mcap_file import (
    RecordedFile,
    RecordedMessage,
    RecordedTable,
    RecordingWriter,
    decode_message,
    read_entries,
)
from catoptra_client.recording.recorder import (
    MessageSink,
    MessageSource,
    Recorder,
    RecordingPlan,
)
from catoptra_client.recording.recording import RecordedFrame, RecordedState, Recording
from catoptra_client.recording.rerendering import rerender
from catoptra_client.recording.resimulation import resimulate
from catoptra_client.robot_client import RobotClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.messages import json_from_message
from catoptra_protocol.stream.requests import FrameVariant, GetFrameRequest, ImageEncoding
from conformance.check import ServerUnderTest
from conformance.suite import Outcome, applicable_checks, play_checks
from helpers.configs import ROBOTS, Edit, write_edited_copy
from helpers.server_process import DEADLINE_S, LISTENING_PATTERN, start_server
from helpers.stream_messages import HEADER

CLIENT = (sys.executable, "-m", "catoptra_client")
CLASS = "USARBot.OmniP2AT"


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded drive of nine seconds in real time."""
    folder = tmp_path_factory.mktemp("drive")
    with start_server(folder) as server, server.connect_stream() as client:
        client.spawn(CLASS, start_pose="Centre")
        client.drive(0.5, 1.5)
        plan = RecordingPlan(channels=("range", "ids"))
        Recorder(folder / "drive.mcap", plan, stream_port=server.stream_port).record(9.0)
    return folder / "drive.mcap"


@contextmanager
def serve(path: Path, speed: str) -> Iterator[dict[str, int]]:
    """Ports of a recording that is served by a process."""
    ports = ("--control-port", "0", "--image-port", "0", "--stream-port", "0")
    command = [*CLIENT, "replay", str(path), "--serve", "--speed", speed, *ports]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = LISTENING_PATTERN.fullmatch(process.stdout.readline())
            assert found
            yield dict(zip(("control", "image", "stream"), map(int, found.groups()), strict=True))
        finally:
            process.terminate()
            process.wait(DEADLINE_S)


def test_served_recording_passes_the_rows_that_it_can_answer(drive: Path) -> None:
    with serve(drive, "0.12") as ports:
        addresses = {name: ("127.0.0.1", port) for name, port in ports.items()}
        server = ServerUnderTest(
            addresses, CLASS, "{Start Centre}", "ut2004", False, is_recording=True
        )
        results = list(play_checks(applicable_checks(server), server))
    failed = [(one.check.name, one.reason) for one in results if one.outcome is Outcome.FAILED]
    skipped = [one for one in results if one.outcome is Outcome.SKIPPED]
    assert failed == []
    assert sum(one.outcome is Outcome.PASSED for one in results) >= 35
    reasons = [one.reason for one in skipped]
    assert all("a recording cannot" in reason or "has no " in reason for reason in reasons)


def test_unmodified_clients_get_what_was_recorded(drive: Path) -> None:
    events = list(Recording(drive).iter_events())
    frames = {one.header.time_s: one for one in events if isinstance(one, RecordedFrame)}
    states = {one.time_s: one.state for one in events if isinstance(one, RecordedState)}
    with (
        serve(drive, "2") as ports,
        StreamClient.connect(port=ports["stream"]) as client,
        RobotClient.connect(port=ports["control"]) as robot,
        ImageClient.connect(port=ports["image"]) as images,
    ):
        robot.spawn(CLASS, start_pose="Centre")
        camera, _ = robot.get_camera_and_height()
        request = GetFrameRequest(0, "", "", ImageEncoding.JPEG, None, ("range",))
        times = []
        for _ in range(5):
            header, parts = client.get_encoded_frame(request)
            times.append(header.time_s)
            found = frames[header.time_s]
            assert tuple(parts) == found.parts[:2]
            assert header.world_from_robot == found.header.world_from_robot
            state = client.get_state()
            assert states[state.time_s].robots == state.robots
            assert states[state.time_s].reports == state.reports
        assert sorted(set(times)) == times
        assert camera == client.get_frame().camera
        assert images.get_frame().rgb.shape == (64, 64, 3)
        with pytest.raises(CatoptraError, match="cannot show another frame: it has ended at"):
            list(islice(client.iter_frames(), len(frames)))
        ticks = client.get_state(ticks_after=1.0).ticks
        assert 10 < len(ticks) <= 64
        assert ticks[0].time_s > 1.0
        for one in ticks:
            assert states[one.time_s].robots[0].world_from_robot == one.world_from_robot
        assert any("{Type Odometry}" in line for one in ticks for line in one.reports)
        for reject, reason in (
            (lambda: client.drive(1.0, 1.0), "cannot answer drive"),
            (lambda: client.get_frame(robot="Other"), "cannot show camera '' of 'Other'"),
            (lambda: client.get_frame(channels=("flow",)), "cannot label pixels by 'flow'"),
            (lambda: client.get_frame(variant=FrameVariant(samples=1)), "cannot draw a variant"),
            (
                lambda: client.spawn(CLASS, location_m=(1.0, 0.0, 0.0)),
                "cannot spawn the robot there",
            ),
        ):
            with pytest.raises(CatoptraError, match=reason):
                reject()


def test_summary_names_robot_world_rates_and_what_was_dropped(drive: Path) -> None:
    command = [*CLIENT, "replay", str(drive)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert re.search(r"robot OmniP2AT, world DM-spqrSoccer2006_250, Catoptra \S+, clock", text)
    assert re.search(r"\n\d\.\d s from \S+ s on, \d+ messages\n", text)
    assert re.search(r"/catoptra/frame  std_msgs/String: \d+, [23]\d\.\d a second\n", text)
    assert "\ndropped: none\n" in text


def copy_altered(source: Path, copy: Path, before: str, after: str) -> None:
    """Copy a recording with a text in its commands replaced."""
    with RecordingWriter(copy) as writer:
        for entry in read_entries(source):
            match entry:
                case RecordedMessage(topic, type_name, data, log_ns, publish_ns, is_latched):
                    times = {"log_ns": log_ns, "publish_ns": publish_ns}
                    if topic == "/catoptra/commands":
                        text = decode_message(entry).data.replace(before, after)
                        writer.add_message(topic, type_name, {"data": text}, **times)
                    else:
                        writer.add_cdr(topic, type_name, data, **times, is_latched=is_latched)
                case RecordedFile(name, data):
                    writer.add_attachment(name, data)
                case RecordedTable(name, values):
                    writer.add_metadata(name, values)


def test_drive_in_real_time_is_simulated_again_byte_for_byte(drive: Path) -> None:
    command = [*CLIENT, "replay", str(drive), "--resimulate"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert re.fullmatch(
        r"\d\.\d s simulated again: \d{3} states and \d+ frames are the same, byte for byte\n", text
    )


def test_altered_command_is_the_first_difference_by_time_and_topic(
    drive: Path, tmp_path: Path
) -> None:
    altered = tmp_path / "altered.mcap"
    copy_altered(drive, altered, "{Right 1.5}", "{Right 1.5000000000000002}")
    found = resimulate(Recording(altered))
    assert re.match(r"\d\.\d{4} s, /catoptra/state: the robot is at \(", found.difference)
    cut = tmp_path / "cut.mcap"
    copy_altered(drive, cut, '"number": 1,', '"number": 3,')
    with pytest.raises(CatoptraError, match="those from INIT on"):
        resimulate(Recording(cut))


def test_frame_of_the_last_tick_does_not_wait_for_another_one(tmp_path: Path) -> None:
    options = ("--clock", "lockstep")
    with start_server(tmp_path, *options) as server, server.connect_stream() as client:
        client.spawn(CLASS, start_pose="Centre")
        source = MessageSource(RecordingPlan(), stream_port=server.stream_port)
        written, seen = threading.Event(), threading.Event()

        class Sink(MessageSink):
            is_full, num_messages = False, 0

            def add_message(self, topic: str, *_: object, log_ns: int, **__: object) -> None:
                if topic == "/catoptra/wheel_speeds":
                    written.set()
                if topic == "/catoptra/frame" and log_ns == last_ns:
                    seen.set()

        last_ns = round((client.get_state().time_s + 0.1) * 1e9)
        with ThreadPoolExecutor() as pool:
            running = pool.submit(source.publish, Sink())
            try:
                assert written.wait(DEADLINE_S)
                client.step(0.1)
                assert seen.wait(DEADLINE_S), "a program may step by what it sees"
            finally:
                source.stop()
            running.result()


def test_lockstep_drive_with_noise_is_simulated_again(tmp_path: Path) -> None:
    path = tmp_path / "lockstep.mcap"
    robot = write_edited_copy(
        ROBOTS / "p2at_omni_real.ini",
        tmp_path,
        Edit("ResolutionX=640", "ResolutionX=160"),
        Edit("ResolutionY=480", "ResolutionY=120"),
        Edit("BasedOn=p2at_omni.ini", "BasedOn=p2at_omni"),
    )
    options = ("--clock", "lockstep", "--seed", "7")
    with (
        start_server(tmp_path, *options, robot=robot) as server,
        server.connect_stream() as client,
    ):
        client.step(0.13)
        client.spawn(client.get_status().class_names[0], start_pose="Centre")
        recorder = Recorder(path, RecordingPlan(hz=10.0), stream_port=server.stream_port)
        with ThreadPoolExecutor() as pool:
            recording = pool.submit(recorder.record)
            for number in range(40):
                client.drive(0.5 + 0.01 * number, 1.5)
                client.step(0.05)
                # Another viewer's frames change nothing, and take the recorder's time.
                client.get_frame()
            recorder.stop()
            recording.result()
    found = resimulate(Recording(path))
    assert found.difference == ""
    assert min(found.num_states, found.num_frames) > 2


def test_drive_through_a_fish_eye_has_the_same_poses_to_the_bit(tmp_path: Path) -> None:
    with start_server(tmp_path) as server, server.connect_stream() as client:
        client.spawn(CLASS, start_pose="Centre")
        client.drive(0.5, 1.5)
        plan = RecordingPlan(hz=8.0)
        Recorder(tmp_path / "a.mcap", plan, stream_port=server.stream_port).record(3.0)
    robot = write_edited_copy(
        ROBOTS / "p2at_fisheye.ini",
        tmp_path,
        Edit("BasedOn=p2at.ini", "BasedOn=p2at"),
        Edit("ResolutionX=640\nResolutionY=640", "ResolutionX=120\nResolutionY=120"),
    )
    before = Recording(tmp_path / "a.mcap")
    poses = [
        (one.time_s, one.header.world_from_robot)
        for one in before.iter_events()
        if isinstance(one, RecordedFrame)
    ]
    assert len(poses) > 1
    for tolerance in (0.1, 0.5, 2.0):
        out = tmp_path / f"{tolerance}.mcap"
        num_frames = rerender(before, out, robot_file=robot, max_error_px=tolerance)
        assert num_frames == len(poses)
        frames = [
            one.header for one in Recording(out).iter_events() if isinstance(one, RecordedFrame)
        ]
        assert [(one.time_s, one.world_from_robot) for one in frames] == poses
        assert all("Lens" in (one.camera_model or {}) for one in frames)
        assert all(one.error_bound_px <= tolerance for one in frames)
        for topic in ("/tf", "/ground_truth", "/catoptra/commands"):
            assert read_topic(out, topic) == read_topic(before.path, topic)


def read_topic(path: Path, topic: str) -> list[bytes]:
    entries = (one for one in read_entries(path) if isinstance(one, RecordedMessage))
    return [one.data for one in entries if one.topic == topic]


DAMAGED = {
    "no states and no frames": [],
    "Infinity: expected a finite": [("/catoptra/state", '{"kind":"state","time_s":Infinity}')],
    "time_s: .nan.: expected": [
        ("/catoptra/state", '{"kind":"state","id":1,"time_s":"nan","robots":[]}')
    ],
    "a time of 1e\\+300 s": [
        (
            "/catoptra/state",
            '{"kind":"state","id":1,"time_s":1e300,"robots":[],"robot":"","reports":[],"notes":[]}',
        ),
    ],
    "it has no state": [("/catoptra/state", '{"kind":"ok","id":1}')],
    "a frame without its image": [("/catoptra/frame", json_from_message(HEADER))],
}


def read_all(recording: Recording) -> None:
    assert recording.span_s[0] <= recording.span_s[1]
    assert list(recording.iter_events())


@pytest.mark.parametrize("reason", DAMAGED)
def test_damaged_recording_is_one_message(reason: str, tmp_path: Path) -> None:
    path = tmp_path / "damaged.mcap"
    with RecordingWriter(path) as writer:
        for topic, text in DAMAGED[reason]:
            writer.add_message(topic, "std_msgs/String", {"data": text}, log_ns=1, publish_ns=1)
    recording = Recording(path)
    with pytest.raises(CatoptraError, match=reason):
        read_all(recording)
