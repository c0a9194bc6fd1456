"""ROS 2 messages of a robot over the stream, as any viewer sees it, and their file.

Frames and states come from two threads, each with its own connection; the caller's thread writes
into a sink: a file, or the topics of a ROS node. Between them is a queue of two seconds. What finds
it full is dropped and counted, in the file too.

`/tf` has the pose at each frame's exposure where a camera is recorded, otherwise that of each
state: states are newer than the frame beside them, and stamps of a topic never go back.

**Odometry** (REP 105). `odom` to `base_link` is what the odometry says, `map` to `odom` the rest,
its drift: at each stamp both together are the true pose to the last bit of a double. Odometry is
read some times a second, when `map` to `odom` changes; between two readings the true motion
continues the last one. Without odometry `odom` is the pose of spawning.
"""

from __future__ import annotations

import dataclasses
import json
import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

from catoptra_client.frame import image_bytes_from_rgb, rgb_from_image_bytes
from catoptra_client.frame_pictures import choose_cylinder
from catoptra_client.frame_sources.stream.frame_decoding import pose_from_transform
from catoptra_client.frame_sources.stream.stream_client import (
    LandmarkProjection,
    StreamClient,
)
from catoptra_client.recording import ros2_messages as ros
from catoptra_client.unwarp import (
    CylinderGeometry,
    PerspectiveGeometry,
    UnwarpMap,
    make_unwarp_map,
    unwarp,
)
from catoptra_protocol.camera_conf import any_camera_from_pairs
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.json_object import json_object_from_text
from catoptra_protocol.landmarks import csv_from_landmarks
from catoptra_protocol.limits import MAX_NOTE_BYTES
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.messages import json_from_message
from catoptra_protocol.stream.replies import (
    FrameHeader,
    LandmarkRecord,
    LandmarksReply,
    RobotState,
    SensorReports,
    StartPosesReply,
    StateReply,
)
from catoptra_protocol.stream.requests import (
    FrameVariant,
    GetFrameRequest,
    ImageEncoding,
    Transform,
)
from catoptra_protocol.usarsim.commands import Drive, command_from_message
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.readings import OdometryReading
from catoptra_protocol.usarsim.reports import (
    Configuration,
    Report,
    line_from_report,
    report_from_message,
)

_QUEUE_S = 2.0
_PROGRESS_INTERVAL_S = 0.5
_LANDMARKS_INTERVAL_S = 0.2
_FRAMES = ("map", "odom", "base_link")
# Channels of labels that ROS has an image encoding for.
CHANNEL_ENCODINGS = {"range": "32FC1", "ids": "16UC1"}
# Turn of each pinhole view, rad; the panorama is a cylinder about the robot's vertical.
VIEWS = {
    "front": 0.0,
    "right": 0.5 * math.pi,
    "back": math.pi,
    "left": -0.5 * math.pi,
    "panorama": 0.0,
}
_VIEW_SIZE_PX, _VIEW_FOV_RAD, _PANORAMA_COLUMNS = (640, 480), 0.5 * math.pi, 1080


@dataclass(frozen=True, slots=True)
class RecordingPlan:
    """What is recorded."""

    robot: str = ""
    """Name of the robot; empty: the one that the image port shows."""
    camera: str | None = ""
    """Name of its camera; empty: the first one; None: no pictures."""
    encoding: ImageEncoding = ImageEncoding.JPEG
    """JPEG or PNG."""
    picture: Picture = Picture.FLIPPED
    """Hand of the pictures of an omnidirectional camera."""
    channels: tuple[str, ...] = ()
    """Channels of labels: names of `CHANNEL_ENCODINGS`."""
    views: tuple[str, ...] = ()
    """Pictures unwarped from those of an omnidirectional camera: names of `VIEWS`."""
    hz: float = 30.0
    """Most frames a second of the time of day."""
    state_hz: float = 10.0
    """Requests a second for the ticks since the last one."""
    attachments: Mapping[str, bytes] = dataclasses.field(default_factory=dict)
    """Files to attach, by name."""


@dataclass(frozen=True, slots=True, eq=False)
class UnwarpedView:
    """A picture that is unwarped from that of an omnidirectional camera."""

    name: str
    geometry: CylinderGeometry | PerspectiveGeometry
    camera: PerspectiveCamera | None
    """Its exact model; None of a cylinder, which CameraInfo has no model for."""
    base_from_view: Pose
    """Of its optical frame, or of a cylinder's: x ahead, z up; between frames of REP 103."""
    unwarp_map: UnwarpMap


def make_view(name: str, camera: OmniCamera, robot_from_mirror: Pose) -> UnwarpedView:
    """View of a name in `VIEWS`, around the viewpoint of a camera."""
    mount, turn_rad = robot_from_mirror.rotation, VIEWS[name]
    axes = Pose.from_rpy(robot_from_mirror.translation, (0.0, 0.0, turn_rad))
    if name == "panorama":
        cylinder = choose_cylinder(camera, _PANORAMA_COLUMNS, robot_from_mirror=mount)
        unwarp_map = make_unwarp_map(camera, cylinder, robot_from_mirror=mount)
        return UnwarpedView(name, cylinder, None, ros.flu_pose(axes), unwarp_map)
    pinhole = PerspectiveCamera(*_VIEW_SIZE_PX, _VIEW_FOV_RAD)
    geometry = PerspectiveGeometry(*_VIEW_SIZE_PX, _VIEW_FOV_RAD, turn_rad)
    unwarp_map = make_unwarp_map(camera, geometry, robot_from_mirror=mount)
    return UnwarpedView(name, geometry, pinhole, ros.optical_pose(axes, pinhole), unwarp_map)


@dataclass(frozen=True, slots=True)
class RecordingProgress:
    """How far a recording is."""

    elapsed_s: float
    num_messages: int
    num_dropped: int


class MessageSink(Protocol):
    """Where messages go; a base class too, of sinks without attachments and metadata."""

    is_full: bool
    """Whether nothing more is written."""

    @property
    def num_messages(self) -> int:
        """Messages written."""

    def add_message(
        self,
        topic: str,
        type_name: str,
        message: ros.RosMessage,
        *,
        log_ns: int,
        publish_ns: int,
        is_latched: bool = False,
    ) -> None:
        """Write a message, as `RecordingWriter.add_message` does."""

    def add_attachment(self, name: str, data: bytes) -> None:
        """Attach a file."""
        return

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a table of texts."""
        return


class MessageSource:
    """Messages of a robot; `publish` returns at their end, which `stop` from any thread causes."""

    def __init__(
        self,
        plan: RecordingPlan | None = None,
        *,
        host: str = "127.0.0.1",
        stream_port: int = 5005,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._plan = plan or RecordingPlan()
        self._host, self._port, self._clock = host, stream_port, clock
        self._ended = threading.Event()
        self._queue: deque[tuple[float, Callable[[], None], str]] = deque()
        # Frames whose states are not all written.
        self._waiting: deque[tuple[FrameHeader, list[bytes], int]] = deque()
        self._changed = threading.Condition()
        self._dropped: Counter[str] = Counter()
        self._error: CatoptraError | None = None
        self._last_ns: dict[str, int] = {}
        self._last_texts: dict[str, str] = {}
        self._world_from_start: Transform | None = None
        self._static_transforms: dict[str, ros.RosMessage] = {}
        self._sensors: dict[str, ros.MountedSensor] = {}
        self._map_from_odom = Pose.identity()
        self._has_odometry = self._has_state = False
        # Time of the newest state that is written.
        self._written_s = -math.inf
        self._max_wheel_rad_s = 0.0
        self._wheels_rad_s = (0.0, 0.0)
        self._robot = self._camera = ""
        self._described: dict[str, str] | None = None
        self._model: OmniCamera | PerspectiveCamera
        self._views: list[UnwarpedView] = []
        # Width of pictures whose hand is not that of the camera; else 0.
        self._turned_width_px = 0
        self._last_command = 0
        self._begin_s = 0.0

    def stop(self) -> None:
        """End the messages."""
        self._ended.set()
        with self._changed:
            self._changed.notify()

    def publish(
        self,
        sink: MessageSink,
        duration_s: float | None = None,
        on_progress: Callable[[RecordingProgress], None] = lambda _: None,
    ) -> RecordingProgress:
        """Write messages into a sink until the end.

        Args:
            sink: Where they go.
            duration_s: Seconds of the time of day; None: until `stop`, or an interrupt.
            on_progress: Receives the progress twice a second.

        Raises:
            CatoptraError: No server, robot or camera, any more.
        """
        with StreamClient.connect(self._host, self._port) as client:
            return self._publish(client, sink, duration_s, on_progress)

    def _publish(
        self,
        client: StreamClient,
        sink: MessageSink,
        duration_s: float | None,
        on_progress: Callable[[RecordingProgress], None],
    ) -> RecordingProgress:
        self._sink = sink
        head = self._write_head(client)
        self._write_state(head, time.time_ns())
        self._tick_s = head.time_s
        # The head can take seconds, of which none is the drive's.
        start_s = self._clock()
        threads = [threading.Thread(target=self._produce, args=(self._poll_states,))]
        if self._plan.camera is not None:
            threads.append(threading.Thread(target=self._produce, args=(self._pull_frames,)))
        try:
            for thread in threads:
                thread.start()
            self._write_until(start_s, duration_s, on_progress)
        finally:
            self.stop()
            for thread in threads:
                thread.join()
            self._drain_queue()
            self._write_rest(client)
            dropped = {topic: str(count) for topic, count in self._dropped.items()}
            self._sink.add_metadata("catoptra_dropped", {"total": "0", **dropped})
        if self._error is not None:
            raise self._error
        return self._progress(start_s)

    def _write_rest(self, client: StreamClient) -> None:
        """Write the frames that wait, behind the ticks and commands up to them."""
        has_more = self._error is None
        while (
            has_more
            and not self._sink.is_full
            and self._waiting
            and self._waiting[-1][0].time_s > self._tick_s
        ):
            try:
                state = client.get_state(
                    self._robot, commands_after=self._last_command, ticks_after=self._tick_s
                )
            except CatoptraError:
                break
            has_more = bool(state.ticks) and self._take_states(state)
            self._drain_queue()
        if not self._sink.is_full:
            self._write_frames(math.inf)

    def _write_until(
        self,
        start_s: float,
        duration_s: float | None,
        on_progress: Callable[[RecordingProgress], None],
    ) -> None:
        told_s = start_s
        while not (self._ended.is_set() or self._sink.is_full):
            now_s = self._clock()
            if duration_s is not None and now_s - start_s >= duration_s:
                return
            with self._changed:
                if not self._queue:
                    self._changed.wait(0.1)
            self._drain_queue()
            if now_s - told_s >= _PROGRESS_INTERVAL_S:
                told_s = now_s
                on_progress(self._progress(start_s))

    def _drain_queue(self) -> None:
        while self._queue and not self._sink.is_full:
            self._queue.popleft()[1]()
        # Under a lockstep clock the next tick may wait for who sees this frame.
        self._write_frames(math.nextafter(self._written_s, math.inf))

    def _progress(self, start_s: float) -> RecordingProgress:
        elapsed_s = self._clock() - start_s
        return RecordingProgress(elapsed_s, self._sink.num_messages, self._dropped.total())

    def _produce(self, run: Callable[[StreamClient], None]) -> None:
        """Run a producer; its error ends the recording."""
        try:
            with StreamClient.connect(self._host, self._port) as client:
                run(client)
        except CatoptraError as error:
            self._error = self._error or error
            self.stop()

    def _put(self, kind: str, write: Callable[[], None]) -> bool:
        """Queue a message if there is room."""
        with self._changed:
            now_s = self._clock()
            if self._queue and now_s - self._queue[0][0] > _QUEUE_S:
                self._dropped[kind] += 1
                return False
            self._queue.append((now_s, write, kind))
            self._changed.notify()
            return True

    def _pull_frames(self, client: StreamClient) -> None:
        plan = self._plan
        is_omni = isinstance(self._find_camera(client), OmniCamera)
        variant = FrameVariant(picture=plan.picture.value) if is_omni else None
        assert plan.camera is not None, "there is a camera"
        request = GetFrameRequest(
            0, self._robot, self._camera, plan.encoding, variant, plan.channels
        )
        next_s = self._clock()
        while not self._ended.is_set():
            header, parts = client.get_encoded_frame(request)
            wall_ns = time.time_ns()
            self._put("frames", partial(self._waiting.append, (header, parts, wall_ns)))
            next_s = max(next_s + 1.0 / plan.hz, self._clock())
            self._ended.wait(next_s - self._clock())

    def _find_camera(self, client: StreamClient) -> OmniCamera | PerspectiveCamera:
        """Camera model of the frames; names that were left empty become known."""
        request = GetFrameRequest(0, self._robot, self._plan.camera or "", ImageEncoding.JPEG)
        header, _ = client.get_encoded_frame(request)
        if header.camera_model is None:
            raise CatoptraError(
                "the picture is of several cameras or of none: --robot and --camera name one"
            )
        self._camera = header.camera
        return any_camera_from_pairs(tuple(header.camera_model.items()))

    def _poll_states(self, client: StreamClient) -> None:
        next_s = landmarks_s = self._clock()
        while not self._ended.is_set():
            if self._plan.camera is not None and self._clock() >= landmarks_s:
                landmarks_s = self._clock() + _LANDMARKS_INTERVAL_S
                found = client.get_landmark_projections(self._robot, self._camera)
                if found:
                    self._put("states", partial(self._write_projections, found, time.time_ns()))
            state = client.get_state(
                self._robot, commands_after=self._last_command, ticks_after=self._tick_s
            )
            self._take_states(state)
            next_s = max(next_s + 1.0 / self._plan.state_hz, self._clock())
            self._ended.wait(next_s - self._clock())

    def _take_states(self, state: StateReply) -> bool:
        """Queue a reply if there is room; what found none is requested again."""
        has_room = self._put("states", partial(self._write_states, state, time.time_ns()))
        if has_room and state.commands:
            self._last_command = state.commands[-1].number
        if has_room and state.ticks:
            self._tick_s = state.ticks[-1].time_s
        return has_room

    def _write_head(self, client: StreamClient) -> StateReply:
        """Write what never changes; the state before the first messages."""
        self._robot = client.get_state(self._plan.robot).robot
        if not self._robot:
            raise CatoptraError("nothing to record: there is no such robot; --robot names one")
        if self._plan.camera is not None:
            # Fits of seconds, which are kept: at the first frame they would fill the queue.
            camera = self._find_camera(client)
            if isinstance(camera, OmniCamera) and camera.picture is not self._plan.picture:
                self._turned_width_px = camera.width_px
            ros.calibration_message(self._camera, camera, {}, self._plan.picture)
        # The ticks from now on are kept for the first request of them.
        state, status = client.get_state(self._robot, ticks_after=0.0), client.get_status()
        state = dataclasses.replace(state, ticks=())
        facts = {"server": status.server, "world": status.world, "clock": status.clock}
        self._sink.add_metadata("catoptra", {"robot": state.robot, **facts})
        setup = client.get_setup()
        self._sink.add_metadata("catoptra_setup", setup.options)
        self._sink.add_metadata("catoptra_digests", setup.digests)
        landmarks = client.get_landmarks()
        table = csv_from_landmarks(landmarks)
        files = {name: text.encode() for name, text in setup.files.items()}
        files |= {"landmarks.csv": table.encode()} if landmarks else {}
        for name, data in {**files, **self._plan.attachments}.items():
            self._sink.add_attachment(name, data)
        records = tuple(LandmarkRecord(**dataclasses.asdict(one)) for one in landmarks)
        starts = StartPosesReply(0, client.get_start_poses())
        parts = client.get_parts(self._find_robot(state).class_name)
        lines = b"".join(map(line_from_report, parts)).decode("latin-1").splitlines()
        fixed = status, starts, LandmarksReply(0, records), SensorReports(0, tuple(lines))
        replies = {one.KIND: json_from_message(one) for one in fixed}
        self._sink.add_metadata("catoptra_replies", replies)
        now_ns, time_s = time.time_ns(), state.time_s
        self._begin_s = time_s
        self._describe_robot(parts, state.time_s)
        markers = ros.landmarks_message(landmarks)
        self._write("/landmarks", "visualization_msgs/MarkerArray", markers, time_s, now_ns, True)
        described = ros.string_message([dataclasses.asdict(one) for one in landmarks])
        self._write("/landmarks/json", "std_msgs/String", described, time_s, now_ns, True)
        return state

    def _describe_camera(self, header: FrameHeader, wall_ns: int) -> None:
        """Write the calibration of a frame's camera, and the frames of it and its views."""
        time_s, name = header.time_s, header.camera
        assert header.camera_model is not None
        assert header.robot_from_mirror is not None
        self._described = header.camera_model
        self._model = camera = any_camera_from_pairs(tuple(header.camera_model.items()))
        message = ros.calibration_message(name, camera, header.camera_model, self._plan.picture)
        self._write(f"/{name}/calibration", "std_msgs/String", message, time_s, wall_ns, True)
        mount = pose_from_transform(header.robot_from_mirror)
        poses = {f"{name}_optical_frame": ros.optical_pose(mount, camera)}
        if isinstance(camera, OmniCamera):
            self._views = [make_view(one, camera, mount) for one in self._plan.views]
        for view in self._views:
            if view.camera is None:
                shape = ros.string_message(dataclasses.asdict(view.geometry))
                place = f"/{name}/{view.name}/geometry"
                self._write(place, "std_msgs/String", shape, time_s, wall_ns, True)
            poses[f"{name}_{view.name}"] = view.base_from_view
        self._write_static_transforms("base_link", poses, time_s, wall_ns)

    def _write_frame(self, header: FrameHeader, parts: list[bytes], wall_ns: int) -> None:
        time_s, name = header.time_s, header.camera
        if header.camera_model != self._described:
            self._describe_camera(header, wall_ns)
        frame_id, topic = f"{name}_optical_frame", f"/{name}"
        self._write_clock(time_s, wall_ns)
        self._write_base(header.world_from_robot, time_s, wall_ns)
        image = ros.compressed_image_message(time_s, frame_id, header.encoding.value, parts[0])
        type_name = "sensor_msgs/CompressedImage"
        self._write(f"{topic}/image/compressed", type_name, image, time_s, wall_ns)
        info = ros.camera_info_message(time_s, frame_id, self._model)
        self._write(f"{topic}/camera_info", "sensor_msgs/CameraInfo", info, time_s, wall_ns)
        if self._views:
            self._write_views(header, parts[0], wall_ns)
        size_px = header.height_px, header.width_px
        for channel, part in zip(self._plan.channels, parts[1:], strict=True):
            encoding = CHANNEL_ENCODINGS[channel]
            labels = ros.channel_image_message(time_s, frame_id, encoding, size_px, part)
            self._write(f"{topic}/{channel}", "sensor_msgs/Image", labels, time_s, wall_ns)
        # Last of a frame, so that who replays has the other messages by then.
        text = ros.string_message(json_from_message(header))
        self._write("/catoptra/frame", "std_msgs/String", text, time_s, wall_ns)

    def _write_views(self, header: FrameHeader, data: bytes, wall_ns: int) -> None:
        rgb, time_s, encoding = rgb_from_image_bytes(data), header.time_s, header.encoding.value
        for view in self._views:
            topic, frame_id = f"/{header.camera}/{view.name}", f"{header.camera}_{view.name}"
            data = image_bytes_from_rgb(unwarp(rgb, view.unwarp_map), f".{encoding}")
            image = ros.compressed_image_message(time_s, frame_id, encoding, data)
            type_name = "sensor_msgs/CompressedImage"
            self._write(f"{topic}/image/compressed", type_name, image, time_s, wall_ns)
            if view.camera is not None:
                info = ros.camera_info_message(time_s, frame_id, view.camera)
                self._write(f"{topic}/camera_info", "sensor_msgs/CameraInfo", info, time_s, wall_ns)

    def _write_projections(self, projections: Sequence[LandmarkProjection], wall_ns: int) -> None:
        found, time_s = [], projections[0].time_s
        for one in projections:
            # The server's are in the camera's own hand.
            u, v = one.pixel or (math.nan, math.nan)
            pixel = one.pixel and (self._turned_width_px - u if self._turned_width_px else u, v)
            found.append({"name": one.landmark.name, "pixel": pixel, "visible": one.visible})
        text = ros.string_message({"time_s": time_s, "landmarks": found})
        if ros.nanoseconds_from_s(time_s) > self._last_ns.get("/landmarks/pixels", -1):
            self._write("/landmarks/pixels", "std_msgs/String", text, time_s, wall_ns)

    def _write_frames(self, end_s: float) -> None:
        """Write the frames that were exposed before a time."""
        while self._waiting and self._waiting[0][0].time_s < end_s:
            self._write_frame(*self._waiting.popleft())

    def _write_states(self, state: StateReply, wall_ns: int) -> None:
        """Write the commands and ticks of a reply."""
        self._write_commands(state, wall_ns)
        for tick in state.ticks:
            robots = tuple(
                dataclasses.replace(
                    one,
                    world_from_robot=tick.world_from_robot,
                    wheel_speeds_rad_s=tick.wheel_speeds_rad_s,
                )
                if one.name == state.robot
                else one
                for one in state.robots
            )
            then = StateReply(0, tick.time_s, robots, state.robot, tick.reports, state.notes)
            self._write_state(then, wall_ns)

    def _write_commands(self, state: StateReply, wall_ns: int) -> None:
        for command in state.commands:
            # Those before the recording would be a pause at its begin.
            record = ros.string_message(dataclasses.asdict(command))
            command_s = max(command.time_s, self._begin_s)
            self._write("/catoptra/commands", "std_msgs/String", record, command_s, wall_ns)
            self._write_velocity(command.line, state, command_s, wall_ns)

    def _write_state(self, state: StateReply, wall_ns: int) -> None:
        """Write a state and its readings, which are of its own tick but for the first state's."""
        time_s = state.time_s
        self._write_frames(time_s)
        # Where nothing has moved the same state comes again.
        if ros.nanoseconds_from_s(time_s) <= self._last_ns.get("/ground_truth", -1):
            return
        robot = self._find_robot(state)
        self._write_clock(time_s, wall_ns)
        whole = ros.string_message(json_from_message(state))
        self._write("/catoptra/state", "std_msgs/String", whole, time_s, wall_ns)
        if robot.world_from_start != self._world_from_start:
            self._world_from_start = robot.world_from_start
            self._map_from_odom = ros.flu_pose(pose_from_transform(robot.world_from_start))
            if not self._has_odometry:
                self._write_static_transforms("map", {"odom": self._map_from_odom}, time_s, wall_ns)
        pose = ros.flu_pose(pose_from_transform(robot.world_from_robot))
        message = ros.pose_odometry_message(time_s, "map", pose)
        self._write("/ground_truth", "nav_msgs/Odometry", message, time_s, wall_ns)
        if self._plan.camera is None:
            self._write_base(robot.world_from_robot, time_s, wall_ns)
        speeds = ros.string_message({"wheel_speeds_rad_s": robot.wheel_speeds_rad_s})
        self._write("/catoptra/wheel_speeds", "std_msgs/String", speeds, time_s, wall_ns)
        is_exact = self._has_state or robot.wheel_speeds_rad_s == (0.0, 0.0)
        self._has_state, self._written_s = True, time_s
        for line in state.reports:
            report = self._write_report(line, time_s, wall_ns)
            if isinstance(report, OdometryReading) and is_exact:
                place = (report.x_m, report.y_m, 0.0)
                odom = ros.flu_pose(Pose.from_rpy(place, (0.0, 0.0, report.yaw_rad)))
                self._map_from_odom = pose @ odom.inverse()
        for note in state.notes:
            text = json.dumps([note.name, note.time_s, note.text])
            if self._is_new(f"note {note.name}", text):
                self._write_note(note.name, note.text, time_s, wall_ns)

    def _describe_robot(self, parts: Sequence[Report], time_s: float) -> None:
        """Learn of wheels and sensors, and write the frames of those on the chassis."""
        self._sensors = ros.sensors_by_name(parts)
        confs = [one for one in parts if isinstance(one, Configuration)]
        self._has_odometry = any(one.type == "Odometry" for one in confs)
        self._max_wheel_rad_s = float(confs[0].get("MaxSpeed") or 0.0)
        frames = {
            name: sensor.base_from_sensor
            for name, sensor in self._sensors.items()
            if sensor.base_from_sensor is not None and name not in _FRAMES
        }
        self._write_static_transforms("base_link", frames, time_s, time.time_ns())

    def _find_robot(self, state: StateReply) -> RobotState:
        robot = next((one for one in state.robots if one.name == state.robot), None)
        if robot is None:
            raise CatoptraError(f"robot {self._robot!r} is no longer there")
        return robot

    def _write_velocity(self, line: str, state: StateReply, time_s: float, wall_ns: int) -> None:
        """Write the speed that a DRIVE of the wheels commands, within the wheels' limits."""
        drive, robot = command_from_message(parse_message(line)), self._find_robot(state)
        if not isinstance(drive, Drive) or not robot.wheel_separation_m:
            return
        limit = self._max_wheel_rad_s
        unit = limit / 100.0 if drive.normalized else 1.0
        sides = zip((drive.left, drive.right), self._wheels_rad_s, strict=True)
        left, right = (
            before if new is None else min(max(unit * new, -limit), limit) for new, before in sides
        )
        self._wheels_rad_s = left, right
        radius_m = robot.wheel_radius_m
        speed = ros.velocity_message(radius_m * left, radius_m * right, robot.wheel_separation_m)
        self._write("/cmd_vel", "geometry_msgs/Twist", speed, time_s, wall_ns)

    def _write_report(self, line: str, time_s: float, wall_ns: int) -> Report | None:
        message = parse_message(line)
        report = report_from_message(message)
        found = ros.reading_messages(report, time_s, self._sensors)
        # A reading with a time of its own is there until the next one.
        stamp_s = getattr(report, "time_s", None) or time_s
        if not found and self._is_new(ros.source_of_message(message), line):
            words = ros.string_message(line)
            self._write("/catoptra/reports", "std_msgs/String", words, time_s, wall_ns)
        for topic, type_name, message_ in found:
            if ros.nanoseconds_from_s(stamp_s) > self._last_ns.get(topic, -1):
                self._write(topic, type_name, message_, stamp_s, wall_ns)
        return report

    def _write_note(self, name: str, text: str, time_s: float, wall_ns: int) -> None:
        note = json_object_from_text(text, MAX_NOTE_BYTES)
        belief = ros.filter_message(time_s, note)
        if belief is not None:
            self._write(f"/filter/{name}", "nav_msgs/Odometry", belief, time_s, wall_ns)
        message = ros.string_message({"name": name, "note": note})
        self._write("/catoptra/notes", "std_msgs/String", message, time_s, wall_ns)

    def _is_new(self, name: str, text: str) -> bool:
        is_new = self._last_texts.get(name) != text
        self._last_texts[name] = text
        return is_new

    def _write_clock(self, time_s: float, wall_ns: int) -> None:
        # Frames are older than the states beside them.
        if ros.nanoseconds_from_s(time_s) > self._last_ns.get("/clock", -1):
            message = ros.clock_message(time_s)
            self._write("/clock", "rosgraph_msgs/Clock", message, time_s, wall_ns)

    def _write_base(self, world_from_robot: Transform, time_s: float, wall_ns: int) -> None:
        map_from_base = ros.flu_pose(pose_from_transform(world_from_robot))
        odom_from_base = self._map_from_odom.inverse() @ map_from_base
        transforms = [ros.transform_message(time_s, "odom", "base_link", odom_from_base)]
        if self._has_odometry:
            transforms.append(ros.transform_message(time_s, "map", "odom", self._map_from_odom))
        message = {"transforms": transforms}
        self._write("/tf", "tf2_msgs/TFMessage", message, time_s, wall_ns)

    def _write_static_transforms(
        self, parent: str, poses: Mapping[str, Pose], time_s: float, wall_ns: int
    ) -> None:
        """Write static transforms parent_from_child by child, with all earlier ones."""
        # Latched messages have a depth of 1: the newest one has all.
        for child, pose in poses.items():
            self._static_transforms[child] = ros.transform_message(time_s, parent, child, pose)
        message = {"transforms": list(self._static_transforms.values())}
        self._write("/tf_static", "tf2_msgs/TFMessage", message, time_s, wall_ns, True)

    def _write(
        self,
        topic: str,
        type_name: str,
        message: ros.RosMessage,
        time_s: float,
        wall_ns: int,
        is_latched: bool = False,
    ) -> None:
        log_ns = ros.nanoseconds_from_s(time_s)
        if is_latched:
            # Written when it is known, which may be after a newer one of its topic.
            log_ns = max(log_ns, self._last_ns.get(topic, 0))
        self._last_ns[topic] = log_ns
        self._sink.add_message(
            topic, type_name, message, log_ns=log_ns, publish_ns=wall_ns, is_latched=is_latched
        )


class Recorder(MessageSource):
    """One recording; `record` returns at its end, which `stop` from any thread brings about."""

    def __init__(
        self,
        path: Path,
        plan: RecordingPlan | None = None,
        *,
        host: str = "127.0.0.1",
        stream_port: int = 5005,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(plan, host=host, stream_port=stream_port, clock=clock)
        self._path = path

    def record(
        self,
        duration_s: float | None = None,
        on_progress: Callable[[RecordingProgress], None] = lambda _: None,
    ) -> RecordingProgress:
        """Record until the end, and leave a complete file however that comes.

        Args:
            duration_s: Seconds of the time of day; None: until `stop`, or an interrupt.
            on_progress: Receives the progress twice a second.

        Raises:
            CatoptraError: No server, robot or camera, any more; the file exists; the disk is full.
        """
        # The packages of MCAP files are an extra, which topics of a node do without.
        from catoptra_client.recording.mcap_file import RecordingWriter

        with (
            StreamClient.connect(self._host, self._port) as client,
            RecordingWriter(self._path) as writer,
        ):
            progress = self._publish(client, writer, duration_s, on_progress)
        if writer.is_full:
            raise CatoptraError(
                f"{self._path}: the disk is full; the file is complete up to there, "
                f"{progress.num_messages} messages"
            )
        return progress
