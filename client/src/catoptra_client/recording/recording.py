"""A recorded drive as the stream's messages: those of the server, and frames with their parts.

A file is read from its beginning to its end, again for each use; what is kept is one frame, one
state, and the head: attachments and the replies that never change.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from catoptra_client.recording.mcap_file import (
    RecordedFile,
    RecordedMessage,
    RecordedTable,
    decode_message,
    read_entries,
)
from catoptra_client.recording.ros2_messages import source_of_message
from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from catoptra_protocol.json_object import json_object_from_text
from catoptra_protocol.limits import MAX_REQUEST_BYTES
from catoptra_protocol.stream.codec import dataclass_from_fields
from catoptra_protocol.stream.messages import reply_from_json
from catoptra_protocol.stream.replies import (
    CommandRecord,
    FrameHeader,
    Reply,
    SetupReply,
    StateReply,
)
from catoptra_protocol.usarsim.grammar import parse_message

_MAX_TOPICS = 4096
_MAX_ATTACHED_BYTES = 2**26
# Image, labels and views of one frame.
_MAX_FRAME_BYTES = 2**28
_MAX_COMMANDS, _MAX_SOURCES = 2**16, 2**10
# As of stamps; NaN and infinity are no JSON here.
_MAX_TIME_S = 2.0**31
# What simulates or shows a recording goes through all of its time.
_MAX_GAP_S = 86_400.0
_NS_PER_S = 1e9
FRAME_TOPIC, STATE_TOPIC = "/catoptra/frame", "/catoptra/state"
COMMAND_TOPIC = "/catoptra/commands"
_ReplyT = TypeVar("_ReplyT", bound=Reply)


@dataclass(slots=True)
class RecordedTopic:
    """What a file holds of a topic."""

    type_name: str
    """`package/Name`."""
    first_s: float
    """Simulation time of its first message."""
    last_s: float
    count: int = 0

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0 of a single one."""
        return (
            (self.count - 1) / (self.last_s - self.first_s) if self.last_s > self.first_s else 0.0
        )


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrame:
    """A frame as the stream delivered it."""

    header: FrameHeader
    parts: tuple[bytes, ...]
    """The image, and the channels that were recorded, in the order of the header's labels."""
    publish_ns: int
    """Time of day."""

    @property
    def time_s(self) -> float:
        """Simulation time of the exposure."""
        return self.header.time_s


@dataclass(frozen=True, slots=True, eq=False)
class RecordedState:
    """A state as the stream delivered it."""

    state: StateReply
    """With the newest reading of each sensor."""
    readings: tuple[str, ...]
    """Those of its own tick."""
    publish_ns: int

    @property
    def time_s(self) -> float:
        """Simulation time."""
        return self.state.time_s


@dataclass(slots=True, eq=False)
class Recording:
    """A file, which has been read once: it is whole, and of these contents."""

    path: Path
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    tables: dict[str, dict[str, str]] = field(default_factory=dict)
    """Metadata by name."""
    files: dict[str, bytes] = field(default_factory=dict)
    """Attachments by name."""

    def __post_init__(self) -> None:
        """Read the file.

        Raises:
            CatoptraError: As of `read_records`; or it has too many topics or files.
        """
        num_bytes = 0
        for entry in read_entries(self.path):
            match entry:
                case RecordedMessage(topic, type_name, _, log_ns):
                    time_s = log_ns / _NS_PER_S
                    if topic not in self.topics:
                        self.topics[topic] = RecordedTopic(type_name, time_s, time_s)
                    found = self.topics[topic]
                    found.count, found.last_s = found.count + 1, max(found.last_s, time_s)
                case RecordedFile(name, data):
                    self.files[name] = data
                    num_bytes += len(data)
                case RecordedTable(name, values):
                    self.tables[name] = values
            if len(self.topics) > _MAX_TOPICS or num_bytes > _MAX_ATTACHED_BYTES:
                raise self.error("more topics or attachments than a recording of Catoptra has")

    @property
    def robot(self) -> str:
        """Name of the recorded robot."""
        return self.tables.get("catoptra", {}).get("robot", "")

    @property
    def is_realtime(self) -> bool:
        """Whether the server's clock was real time."""
        return self.tables.get("catoptra", {}).get("clock") == "realtime"

    @property
    def span_s(self) -> tuple[float, float]:
        """Simulation times of the first and the last message that are no latched ones."""
        spans = [one for name, one in self.topics.items() if name in (STATE_TOPIC, FRAME_TOPIC)]
        if not spans:
            raise self.error("no states and no frames: it is of an earlier release, or empty")
        return min(one.first_s for one in spans), max(one.last_s for one in spans)

    @property
    def setup(self) -> SetupReply:
        """Files and options of the server."""
        digests = self.tables.get("catoptra_digests", {})
        files = {
            name: data.decode(errors="replace")
            for name, data in self.files.items()
            if name in digests
        }
        return SetupReply(0, files, digests, self.tables.get("catoptra_setup", {}))

    def error(self, reason: str) -> CatoptraError:
        """Error about the file."""
        return CatoptraError(f"{self.path}: {reason}")

    def get_reply(self, reply_type: type[_ReplyT]) -> _ReplyT:
        """A reply that never changes.

        Raises:
            CatoptraError: The recording does not have it.
        """
        text = self.tables.get("catoptra_replies", {}).get(reply_type.KIND, "")
        return self._parse(text, reply_type)

    def iter_commands(self) -> Iterator[CommandRecord]:
        """Commands to the robot, from INIT on, in their order.

        Raises:
            CatoptraError: A message is damaged.
        """
        for entry in read_entries(self.path):
            if isinstance(entry, RecordedMessage) and entry.topic == COMMAND_TOPIC:
                yield self._parse_command(entry)

    def iter_events(self) -> Iterator[RecordedFrame | RecordedState]:
        """Frames and states in their order; each state has the commands since the one before.

        Raises:
            CatoptraError: A message is damaged, or a frame has no image.
        """
        # Newest message of each topic of images; the frame's own message follows them.
        images: dict[str, RecordedMessage] = {}
        # Those of states that were not recorded, since their robots had not moved, are here too.
        commands: list[CommandRecord] = []
        newest: dict[str, str] = {}
        time_s: float | None = None
        for entry in read_entries(self.path):
            if not isinstance(entry, RecordedMessage):
                continue
            if entry.topic == FRAME_TOPIC:
                header = self._parse(self._read_text(entry), FrameHeader)
                time_s = self._check_time(header.time_s, time_s)
                yield RecordedFrame(header, self._find_parts(header, images), entry.publish_ns)
            elif entry.topic == STATE_TOPIC:
                state = self._parse(self._read_text(entry), StateReply)
                time_s = self._check_time(state.time_s, time_s)
                newest |= {source_of_message(parse_message(one)): one for one in state.reports}
                if len(newest) > _MAX_SOURCES:
                    raise self.error(f"readings of more than {_MAX_SOURCES} sensors")
                due = tuple(one for one in commands if one.time_s <= state.time_s)
                commands = [one for one in commands if one.time_s > state.time_s]
                whole = replace(state, reports=tuple(newest.values()), commands=due)
                yield RecordedState(whole, state.reports, entry.publish_ns)
            elif entry.topic == COMMAND_TOPIC:
                commands.append(self._parse_command(entry))
                if len(commands) > _MAX_COMMANDS:
                    raise self.error(f"more than {_MAX_COMMANDS} commands at once")
            elif entry.type_name.startswith("sensor_msgs/") and "Image" in entry.type_name:
                images[entry.topic] = entry
                if sum(len(one.data) for one in images.values()) > _MAX_FRAME_BYTES:
                    raise self.error(f"the images of a frame are beyond {_MAX_FRAME_BYTES} bytes")

    def describe(self) -> str:
        """Robot, world, duration, topics with their rates, dropped messages, files; for people."""
        facts, dropped = self.tables.get("catoptra", {}), self.tables.get("catoptra_dropped", {})
        first_s, last_s = self.span_s
        lines = [
            f"{self.path}: robot {facts.get('robot', '?')}, world {facts.get('world', '?')}, "
            f"{facts.get('server', '?')}, clock {facts.get('clock', '?')}",
            f"{last_s - first_s:.1f} s from {first_s:.2f} s on, "
            f"{sum(one.count for one in self.topics.values())} messages",
        ]
        for name, one in sorted(self.topics.items()):
            rate = f", {one.rate_hz:.1f} a second" if one.rate_hz else ""
            lines.append(f"  {name}  {one.type_name}: {one.count}{rate}")
        lost = [f"{count} {kind}" for kind, count in dropped.items() if count != "0"]
        lines.append(f"dropped: {', '.join(lost) or 'none'}")
        lines.append(f"files: {', '.join(sorted(self.files)) or 'none'}")
        # Names are of others: no line may end a line, or act on a terminal.
        return "\n".join("".join(c if c.isprintable() else "?" for c in one) for one in lines)

    def _find_parts(
        self, header: FrameHeader, images: dict[str, RecordedMessage]
    ) -> tuple[bytes, ...]:
        parts = [self._read_image(images, f"/{header.camera}/image/compressed")]
        for channel in header.labels.channels if header.labels else ():
            data = self._read_image(images, f"/{header.camera}/{channel.name}")
            if channel.name == "range":
                ranges = np.frombuffer(data, "<f4", count=len(data) // 4)
                # As the stream has it: no surface is infinitely far.
                data = np.where(ranges == 0.0, np.float32(np.inf), ranges).tobytes()
            parts.append(data)
        return tuple(parts)

    def _parse_command(self, message: RecordedMessage) -> CommandRecord:
        try:
            fields = json_object_from_text(self._read_text(message), MAX_REQUEST_BYTES)
            command = dataclass_from_fields(CommandRecord, fields)
        except RemoteProtocolError as error:
            raise self.error(f"a damaged command: {error}") from error
        self._check_time(command.time_s)
        return command

    def _check_time(self, time_s: float, before_s: float | None = None) -> float:
        """The time of a message, which is one of a stamp, and follows soon."""
        is_near = before_s is None or abs(time_s - before_s) < _MAX_GAP_S
        if not 0.0 <= time_s < _MAX_TIME_S or not is_near:
            raise self.error(f"a time of {time_s} s behind one of {before_s or 0.0} s")
        return time_s

    def _read_image(self, images: dict[str, RecordedMessage], topic: str) -> bytes:
        if topic not in images:
            raise self.error(f"a frame without its image on {topic[:60]!r}")
        return bytes(decode_message(images[topic]).data)

    def _read_text(self, message: RecordedMessage) -> str:
        return str(getattr(decode_message(message), "data", ""))

    def _parse(self, text: str, reply_type: type[_ReplyT]) -> _ReplyT:
        try:
            reply = reply_from_json(text) if text else None
        except RemoteProtocolError as error:
            raise self.error(f"a damaged message: {error}") from error
        if not isinstance(reply, reply_type):
            raise self.error(f"it has no {reply_type.KIND} where one belongs")
        return reply
