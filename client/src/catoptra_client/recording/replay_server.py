"""A recording as a server: control port, image port and stream show what was recorded.

The clock starts with the first client, runs at a chosen speed, and stands at the recording's end,
from which on no client gets another frame. Every client that spawns has the recorded robot. What a
recording cannot answer is rejected with that reason: `error` on the stream, `RES` with
`{Status Failed} {Reason ...}` on the control port, which has the form of a rejected INIT; the image
port closes the connection.

The pictures of the image port have the hand in which they were recorded, as CONF says; JPEG files
are served as they are, PNG files as RAW.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import zmq
import zmq.asyncio

from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame import image_bytes_from_rgb, rgb_from_image_bytes
from catoptra_client.frame_sources.stream.frame_decoding import pose_from_transform
from catoptra_client.recording.recording import (
    FRAME_TOPIC,
    RecordedFrame,
    RecordedState,
    Recording,
)
from catoptra_protocol.errors import CatoptraError, InvalidRequestError, RemoteProtocolError
from catoptra_protocol.limits import MAX_REQUEST_BYTES
from catoptra_protocol.stream import replies, requests
from catoptra_protocol.stream.messages import (
    SCHEMA_VERSION,
    bytes_from_message,
    request_from_bytes,
)
from catoptra_protocol.usarsim.commands import (
    Command,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    Stepper,
)
from catoptra_protocol.usarsim.configurations import Geometry, GeometryItem
from catoptra_protocol.usarsim.control_connection import ControlServer
from catoptra_protocol.usarsim.grammar import Dialect, Message, format_line, parse_message
from catoptra_protocol.usarsim.image_port import (
    FullFrameRequest,
    ImageRequest,
    ImageRequestReader,
    ImageType,
    encode_frame_header,
    encode_raw_header,
)
from catoptra_protocol.usarsim.reports import (
    Greeting,
    InitResult,
    StartPose,
    StartPoses,
    line_from_report,
)
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_protocol.vectors import Vector3

log = logging.getLogger(__name__)
_READ_BYTES = 4096
_HEARTBEAT_S = 0.5
_MAX_UNSENT_BYTES = 2**20
_MAX_CLIENTS = 256
_MAX_COMMANDS = 512
# As a server's.
_MAX_TICKS, _MAX_LISTED_TICKS = 256, 64
_SAME_PLACE_M = 0.01
# As many unread ones fit into a client's queue.
_MAX_IDLE_HEARTBEATS = 16
_SOCKET_OPTIONS = {
    zmq.LINGER: 0,
    zmq.IPV6: 1,
    # A message to a client that is gone is an error, by which it is noticed.
    zmq.ROUTER_MANDATORY: 1,
    zmq.MAXMSGSIZE: MAX_REQUEST_BYTES,
    # Messages that wait for a client, each a frame at worst.
    zmq.SNDHWM: 64,
}


class _RejectedError(CatoptraError):
    """A request that a recording cannot answer."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"a recording cannot {reason}")


@dataclass(slots=True)
class _Client:
    """A client of the stream."""

    has_robot: bool = False
    pending: requests.GetFrameRequest | None = None
    last_id: int = 0
    idle_heartbeats: int = 0
    """Heartbeats since its last request, without one that waits."""
    last_number: int = 0
    """Number of the last frame that it has."""
    num_sent: int = 0
    num_missed: int = 0


class ReplayServer:
    """A recording that is served from `run` to its cancellation."""

    def __init__(self, recording: Recording, *, speed: float = 1.0) -> None:
        """Open no port yet.

        Args:
            recording: What to serve.
            speed: Simulated seconds a second.

        Raises:
            CatoptraError: The recording has no state, or none of the replies at its head.
        """
        self._speed = speed
        self._status = recording.get_reply(replies.StatusReply)
        self._greeting = Greeting("Recording", self._status.world)
        ControlServer().send(self._greeting)  # raises for a name that no line can carry
        self._starts = recording.get_reply(replies.StartPosesReply)
        self._landmarks = recording.get_reply(replies.LandmarksReply)
        self._parts = recording.get_reply(replies.SensorReports)
        self._setup = recording.setup
        self._events = recording.iter_events()
        self._frame: RecordedFrame | None = None
        self._number, self._has_ended = 0, False
        has_frames, state = FRAME_TOPIC in recording.topics, None
        # The first of both, from which on all has an answer.
        while state is None or (has_frames and self._frame is None):
            event = next(self._events, None)
            if event is None:
                raise recording.error("it has no state of its robot, and nothing to serve")
            if isinstance(event, RecordedState):
                state = event.state
            else:
                self._frame, self._number = event, 1
        if all(one.name != state.robot for one in state.robots):
            raise recording.error(f"its state does not list its robot {state.robot[:60]!r}")
        self._state, self._name, self._begin_s = state, state.robot, state.time_s
        self._commands = deque(state.commands, _MAX_COMMANDS)
        self._ticks: deque[replies.TickRecord] = deque(maxlen=_MAX_TICKS)
        self._aliases: set[str] = set()
        self._clients: dict[bytes, _Client] = {}
        self._controllers: set[asyncio.StreamWriter] = set()
        self._started, self._changed = asyncio.Event(), asyncio.Condition()

    async def run(self, address: ServerAddress, on_ready: Callable[[ServerAddress], None]) -> None:
        """Serve until cancelled.

        Args:
            address: Host and ports; port 0 is any free one.
            on_ready: Receives the address once all ports are open.

        Raises:
            CatoptraError: A port is not available, or the recording is damaged.
        """
        context = zmq.asyncio.Context()
        host, servers = address.host, list[asyncio.Server]()
        try:
            stream_port = self._bind_stream(context, host, address.stream_port or 0)
            for port, handle in (
                (address.control_port, self._serve_control),
                (address.image_port, self._serve_images),
            ):
                servers.append(await asyncio.start_server(handle, host, port, limit=2**16))
            control, image = (server.sockets[0].getsockname()[1] for server in servers)
            on_ready(ServerAddress(host, control, image, stream_port))
            await asyncio.gather(self._play(), self._serve_stream(), self._send_heartbeats())
        except (OSError, zmq.ZMQError) as error:
            raise CatoptraError(f"a port of {host} is not available: {error}") from error
        finally:
            for server in servers:
                server.close()
            context.destroy(linger=0)

    def _bind_stream(self, context: zmq.asyncio.Context, host: str, port: int) -> int:
        """Open the stream; its port."""
        self._socket = context.socket(zmq.ROUTER)
        for option, value in _SOCKET_OPTIONS.items():
            self._socket.set(option, value)
        self._socket.bind(f"tcp://{f'[{host}]' if ':' in host else host}:{port or '*'}")
        endpoint = str(self._socket.get_string(zmq.LAST_ENDPOINT)).rstrip("\0")
        return int(endpoint.rpartition(":")[2])

    async def _play(self) -> None:
        """Show each frame and state at its time."""
        await self._started.wait()
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        # Chunks are unpacked and messages parsed elsewhere: both ports go on meanwhile.
        while (event := await asyncio.to_thread(next, self._events, None)) is not None:
            due_s = began_s + (event.time_s - self._begin_s) / self._speed
            await asyncio.sleep(max(0.0, due_s - loop.time()))
            if isinstance(event, RecordedFrame):
                await self._show_frame(event)
            else:
                self._show_state(event)
        log.info("the recording has ended at %.2f s", self._state.time_s)
        self._has_ended = True
        async with self._changed:
            self._changed.notify_all()
        for identity, client in list(self._clients.items()):
            if client.pending is not None:
                request, client.pending = client.pending, None
                await self._send(identity, replies.Error(request.id, str(self._end_error())))

    async def _show_frame(self, frame: RecordedFrame) -> None:
        self._frame = frame
        self._number += 1
        async with self._changed:
            self._changed.notify_all()
        for identity, client in list(self._clients.items()):
            if client.pending is not None:
                await self._send_frame(identity, client)

    def _show_state(self, event: RecordedState) -> None:
        self._state = event.state
        self._commands.extend(event.state.commands)
        for robot in event.state.robots:
            if robot.name == self._name:
                place = robot.world_from_robot, robot.wheel_speeds_rad_s
                self._ticks.append(replies.TickRecord(event.time_s, *place, event.readings))
        for writer in self._controllers:
            is_reading = writer.transport.get_write_buffer_size() < _MAX_UNSENT_BYTES
            if event.readings and is_reading and not writer.is_closing():
                _write_lines(writer, event.readings)

    def _end_error(self) -> CatoptraError:
        return _RejectedError(f"show another frame: it has ended at {self._state.time_s:.2f} s")

    def _find_robot(self) -> replies.RobotState:
        """State of the recorded robot."""
        return next(one for one in self._state.robots if one.name == self._name)

    def _check_class(self, class_name: str) -> replies.RobotState:
        """The recorded robot, if it is of a class. Raises CatoptraError for another one."""
        robot = self._find_robot()
        names = robot.class_name, class_name, *self._status.class_names
        own, wanted, *known = (name.rpartition(".")[2].lower() for name in names)
        if wanted not in known:
            classes = ", ".join(self._status.class_names)
            raise CatoptraError(f"there is no class {class_name!r}: there are {classes}")
        if own != wanted:
            raise _RejectedError(
                f"show a {class_name}: it has the {robot.class_name} {self._name!r} alone"
            )
        return robot

    def _spawn(self, init: Init) -> Vector3 | None:
        """Where the robot is by now, unless that is the place of INIT.

        Raises:
            CatoptraError: There is no such class or start; or the robot started elsewhere.
        """
        robot = self._check_class(init.class_name)
        place = init.location_m
        if place is None:
            starts = {one.name.lower(): one.location_m for one in self._starts.start_poses}
            place = starts.get((init.start or "").lower())
        if place is None:
            names = ", ".join(one.name for one in self._starts.start_poses)
            raise CatoptraError(f"there is no start {init.start!r}: this world has {names}")
        began, now = robot.world_from_start.position_m, robot.world_from_robot.position_m
        if math.dist(place[:2], began[:2]) > _SAME_PLACE_M:
            x, y, _ = began
            raise _RejectedError(f"spawn the robot there: it was spawned at {x:.2f}, {y:.2f}")
        if init.name and len(self._aliases) < _MAX_CLIENTS:
            self._aliases.add(init.name)
        return None if math.dist(place[:2], now[:2]) < _SAME_PLACE_M else now

    def _is_own(self, robot: str) -> bool:
        """Whether a name is of the recorded robot: its own, or one that a client spawned it by."""
        return robot in ("", self._name) or robot in self._aliases

    # --- the stream ---

    async def _serve_stream(self) -> None:
        while True:
            identity, *parts = await self._socket.recv_multipart()
            self._started.set()
            if identity not in self._clients and len(self._clients) >= _MAX_CLIENTS:
                del self._clients[next(iter(self._clients))]
            client = self._clients.setdefault(identity, _Client())
            client.idle_heartbeats = 0
            try:
                if len(parts) != 1:
                    raise RemoteProtocolError("a message of several parts")
                request = request_from_bytes(parts[0])
            except InvalidRequestError as error:
                await self._send(identity, replies.Error(error.request_id, str(error)))
                continue
            except RemoteProtocolError as error:
                await self._send(identity, replies.Error(0, str(error)))
                continue
            try:
                if isinstance(request, requests.GetFrameRequest):
                    await self._request_frame(identity, client, request)
                else:
                    if isinstance(request, requests.GetStatusRequest):
                        await self._beat()
                    await self._send(identity, self._answer(client, request))
            except CatoptraError as error:
                await self._send(identity, replies.Error(request.id, str(error)))

    def _answer(self, client: _Client, request: requests.Request) -> replies.Reply:
        state, replace = self._state, dataclasses.replace
        match request:
            case requests.GetStatusRequest(id_):
                return replace(
                    self._status,
                    id=id_,
                    server=f"recording of {self._status.server}",
                    num_clients=len(self._clients),
                    has_robot=client.has_robot,
                    sent_frames=client.num_sent,
                )
            case requests.GetStartPosesRequest(id_):
                return replace(self._starts, id=id_)
            case requests.GetLandmarksRequest(id_, robot, camera):
                if robot is not None or camera is not None:
                    raise _RejectedError("project landmarks into a camera")
                return replace(self._landmarks, id=id_)
            case requests.GetStateRequest(id_, name, after, ticks_after):
                if self._is_own(name):
                    newer = [one for one in self._commands if one.number > (after or 0)]
                    commands = () if after is None else tuple(newer)
                    late = [one for one in self._ticks if one.time_s > (ticks_after or 0.0)]
                    ticks = () if ticks_after is None else tuple(late[:_MAX_LISTED_TICKS])
                    return replace(state, id=id_, commands=commands, ticks=ticks)
                if any(one.name == name for one in state.robots):
                    raise _RejectedError(f"tell the readings of {name!r}: it has {self._name!r}")
                return replace(state, id=id_, robot="", reports=(), notes=(), commands=())
            case requests.GetPartsRequest(id_, class_name):
                self._check_class(class_name)
                return replace(self._parts, id=id_)
            case requests.GetSetupRequest(id_):
                return replace(self._setup, id=id_)
            case requests.SpawnRequest():
                if client.has_robot:
                    raise CatoptraError("this client has its robot: reset first")
                place = request.location_m, request.rotation_rad or (0.0, 0.0, 0.0)
                init = Init(request.class_name, request.name, *place, request.start)
                moved_to = self._spawn(init)
                client.has_robot = True
                return replies.SensorReports(request.id, state.reports, moved_to, self._name)
            case requests.ResetRequest(id_):
                client.has_robot = False
                return replies.Ok(id_)
            case requests.GetReadingsRequest(id_):
                if not client.has_robot:
                    raise CatoptraError("this client has no robot")
                return replies.SensorReports(id_, state.reports)
            case requests.GetCameraRequest(id_, camera):
                header = self._require_frame("", camera)
                assert header.camera_model is not None
                assert header.robot_from_mirror is not None
                names = id_, header.class_name, header.camera
                model = header.camera_model, header.robot_from_mirror, header.plan
                return replies.CameraReply(*names, *model)
            case _:
                raise _RejectedError(f"answer {request.KIND}")

    def _require_frame(self, robot: str, camera: str) -> replies.FrameHeader:
        """Header of the newest frame, if robot and camera are those of the recording."""
        if self._frame is None:
            raise _RejectedError("show a camera: none was recorded")
        header = self._frame.header
        if not self._is_own(robot) or camera.lower() not in ("", header.camera.lower()):
            raise _RejectedError(
                f"show camera {camera!r} of {robot!r}: it has {header.camera!r} of {header.robot!r}"
            )
        return header

    async def _request_frame(
        self, identity: bytes, client: _Client, request: requests.GetFrameRequest
    ) -> None:
        if request.id == client.last_id:
            return
        client.last_id = request.id
        if client.pending is not None:
            replaced, client.pending = client.pending.id, None
            await self._send(
                identity, replies.Error(replaced, f"superseded by request {request.id}")
            )
        self._check_frame_request(request)
        if self._has_ended and client.last_number == self._number:
            raise self._end_error()
        client.pending = request
        if client.last_number < self._number:
            await self._send_frame(identity, client)

    def _check_frame_request(self, request: requests.GetFrameRequest) -> None:
        """Raise for a frame of other settings than were recorded."""
        header = self._require_frame(request.robot, request.camera)
        recorded = {one.name for one in header.labels.channels} if header.labels else set()
        if missing := [name for name in request.channels if name not in recorded]:
            known = ", ".join(sorted(recorded)) or "none"
            raise _RejectedError(f"label pixels by {missing[0][:80]!r}: it has {known}")
        if request.channels and request.channel_encoding is not requests.ChannelEncoding.RAW:
            raise _RejectedError("send compressed labels")
        picture = (header.camera_model or {}).get("Picture")
        own = requests.FrameVariant(), requests.FrameVariant(picture=picture)
        if request.variant not in (None, *own):
            raise _RejectedError("draw a variant: --rerender draws a recorded drive again")

    async def _send_frame(self, identity: bytes, client: _Client) -> None:
        request, client.pending = client.pending, None
        assert request is not None
        assert self._frame is not None
        header, parts = self._frame.header, self._frame.parts
        if client.last_number:
            client.num_missed += self._number - client.last_number - 1
        client.last_number, client.num_sent = self._number, client.num_sent + 1
        recorded = header.labels.channels if header.labels else ()
        found = {one.name: (one, part) for one, part in zip(recorded, parts[1:], strict=True)}
        chosen = [found[name] for name in request.channels]
        labels = header.labels if chosen else None
        if labels is not None:
            labels = dataclasses.replace(labels, channels=tuple(one for one, _ in chosen))
        reply = dataclasses.replace(
            header,
            id=request.id,
            sequence=self._number,
            encoding=request.encoding,
            missed_frames=client.num_missed,
            dropped_frames=0,
            labels=labels,
        )
        image = _encode_image(parts[0], header.encoding, request.encoding)
        await self._send(identity, reply, image, *(part for _, part in chosen))

    async def _send(self, identity: bytes, reply: replies.Reply, *parts: bytes) -> None:
        try:
            data = bytes_from_message(reply)
            await self._socket.send_multipart([identity, data, *parts], zmq.NOBLOCK)
        except zmq.Again:
            pass  # What a client does not read is dropped: it does not hold up the others.
        except zmq.ZMQError:
            self._clients.pop(identity, None)

    async def _send_heartbeats(self) -> None:
        while True:
            await self._beat()
            await asyncio.sleep(_HEARTBEAT_S)

    async def _beat(self) -> None:
        """Send a heartbeat to each client, and forget those that are gone."""
        for identity, client in list(self._clients.items()):
            client.idle_heartbeats += client.pending is None
            if client.idle_heartbeats <= _MAX_IDLE_HEARTBEATS:
                await self._send(identity, replies.Heartbeat(SCHEMA_VERSION))

    # --- the ports of USARSim ---

    async def _serve_control(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._started.set()
        protocol = ControlServer()
        try:
            writer.write(protocol.send(self._greeting))
            while data := await reader.read(_READ_BYTES):
                for command in protocol.receive(data):
                    if writer.is_closing():
                        return
                    self._execute(command, writer)
                await writer.drain()
        except (OSError, CatoptraError) as error:
            log.info("a control connection ended: %s", error)
        finally:
            self._controllers.discard(writer)
            writer.close()

    def _execute(self, command: Command, writer: asyncio.StreamWriter) -> None:
        time_s = self._state.time_s
        has_robot = writer in self._controllers
        match command:
            case Init() if not has_robot:
                try:
                    moved_to = self._spawn(command)
                except CatoptraError as error:
                    writer.write(line_from_report(InitResult(time_s, failure=str(error))))
                    return
                self._controllers.add(writer)
                writer.write(line_from_report(InitResult(time_s, self._name, moved_to)))
                _write_lines(writer, self._state.reports)
            case GetStartPoses():
                starts = (
                    StartPose(one.name, one.location_m, one.rotation_rad)
                    for one in self._starts.start_poses
                )
                writer.write(line_from_report(StartPoses(tuple(starts))))
            case Init() | Stepper():
                pass
            case GetConf() | GetGeo() if has_robot and not self._is_package(command.type):
                writer.write(self._describe_part(command))
            case _ if has_robot:
                reason = f"a recording cannot execute {command.WORD}"
                if isinstance(command, GetConf | GetGeo):
                    reason = f"a recording cannot tell {command.WORD[3:]} of {command.type}"
                head = (("Time", f"{time_s:.2f}"), ("Type", command.WORD), ("Status", "Failed"))
                writer.write(format_line("RES", (*head, ("Reason", reason))))
            case _:
                pass  # commands to a robot that is not there

    def _is_package(self, type_: str) -> bool:
        """Whether parts of a type are mission packages, whose links the stream does not tell."""
        has_any = any(line.startswith("MISSTA") for line in self._state.reports)
        return has_any and type_.lower() == "mispkg"

    def _describe_part(self, command: GetConf | GetGeo) -> bytes:
        """Lines of the recorded parts of a type and name; the empty line without any."""
        word, type_ = command.WORD[3:], command.type.lower()
        name = None if type_ == "robot" else command.name
        wanted = "groundvehicle" if type_ == "robot" else type_
        found = [
            part
            for part in (*map(parse_message, self._parts.reports), *self._describe_camera_lines())
            if part.word == word
            and (part.get("Type") or "").lower() == wanted
            and (name is None or name.lower() == (part.get("Name") or "").partition(" ")[0].lower())
        ]
        if not found:
            names = (("Name", name),) if name else ()
            return format_line(word, (("Type", command.type), *names))
        if word == "GEO":
            # One line with all of a type.
            pairs = [pair for part in found for pair in part.pairs if pair[0] != "Type"]
            return format_line(word, (found[0].pairs[0], *pairs))
        return b"".join(format_line(word, part.pairs) for part in found)

    def _describe_camera_lines(self) -> list[Message]:
        """CONF and GEO of the recorded camera."""
        if self._frame is None:
            return []
        header = self._frame.header
        assert header.camera_model is not None
        assert header.robot_from_mirror is not None
        pose = pose_from_transform(header.robot_from_mirror)
        x, y, z = map(float, pose.translation)
        item = GeometryItem(header.camera, (x, y, z), pose.to_rpy())
        pairs = tuple(header.camera_model.items())
        if "Projection" in header.camera_model:
            # The model of an ordinary camera; that of another one has these fields.
            fov = f"{math.degrees(float(header.camera_model['HorizontalFov'])):.4f}"
            pairs = tuple((f"Camera{name}Fov", fov) for name in ("Def", "Min", "Max", ""))
        if header.error_bound_px is not None:
            pairs = (*pairs, ("ErrorBoundPx", format_fixed_point(header.error_bound_px, 6)))
        head = ("Type", "Camera"), ("Name", header.camera)
        geometry = Geometry("Camera", (item,)).to_messages(Dialect.UT2004)
        return [Message("CONF", (*head, *pairs)), *geometry]

    async def _serve_images(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._started.set()
        reader_, number = ImageRequestReader(), 0
        try:
            while data := await reader.read(_READ_BYTES):
                for request in reader_.receive(data):
                    if self._frame is None:
                        return  # as a server without a picture
                    async with self._changed:
                        while self._number <= number and not self._has_ended:
                            await self._changed.wait()
                    if self._number <= number:
                        return
                    number = self._number
                    reply = await asyncio.to_thread(_encode_reply, self._frame, request)
                    if writer.is_closing():
                        return
                    writer.write(reply)
                    await writer.drain()
        except (OSError, RemoteProtocolError) as error:
            log.info("an image connection ended: %s", error)
        finally:
            writer.close()


def _write_lines(writer: asyncio.StreamWriter, lines: Sequence[str]) -> None:
    writer.write("".join(f"{line}\r\n" for line in lines).encode("latin-1", "replace"))


def _encode_image(
    data: bytes, recorded: requests.ImageEncoding, wanted: requests.ImageEncoding
) -> bytes:
    """Image of a frame in the encoding that a client wants."""
    if wanted is recorded:
        return data
    rgb = rgb_from_image_bytes(data)
    if wanted is requests.ImageEncoding.RAW:
        return rgb.tobytes()
    return image_bytes_from_rgb(rgb, f".{wanted.value}")


def _encode_reply(frame: RecordedFrame, request: ImageRequest) -> bytes:
    """Reply of the image port: a JPEG as it was recorded, or RAW; a region of it."""
    data, is_jpeg = frame.parts[0], frame.header.encoding is requests.ImageEncoding.JPEG
    if is_jpeg and isinstance(request, FullFrameRequest):
        return encode_frame_header(ImageType.GOOD, len(data)) + data
    rgb = rgb_from_image_bytes(data)
    if not isinstance(request, FullFrameRequest):
        rows, columns = rgb.shape[:2]
        left, top = min(request.x, columns - 1), min(request.y, rows - 1)
        right = max(request.x + request.width, left + 1)
        rgb = rgb[top : max(request.y + request.height, top + 1), left:right]
    if is_jpeg:
        data = image_bytes_from_rgb(rgb, ".jpg")
        return encode_frame_header(ImageType.GOOD, len(data)) + data
    height, width = rgb.shape[:2]
    padding = bytes(-3 * width % 4)
    rows_bgr = b"".join(row[:, ::-1].tobytes() + padding for row in rgb)
    payload = encode_raw_header(width, height) + rows_bgr
    return encode_frame_header(ImageType.RAW, len(payload)) + payload
