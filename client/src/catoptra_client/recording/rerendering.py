"""A recorded drive through another camera: the same poses, times and readings, other pictures.

A server draws each recorded frame from its pose, with the camera, plan and effects of another robot
file, whose robot stands still: motion blur and rolling shutter see no motion, and the other robots
of the recorded world are not there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.recording.mcap_file import RecordingWriter
from catoptra_client.recording.recorder import MessageSource, RecordingPlan
from catoptra_client.recording.recording import RecordedFrame, RecordedState, Recording
from catoptra_client.recording.resimulation import run_recorded_server
from catoptra_client.server_process import connect_stream
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.stream.replies import SensorReports
from catoptra_protocol.stream.requests import FrameVariant, GetFrameRequest
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.reports import report_from_message

_TIMEOUT_S = 60.0


def rerender(
    recording: Recording,
    out: Path,
    *,
    robot_file: Path,
    max_error_px: float | None = None,
    camera: str = "",
    files: Path | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
) -> int:
    """Draw a recorded drive through another camera into a new file; the number of its frames.

    Args:
        recording: Recording with frames.
        out: File to write, which is not there yet.
        robot_file: File of a robot with the camera.
        max_error_px: Tolerance on the displacement of outlines; None: as the robot's file has it.
        camera: Name of the camera; empty: the robot's first one.
        files: Folder of the recorded world and what it refers to, as in `run_recorded_server`.
        on_progress: Receives each simulation time.

    Raises:
        CatoptraError: The recording has no frames; the server does not start; the file exists.
    """
    if out.exists():
        raise CatoptraError(f"{out} is there already: name a file that is not")
    frames = (one for one in recording.iter_events() if isinstance(one, RecordedFrame))
    first = next(frames, None)
    if first is None:
        raise recording.error("no frames, whose poses a camera could be drawn from")
    labels, pairs = first.header.labels, first.header.camera_model or {}
    plan = RecordingPlan(
        recording.robot,
        camera,
        first.header.encoding,
        Picture.MIRRORED if pairs.get("Picture") == Picture.MIRRORED.value else Picture.FLIPPED,
        tuple(one.name for one in labels.channels) if labels else (),
    )
    options = () if max_error_px is None else (f"--max-error-px={max_error_px!r}",)
    server = run_recorded_server(recording, files=files, robot_files=(robot_file,), options=options)
    with server as address, connect_stream(address, timeout_s=_TIMEOUT_S) as client:
        place = first.header.world_from_robot.position_m
        class_name = client.get_status().class_names[0]
        client.spawn(class_name, name=recording.robot, location_m=place)
        with RecordingWriter(out) as writer:
            return _Rewriter(plan).rewrite(client, writer, recording, on_progress)


class _Rewriter(MessageSource):
    """Messages of a recording with other pictures."""

    def rewrite(
        self,
        client: StreamClient,
        writer: RecordingWriter,
        recording: Recording,
        on_progress: Callable[[float], None],
    ) -> int:
        """Write the messages; the number of frames."""
        self._sink = writer
        self._write_head(client)
        self._is_omni = isinstance(self._find_camera(client), OmniCamera)
        self._begin_s = recording.span_s[0]
        time_s, num_frames = self._begin_s, 0
        # Readings are of the recorded robot's sensors.
        lines = recording.get_reply(SensorReports).reports
        reports = (report_from_message(parse_message(line)) for line in lines)
        self._describe_robot([one for one in reports if one is not None], self._begin_s)
        writer.add_metadata("catoptra_rerendered", {"from": recording.path.name})
        for event in recording.iter_events():
            if isinstance(event, RecordedState):
                self._write_commands(event.state, event.publish_ns)
                self._write_state(replace(event.state, reports=event.readings), event.publish_ns)
                continue
            # For the random numbers of effects, which follow from the tick.
            while time_s < event.time_s:
                step_s = min(event.time_s - time_s, 1.0)
                client.step(step_s)
                time_s = time_s + step_s if step_s == 1.0 else event.time_s
            self._draw(client, event)
            num_frames += 1
            on_progress(event.time_s)
            if writer.is_full:
                raise CatoptraError(f"the disk is full; the file ends at {event.time_s:.2f} s")
        writer.add_metadata("catoptra_dropped", {"total": "0"})
        return num_frames

    def _draw(self, client: StreamClient, frame: RecordedFrame) -> None:
        before, plan = frame.header, self._plan
        pose = before.world_from_robot
        picture = plan.picture.value if self._is_omni else None
        variant = FrameVariant(picture=picture, world_from_robot=pose)
        request = GetFrameRequest(
            0, self._robot, self._camera, plan.encoding, variant, plan.channels
        )
        header, parts = client.get_encoded_frame(request)
        assert header.world_from_robot == pose, "the server draws from the pose of the request"
        numbered = replace(header, time_s=before.time_s, sequence=before.sequence)
        self._write_frame(numbered, parts, frame.publish_ns)
