"""Client of the ZeroMQ stream: one connection for robot and frames.

Blocking, for one thread. Frames are pulled: each is the newest at the moment of its request, so a
slow program misses frames and never gets old ones. After the server was down the connection is made
anew by itself; the robot is then gone and has to be spawned again. Requests are exchanged one at a
time; images and labels are checked against their header before memory is allocated. The socket, and
how long a server may be silent, is in `zmq_socket`.
"""

from __future__ import annotations

import dataclasses
import itertools
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Concatenate, ParamSpec, TypeVar

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.frame_decoding import (
    CameraModelCache,
    frame_from_parts,
    pose_from_transform,
)
from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from catoptra_protocol.camera_conf import (
    Pairs,
    any_camera_from_pairs,
    omni_camera_from_pairs,
)
from catoptra_protocol.errors import CatoptraError, DeadlineExceededError, RemoteProtocolError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.notes import text_from_note
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    FrameHeader,
    LandmarkRecord,
    LandmarksReply,
    Ok,
    PixelReply,
    PlanReply,
    Reply,
    SensorReports,
    SetupReply,
    StartPoseRecord,
    StartPosesReply,
    StateReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    DriveRequest,
    FrameVariant,
    GetCameraRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetPartsRequest,
    GetPixelRequest,
    GetReadingsRequest,
    GetSetupRequest,
    GetStartPosesRequest,
    GetStateRequest,
    GetStatusRequest,
    ImageEncoding,
    PublishRequest,
    Request,
    ResetRequest,
    SetAccuracyRequest,
    ShareControlRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.reports import Report, report_from_message
from catoptra_protocol.vectors import Vector3

_LOG = logging.getLogger(__name__)
# A restarted server has lost the request. Repeating one with the same id is safe (SPEC.md 9.4).
_RETRY_INTERVAL_S = 1.0
_ReplyT = TypeVar("_ReplyT", bound=Reply)
_P = ParamSpec("_P")
_Parts = list[bytes]


@dataclass(frozen=True, slots=True)
class LandmarkProjection:
    """A landmark and its projection into a camera, by geometry."""

    landmark: Landmark
    pixel: tuple[float, float] | None
    """Projection (u, v) of the band centre; None outside the image."""
    visible: bool
    """Whether the band centre lies in the image without an occluder."""
    time_s: float
    """Simulation time."""


class StreamClient:
    """One client of a stream server, from `connect` to `close`; also a context manager.

    A client has one connection and at most one robot, for one thread: a second thread needs a
    client of its own. Each method sends one request and waits for its reply, for at most
    `timeout_s`.

    Every method that waits raises as follows.

    Raises:
        ConnectionLostError: The server is not there, or has sent nothing for 1.5 s. The connection
            is restored by itself: call again. A server that was restarted has no robot: `spawn`
            again.
        DeadlineExceededError: The server sends heartbeats, but no reply within `timeout_s`. It may
            still execute the request; its late reply is skipped. `get_state` shows what was done.
        CatoptraError: The server rejects the request, with its reason. Both errors above are
            CatoptraErrors too: catch them first.
        LocalProtocolError: An argument has no form on the wire, such as a speed that is not finite.
            Nothing was sent.
        RemoteProtocolError: The peer violates the protocol: another program, or a server of another
            version. Close the client.

    KeyboardInterrupt ends any wait. The client stays usable: the reply of the interrupted request
    is skipped by its id. After `close` every method raises `zmq.ZMQError`.

    Example:
        ```python
        with StreamClient.connect("127.0.0.1", 5005) as client:
            client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
            client.drive(2.0, 2.0)
            for frame in client.iter_frames():
                print(frame.sequence, frame.time_s, frame.age_s)
        ```
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start to connect, without waiting for the server; `connect` waits.

        A server that does not exist is noticed by the first call only.

        Args:
            host: Host name or address.
            port: TCP port of the stream.
            timeout_s: Timeout of each call.
            clock: Clock of the timeouts and of `Frame.received_s`, in seconds.
        """
        self._socket = StreamSocket(host, port, clock=clock)
        self._timeout_s = timeout_s
        self._clock = clock
        # From 1: 0 is the id of errors about unreadable messages.
        self._ids = itertools.count(1)
        # One per connection: frames of one camera mostly follow each other.
        self._camera_cache = CameraModelCache()

    @classmethod
    def connect(
        cls, host: str = "127.0.0.1", port: int = 5005, timeout_s: float = 5.0
    ) -> StreamClient:
        """Connect and wait for the first reply of the server; nothing is spawned.

        Args:
            host: Host name or address.
            port: TCP port of the stream: `--stream-port` of the server.
            timeout_s: Timeout of this and each later call.

        Raises:
            ConnectionLostError: No server replies at this address within `timeout_s`. To wait for a
                server that is starting, pass a longer `timeout_s`: the connection is tried again
                until then.
            RemoteProtocolError: The peer is another program, or a server of another version.

        An exception, KeyboardInterrupt included, closes the connection.
        """
        client = cls(host, port, timeout_s=timeout_s)
        try:
            # ZeroMQ connects in the background: only a reply proves that there is a server.
            client.get_status()
        # KeyboardInterrupt included: an open socket would keep its I/O thread alive.
        except BaseException:
            client.close()
            raise
        return client

    def close(self) -> None:
        """End the connection: the server removes the robot.

        To go on with another robot on the same connection call `reset` instead. May be called
        twice.
        """
        self._socket.close()

    def __enter__(self) -> StreamClient:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def get_status(self) -> StatusReply:
        """Identity and state of the server: its world, robot classes and kind of clock.

        The cheapest request, also without a robot: it shows whether the server replies.
        """
        return self._call(GetStatusRequest, StatusReply)

    def spawn(
        self,
        class_name: str,
        *,
        name: str | None = None,
        location_m: Vector3 | None = None,
        rotation_rad: Vector3 = (0.0, 0.0, 0.0),
        start_pose: str | None = None,
    ) -> Vector3 | None:
        """Spawn this client's robot, which has a reading of each sensor then (`get_readings`).

        Args:
            class_name: Class of the robot, one of `get_status().class_names`.
            name: Requested name; None lets the server choose.
            location_m: Position in the world frame; takes precedence over the start pose.
            rotation_rad: Roll, pitch, yaw in the world frame, with a location.
            start_pose: Name of a start pose, one of `get_start_poses`; without this and a location
                the server chooses.

        Returns:
            Location of the robot in metres where the requested one was not free, the nearest free
            one; else None.

        Raises:
            CatoptraError: There is no such class or start, with the names that exist, or this
                client has its robot: `reset` first, or connect another client for another robot.
            DeadlineExceededError: The robot may exist all the same: `reset` before the next try.

        Example:
            ```python
            with StreamClient.connect() as client:
                class_name = client.get_status().class_names[0]
                moved_to = client.spawn(class_name, location_m=(1.0, 0.0, 0.0))
            ```
        """
        # Arguments by keyword and defaults as in INIT; the message has every field.
        place = (name, location_m, start_pose, rotation_rad)
        return self._call(SpawnRequest, SensorReports, class_name, *place).moved_to

    def drive(
        self,
        left: float | None,
        right: float | None,
        *,
        normalized: bool = False,
        robot: str = "",
        halt_after_s: float | None = None,
    ) -> None:
        """Set the wheel speeds of both sides, which hold until the next call or `reset`.

        Args:
            left: Speed in rad/s, or in percent if normalized; None leaves the side unchanged.
            right: As `left`.
            normalized: Whether speeds are percent of the maximum.
            robot: Exact name of a robot whose owner shares its control (`share_control`); empty =
                this client's own.
            halt_after_s: Simulation time after which the robot halts unless another call sets its
                speeds, so that a program that hangs drives into nothing; None: never.

        Raises:
            CatoptraError: This client has no robot, or the other one does not exist or is not
                shared.
            LocalProtocolError: A speed is not finite; nothing was sent.

        Never repeated by the client, since a late drive would surprise. In lockstep nothing moves
        before `step`.
        """
        self._call(DriveRequest, Ok, left, right, normalized, robot, halt_after_s)

    def share_control(self, shared: bool = True) -> None:
        """Let other clients drive this client's robot, or no longer; it halts then.

        Args:
            shared: Whether others may drive it by `drive(robot=...)` and in the live page.

        Raises:
            CatoptraError: This client has no robot.
        """
        self._call(ShareControlRequest, Ok, shared)

    def publish(self, name: str, note: Mapping[str, object]) -> None:
        """Publish a note about the robot, such as the belief of its localization, to all viewers.

        A note replaces the one of the same name; `get_state` returns the notes of a robot. For data
        of one program's own use, keep them there: a note is text of at most 8 KiB.

        Args:
            name: Name of the note, at most 64 printable characters.
            note: Values of JSON, numbers and arrays of NumPy; SPEC.md 9.7 lists the keys that
                viewers draw.

        Raises:
            LocalProtocolError: The note has more than 8 KiB of JSON, or a number that is not
                finite; nothing was sent.
            CatoptraError: This client has no robot, or its robot has notes of 8 other names.

        Example:
            ```python
            client.publish("belief", {"pose": belief.mean, "covariance": belief.covariance})
            ```
        """
        self._call(PublishRequest, Ok, name, text_from_note(name, note))

    def get_state(
        self,
        robot: str = "",
        *,
        commands_after: int | None = None,
        ticks_after: float | None = None,
    ) -> StateReply:
        """Poses of all robots, and the newest readings, notes, commands and ticks of one.

        For viewers: it needs no robot. The readings of this client's own robot, parsed, are those
        of `get_readings`.

        Args:
            robot: Exact name; empty = the robot that the image port displays.
            commands_after: Number of the last command that is known, 0 before the first; None for
                no commands.
            ticks_after: Simulation time of the last tick that is known; None for no ticks. They
                are kept from the first such request on.
        """
        return self._call(GetStateRequest, StateReply, robot, commands_after, ticks_after)

    def get_setup(self) -> SetupReply:
        """What it takes to build the same simulation again."""
        return self._call(GetSetupRequest, SetupReply)

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep clock; the full cycle of readings and the result.

        All robots of the server advance. The last report is the `CommandResult` of the step.

        Args:
            time_s: Simulated seconds, 0 to 60; 0 reads the sensors without advancing.

        Raises:
            CatoptraError: The server runs in real time (start it with `--clock lockstep`, or wait
                and use `get_readings`), or the step is too long.
            DeadlineExceededError: The step takes longer than `timeout_s` and is still executed: a
                second call advances the clock once more. Compare `get_state().time_s` first.

        Example:
            ```python
            client.drive(2.0, 2.0)
            for _ in range(50):
                reports = client.step(0.1)
                frame = client.get_frame()
            ```
        """
        return _parse_reports(self._call(StepRequest, SensorReports, time_s))

    def reset(self) -> None:
        """Remove the robot from the world; another one may be spawned on this connection.

        Without a robot nothing happens. The clock goes on: for the same random numbers again spawn
        a robot of the same name, see `robot_episodes`.
        """
        self._call(ResetRequest, Ok)

    def get_readings(self) -> list[Report]:
        """Newest reading of each sensor of the robot, without waiting for the next ones.

        The same reading is returned again until its sensor has a new one: compare `time_s`. In
        lockstep `step` returns the readings.

        Raises:
            CatoptraError: This client has no robot.
        """
        return _parse_reports(self._call(GetReadingsRequest, SensorReports))

    def get_parts(self, class_name: str) -> list[Report]:
        """Configuration and geometry of a robot class, then of each of its sensors.

        Args:
            class_name: As in `get_status().class_names`, or of a robot of `get_state`.

        Raises:
            CatoptraError: There is no such class.
        """
        return _parse_reports(self._call(GetPartsRequest, SensorReports, class_name))

    def get_camera(self, name: str = "") -> OmniCamera | PerspectiveCamera:
        """Model of a camera of either kind: projection of directions to pixels, and back.

        A frame has the model of its camera already: `Frame.camera`.

        Args:
            name: Name in any case; empty = the first camera of this client's robot, or without a
                robot that of the first class with a camera.

        Raises:
            CatoptraError: There is no such camera; the reason names those that there are.
            RemoteProtocolError: The model is of a kind that this client does not know: update it.
        """
        return self.get_mounted_camera(name)[1]

    def get_camera_and_height(self, name: str = "") -> tuple[OmniCamera, float]:
        """Model of an omnidirectional camera, and the viewpoint's height above the floor in metres.

        Args:
            name: As in `get_camera`.

        Raises:
            CatoptraError: There is no such camera.
            RemoteProtocolError: The camera is a perspective one: use `get_mounted_camera`.
        """
        return omni_camera_from_pairs(_pairs_of(self._request_camera(name)))

    def get_mounted_camera(
        self, name: str = ""
    ) -> tuple[str, OmniCamera | PerspectiveCamera, Pose]:
        """Name and model of a camera of either kind, and the pose of its viewpoint on the robot.

        Args:
            name: As in `get_camera`.

        Raises:
            CatoptraError: There is no such camera.
        """
        reply = self._request_camera(name)
        model = any_camera_from_pairs(_pairs_of(reply))
        return reply.camera, model, pose_from_transform(reply.robot_from_mirror)

    def _request_camera(self, name: str) -> CameraReply:
        return self._call(GetCameraRequest, CameraReply, name)

    def set_accuracy(
        self,
        *,
        max_error_px: float | None = None,
        budget_ms: float | None = None,
        camera: str = "",
    ) -> PlanReply:
        """Set the accuracy target of an omnidirectional camera; the resulting rendering plan.

        Without arguments the call only reads the plan. The target holds for all viewers of the
        camera; for one frame with other settings use the `variant` of `get_frame`.

        Args:
            max_error_px: Bound on the displacement of outlines; 0 = none, None = unchanged.
            budget_ms: Duration of a frame; 0 = none, None = unchanged.
            camera: Name; empty = the omnidirectional camera of the robot.

        Raises:
            CatoptraError: This client has no robot with such a camera, or a number is negative.
            DeadlineExceededError: At the first target the server may measure the cost of frames,
                which takes seconds: call again, or connect with a longer `timeout_s`.

        Example:
            ```python
            plan = client.set_accuracy(max_error_px=0.5)
            ```
        """
        return self._call(SetAccuracyRequest, PlanReply, camera, max_error_px, budget_ms)

    def get_landmarks(self) -> tuple[Landmark, ...]:
        """True landmarks of the world, which never change: one request for a program's whole run is
        enough.
        """
        reply = self._call(GetLandmarksRequest, LandmarksReply)
        return tuple(map(_landmark_from_record, reply.landmarks))

    def get_landmark_projections(
        self, robot: str = "", camera: str = ""
    ) -> tuple[LandmarkProjection, ...]:
        """Projections of the landmarks into a camera now, with their visibility.

        Args:
            robot: As in `get_frame`.
            camera: As in `get_frame`.

        Raises:
            CatoptraError: There is no such camera.
        """
        reply = self._call(GetLandmarksRequest, LandmarksReply, robot, camera)
        # Only a reply without a camera has no time.
        time_s = reply.time_s or 0.0
        return tuple(
            LandmarkProjection(_landmark_from_record(one), one.pixel, bool(one.visible), time_s)
            for one in reply.landmarks
        )

    def get_start_poses(self) -> tuple[StartPoseRecord, ...]:
        """Named start poses of the world, for `spawn`."""
        return self._call(GetStartPosesRequest, StartPosesReply).start_poses

    def get_frame(
        self,
        *,
        encoding: ImageEncoding = ImageEncoding.JPEG,
        robot: str = "",
        camera: str = "",
        variant: FrameVariant | None = None,
        channels: Sequence[str] = (),
        channel_encoding: ChannelEncoding = ChannelEncoding.RAW,
    ) -> Frame:
        """Request the newest frame and wait for it.

        The frame is the newest that this client has not received, rendered on request; in lockstep
        it shows the moment of the request. Frames that are not requested are never sent, so a slow
        program misses frames (`Frame.missed_frames`) and never gets old ones. For the same camera
        again and again use `iter_frames`.

        Args:
            encoding: Encoding of the image; PNG and RAW are lossless, RAW is not copied.
            robot: Name of the robot; with an empty `camera` too, the image-port picture.
            camera: Name of the camera; empty = the first one of the robot.
            variant: Other settings for this frame, of an omnidirectional camera; the camera's own
                stay as they are.
            channels: Names of channels of ground truth (`catoptra_protocol.labels`), of
                one camera of any kind; the frame's `labels` has them.
            channel_encoding: Raw values, or compressed by zlib.

        Returns:
            The frame; `rgb` and labels are read-only: copy them to write.

        Raises:
            CatoptraError: There is no such robot, camera or channel, any more; or rendering failed.
            ConnectionLostError: As in the class. The request is repeated each second, so a server
                that is back within 1.5 s costs no error.
            DeadlineExceededError: No frame in time. The next call replaces the request, so no late
                frame is taken for a new one.
            RemoteProtocolError: Image or labels do not match the header of the frame.

        Example:
            ```python
            frame = client.get_frame(encoding=ImageEncoding.RAW, channels=("range",))
            ranges_m = frame.labels.truth.channels["range"]
            ```
        """
        header, parts = self.get_encoded_frame(
            GetFrameRequest(0, robot, camera, encoding, variant, tuple(channels), channel_encoding)
        )
        return frame_from_parts(
            header, parts, camera_cache=self._camera_cache, received_s=self._clock()
        )

    def get_encoded_frame(self, request: GetFrameRequest) -> tuple[FrameHeader, list[bytes]]:
        """Header of the newest frame, and its image and channels as they came.

        Args:
            request: What `get_frame` asks for; its id is chosen here.

        Raises:
            CatoptraError: As in `get_frame`, like the others.
        """
        request = dataclasses.replace(request, id=next(self._ids))
        return self._exchange(request, FrameHeader, "a frame", retry_interval_s=_RETRY_INTERVAL_S)

    def get_pixel(
        self, u_px: float, v_px: float, *, robot: str = "", camera: str = ""
    ) -> PixelReply:
        """What a camera sees at a point of its image now: direction, range and object.

        The ray passes through its own robot, which a picture with `SelfView` shows, and meets other
        robots as boxes. For what the image shows at every pixel ask `get_frame` for channels.

        Args:
            u_px: Column from the left edge; pixel centres are at +0.5.
            v_px: Row from the upper edge.
            robot: As in `get_frame`.
            camera: As in `get_frame`.

        Returns:
            The reply; its angles and range are None where the image shows nothing.

        Raises:
            CatoptraError: There is no such camera.
        """
        return self._call(GetPixelRequest, PixelReply, robot, camera, u_px, v_px)

    def iter_frames(
        self, *, encoding: ImageEncoding = ImageEncoding.JPEG, robot: str = "", camera: str = ""
    ) -> Iterator[Frame]:
        """Iterate over newest frames for ever; each is requested when the iterator advances.

        Not requested ahead: after a long loop body the next frame is new, not queued. `break` ends
        the loop, no request is pending then. An exception of `get_frame` ends the iterator: make a
        new one to go on, with the same client.

        Args:
            encoding: As in `get_frame`, like the others.
            robot: Name of the robot.
            camera: Name of the camera.

        Raises:
            CatoptraError: As in `get_frame`.

        Example:
            ```python
            while True:
                try:
                    for frame in client.iter_frames(robot="Mine"):
                        show(frame)
                except ConnectionLostError:
                    continue  # until the server is back
            ```
        """
        while True:
            yield self.get_frame(encoding=encoding, robot=robot, camera=camera)

    def _call(
        self,
        request_type: Callable[Concatenate[int, _P], Request],
        reply_type: type[_ReplyT],
        *values: _P.args,
        **fields: _P.kwargs,
    ) -> _ReplyT:
        """Reply of a type to a request with a new id and these fields; errors as of the class."""
        request = request_type(next(self._ids), *values, **fields)
        return self._exchange(request, reply_type, f"a reply to {request.KIND}")[0]

    def _exchange(
        self,
        request: Request,
        reply_type: type[_ReplyT],
        description: str,
        retry_interval_s: float | None = None,
    ) -> tuple[_ReplyT, _Parts]:
        """Send a request; its reply and the parts after the reply."""
        data = bytes_from_message(request)
        deadline_s = self._clock() + self._timeout_s
        self._socket.begin_wait()
        while True:
            _LOG.debug("to %s: %s", self._socket.address, request)
            # Repeated for frames only: a repeated drive or step would be executed twice.
            self._socket.send(data, deadline_s)
            until_s = deadline_s if retry_interval_s is None else self._clock() + retry_interval_s
            received = self._wait_for_reply(request.id, min(until_s, deadline_s))
            if received is not None:
                return self._check_reply(received[0], reply_type), received[1]
            if self._clock() >= deadline_s:
                # Heartbeats distinguish a lost server from a slow one: the remedies differ.
                self._socket.check_alive()
                raise DeadlineExceededError(
                    f"{self._socket.address} sends heartbeats but not {description} within "
                    f"{self._timeout_s:g} s: it is busy rendering or stepping; wait, or use a "
                    "larger timeout_s"
                )

    def _wait_for_reply(self, id_: int, deadline_s: float) -> tuple[Reply, _Parts] | None:
        """Reply with an id; heartbeats and late replies of earlier requests are skipped."""
        while (parts := self._socket.receive(deadline_s)) is not None:
            reply = reply_from_bytes(parts[0])
            _LOG.debug("from %s: %s", self._socket.address, reply)
            # Raised for any request: the id of an unreadable one is unknown to the server.
            if isinstance(reply, Error) and reply.id == 0:
                raise RemoteProtocolError(
                    f"{self._socket.address} cannot read the request: {reply.reason}"
                )
            # A late reply of a call that timed out has a lower id, a heartbeat none.
            if reply is not None and getattr(reply, "id", None) == id_:
                return reply, parts[1:]
        return None

    def _check_reply(self, reply: Reply, reply_type: type[_ReplyT]) -> _ReplyT:
        if isinstance(reply, Error):
            raise CatoptraError(f"{self._socket.address} rejected the request: {reply.reason}")
        if not isinstance(reply, reply_type):
            raise RemoteProtocolError(f"{self._socket.address} replied with {reply.KIND}")
        return reply


def _pairs_of(reply: CameraReply) -> Pairs:
    return tuple(reply.camera_model.items())


def _parse_reports(reply: SensorReports) -> list[Report]:
    reports = (report_from_message(parse_message(line)) for line in reply.reports)
    # None is a report of a newer server, which this client skips.
    return [report for report in reports if report is not None]


def _landmark_from_record(record: LandmarkRecord) -> Landmark:
    fields = dataclasses.fields(Landmark)
    return Landmark(**{field.name: getattr(record, field.name) for field in fields})
