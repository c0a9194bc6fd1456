"""MCAP files: written so that a killed writer leaves what it had, read without trust, repaired.

A chunk is flushed at least every half second, so that a killed writer loses no more. A full disk
ends the recording, not the file: room for the last chunk and the index is set aside at the start.

Format: https://mcap.dev/spec. The readers of the package `mcap` unpack a chunk of any size; those
here bound what a length in a file can demand.
"""

from __future__ import annotations

import errno
import json
import os
import struct
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

from catoptra_client.recording.ros2_messages import RosMessage, encode_cdr, schema_text
from catoptra_protocol.errors import CatoptraError, RemoteProtocolError

try:
    import lz4.frame
    import zstandard
    from mcap import records
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.opcode import Opcode
    from mcap.writer import Writer

    # The public writer hides channels and flushing.
    from mcap_ros2._dynamic import generate_dynamic
except ImportError as error:
    raise CatoptraError(
        "recordings need two more packages: pip install 'catoptra-client[record]'"
    ) from error

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES = 2**26
"""Longest chunk that is read, packed or unpacked; those written are of 1 MiB and one message."""
_MAX_RECORD_BYTES = 2**28
_RESERVE_BYTES = 2**23
_FLUSH_INTERVAL_S = 0.5
_RECORDS = {
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.ATTACHMENT: records.Attachment,
    Opcode.METADATA: records.Metadata,
}
# Wrong bytes inside a record show up in each of these ways.
_DAMAGES = (McapError, ValueError, struct.error, RuntimeError, zstandard.ZstdError)
_MAX_DAMAGES = 16
# Hashes of the types' descriptions in ROS 2 Humble and later (REP 2011), for metadata.yaml.
_TYPE_HASHES = {
    "geometry_msgs/Twist": "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "nav_msgs/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "rosgraph_msgs/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "sensor_msgs/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "sensor_msgs/CompressedImage": (
        "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
    ),
    "sensor_msgs/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/Imu": "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/LaserScan": "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "sensor_msgs/Range": "b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    "std_msgs/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "tf2_msgs/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "visualization_msgs/MarkerArray": (
        "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"
    ),
}
# Quality of service of a topic whose last message late subscribers get: reliable, transient local.
_FOREVER = "{sec: 2147483647, nsec: 4294967295}"
_LATCHED = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, liveliness: 1, "
    f"deadline: {_FOREVER}, lifespan: {_FOREVER}, liveliness_lease_duration: {_FOREVER}, "
    "avoid_ros_namespace_conventions: false}"
)


class RecordingWriter:
    """An MCAP file of ROS 2 messages that is open for writing; also a context manager.

    `is_full` turns true when the disk is full: nothing more is written then, and `close` writes
    the index of what is there.
    """

    def __init__(
        self,
        path: Path,
        *,
        name: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create a file.

        Args:
            path: The file.
            name: Its name in metadata.yaml, when it gets another one.
            clock: Source of the time in seconds.

        Raises:
            CatoptraError: The file exists, or cannot be written.
        """
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            raise CatoptraError(
                f"{path}: {error.strerror}; name a file that is not there"
            ) from error
        self._path, self._name, self._clock = path, name or path.name, clock
        self._reserve: IO[bytes] | None = None
        self._writer = Writer(self, chunk_size=2**20)
        self._schemas: dict[str, int] = {}
        # Of each topic: its channel, type, number of messages, and whether it is latched.
        self._topics: dict[str, tuple[int, str, bool]] = {}
        self._counts: dict[str, int] = {}
        self._first_ns, self._last_ns = 2**63, 0
        self._flushed_s = clock()
        self.is_full = False
        # Without a name, so that it goes with a killed writer.
        self._reserve = tempfile.TemporaryFile(dir=path.parent)
        self._reserve.write(bytes(_RESERVE_BYTES))
        self._reserve.flush()
        self._writer.start("ros2", "catoptra")

    @property
    def num_messages(self) -> int:
        """Messages written."""
        return sum(self._counts.values())

    def write(self, data: bytes) -> int:
        """Write bytes for the writer of the records; a full disk takes the reserve."""
        view = memoryview(data)
        while view:
            try:
                written = self._file.write(view)
            except OSError as error:
                if error.errno not in (errno.ENOSPC, errno.EDQUOT) or self._reserve is None:
                    raise CatoptraError(f"{self._path}: {error.strerror}") from error
                self._reserve.close()
                self._reserve, self.is_full = None, True
                continue
            view = view[written:]
        return len(data)

    def flush(self) -> None:
        """Nothing: `write` keeps no bytes."""

    def tell(self) -> int:
        """Bytes written."""
        return self._file.tell()

    def add_message(
        self,
        topic: str,
        type_name: str,
        message: RosMessage,
        *,
        log_ns: int,
        publish_ns: int,
        is_latched: bool = False,
    ) -> None:
        """Write a message.

        Args:
            topic: Topic; its type is that of its first message.
            type_name: `package/Name`.
            message: Fields by name.
            log_ns: Simulation time.
            publish_ns: Time of day.
            is_latched: Whether late subscribers get the last message.
        """
        data = encode_cdr(type_name, message)
        self.add_cdr(
            topic, type_name, data, log_ns=log_ns, publish_ns=publish_ns, is_latched=is_latched
        )

    def add_cdr(
        self,
        topic: str,
        type_name: str,
        data: bytes,
        *,
        log_ns: int,
        publish_ns: int,
        is_latched: bool = False,
    ) -> None:
        """Write a message that is CDR already; the rest as in `add_message`."""
        if topic not in self._topics:
            if type_name not in self._schemas:
                name, text = type_name.replace("/", "/msg/"), schema_text(type_name)
                schema = self._writer.register_schema(name, "ros2msg", text.encode())
                self._schemas[type_name] = schema
            metadata = {"offered_qos_profiles": _LATCHED if is_latched else ""}
            schema = self._schemas[type_name]
            channel = self._writer.register_channel(topic, "cdr", schema, metadata)
            self._topics[topic], self._counts[topic] = (channel, type_name, is_latched), 0
        channel = self._topics[topic][0]
        self._writer.add_message(channel, log_ns, data, publish_ns, self._counts[topic])
        self._counts[topic] += 1
        self._first_ns, self._last_ns = min(self._first_ns, log_ns), max(self._last_ns, log_ns)
        # A chunk that declares a topic ends with its first message: damage to a later one does not
        # cost the topic.
        is_due = self._clock() - self._flushed_s >= _FLUSH_INTERVAL_S
        if self._counts[topic] == 1 or is_due:
            self._writer.flush()
            self._flushed_s = self._clock()

    def add_attachment(self, name: str, data: bytes) -> None:
        """Attach a file under a name without folders."""
        now_ns = time.time_ns()
        self._writer.add_attachment(now_ns, now_ns, Path(name).name, "text/plain", data)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a table of texts."""
        self._writer.add_metadata(name, values)

    def close(self) -> None:
        """Write the index, and metadata.yaml beside the file, unless there is that of another."""
        if self._file.closed:
            return
        try:
            self._writer.finish()
        finally:
            self._file.close()
            if self._reserve is not None:
                self._reserve.close()
        metadata = self._path.with_name("metadata.yaml")
        # JSON, as it is written here.
        if metadata.exists() and json.dumps(self._name) not in metadata.read_text(errors="replace"):
            return
        metadata.write_text(self._describe_bag() + "\n", encoding="utf-8")

    def discard(self) -> None:
        """Remove the file instead."""
        self._file.close()
        if self._reserve is not None:
            self._reserve.close()
        self._path.unlink()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _describe_bag(self) -> str:
        """Text of metadata.yaml, version 9; JSON is YAML."""
        first_ns = min(self._first_ns, self._last_ns)
        span = {
            "starting_time": {"nanoseconds_since_epoch": first_ns},
            "duration": {"nanoseconds": self._last_ns - first_ns},
            "message_count": self.num_messages,
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": type_name.replace("/", "/msg/"),
                    "serialization_format": "cdr",
                    "offered_qos_profiles": _LATCHED if is_latched else "",
                    "type_description_hash": f"RIHS01_{_TYPE_HASHES[type_name]}",
                },
                "message_count": self._counts[topic],
            }
            for topic, (_, type_name, is_latched) in self._topics.items()
        ]
        information = {
            "version": 9,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._name],
            "files": [{"path": self._name, **span}],
            "custom_data": None,
            "ros_distro": "humble",
        }
        return json.dumps({"rosbag2_bagfile_information": information}, indent=1)


def read_records(
    path: Path, *, on_damage: Callable[[CatoptraError], None] | None = None
) -> Iterator[Any]:
    """Schemas, channels, messages, attachments and metadata of a file, checked, in its order.

    Args:
        path: MCAP file.
        on_damage: Receives what is wrong with a chunk or a message that is left out then, and where
            the file ends too early; None: the first damage is an error.

    Raises:
        CatoptraError: No such file, or no recording: cut, of another format or type, or with
            lengths beyond the file or the limits.
    """
    checker = _RecordChecker(path, on_damage)
    try:
        opened = path.open("rb")
    except OSError as error:
        raise CatoptraError(f"{path}: {error.strerror}") from error
    with opened as file:
        end = file.seek(0, os.SEEK_END)
        file.seek(0)
        if file.read(len(MAGIC)) != MAGIC:
            raise CatoptraError(f"{path} is no MCAP file: its first bytes are others")
        while file.tell() < end:
            head = file.read(9)
            opcode, length = (
                (head[0], int.from_bytes(head[1:], "little")) if len(head) == 9 else (0, end)
            )
            if file.tell() + length > end:
                checker.report_damage(
                    f"{path} ends within a record: catoptra-client record --repair {path}"
                )
                return
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            limit = MAX_CHUNK_BYTES if opcode == Opcode.CHUNK else _MAX_RECORD_BYTES
            if length > limit:
                raise CatoptraError(f"{path}: a record of {length} bytes; the limit is {limit}")
            yield from checker.parse(opcode, file.read(length))
        checker.report_damage(f"{path} has no end: catoptra-client record --repair {path}")


class RecordedMessage(NamedTuple):
    """A message as a file has it."""

    topic: str
    type_name: str
    """`package/Name`."""
    data: bytes
    """CDR."""
    log_ns: int
    """Simulation time."""
    publish_ns: int
    """Time of day."""
    is_latched: bool


class RecordedFile(NamedTuple):
    """An attachment."""

    name: str
    """Without folders."""
    data: bytes


class RecordedTable(NamedTuple):
    """Metadata of a name."""

    name: str
    values: dict[str, str]


def read_entries(
    path: Path, *, on_damage: Callable[[CatoptraError], None] | None = None
) -> Iterator[RecordedMessage | RecordedFile | RecordedTable]:
    """Messages, attachments and metadata of a file; arguments and errors of `read_records`."""
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str, bool]] = {}
    for record in read_records(path, on_damage=on_damage):
        match record:
            case records.Schema():
                schemas[record.id] = record.name.replace("/msg/", "/")
            case records.Channel():
                is_latched = record.metadata.get("offered_qos_profiles") == _LATCHED
                channels[record.id] = record.topic, schemas[record.schema_id], is_latched
            case records.Message():
                topic, type_name, is_latched = channels[record.channel_id]
                times = record.log_time, record.publish_time
                yield RecordedMessage(topic, type_name, record.data, *times, is_latched)
            case records.Attachment():
                yield RecordedFile(record.name, record.data)
            case records.Metadata():
                yield RecordedTable(record.name, record.metadata)


@cache
def _find_decoder(type_name: str) -> Callable[[bytes], Any]:
    name = type_name.replace("/", "/msg/")
    decoder: Callable[[bytes], Any] = generate_dynamic(name, schema_text(type_name))[name]
    return decoder


def decode_message(message: RecordedMessage) -> Any:
    """Fields of a message as attributes.

    Raises:
        RemoteProtocolError: The message is damaged.
    """
    try:
        return _find_decoder(message.type_name)(message.data)
    except (ValueError, struct.error, IndexError, EOFError) as error:
        raise RemoteProtocolError(
            f"a damaged message of {message.topic[:60]!r}: {error}"
        ) from error


def repair_recording(path: Path) -> tuple[int, Counter[str]]:
    """Give the file of a killed writer its index, without damaged chunks and topics they declare.

    The file stays as it is until its successor is complete.

    Returns:
        The number of messages that it has then, and how often what was damaged.

    Raises:
        CatoptraError: No recording, no message in it is whole, or there is no room beside it.
    """
    damages: Counter[str] = Counter()

    def count_damage(error: CatoptraError) -> None:
        text = str(error)
        damages[text if text in damages or len(damages) < _MAX_DAMAGES else "more damage"] += 1

    repaired = path.with_name(f"{path.name}.repaired")
    writer = RecordingWriter(repaired, name=path.name)
    try:
        for entry in read_entries(path, on_damage=count_damage):
            match entry:
                case RecordedMessage(topic, type_name, data, log_ns, publish_ns, is_latched):
                    times = {"log_ns": log_ns, "publish_ns": publish_ns}
                    writer.add_cdr(topic, type_name, data, **times, is_latched=is_latched)
                case RecordedFile(name, data):
                    writer.add_attachment(name, data)
                case RecordedTable(name, values):
                    writer.add_metadata(name, values)
        if damages and not writer.num_messages:
            raise CatoptraError(next(iter(damages)))
        if writer.is_full:
            raise CatoptraError(f"{path}: the disk is full; the file is as it was")
    except BaseException:
        writer.discard()
        raise
    writer.close()
    repaired.replace(path)
    return writer.num_messages, damages


class _RecordChecker:
    """What a file has declared so far, by which its next records are judged."""

    def __init__(self, path: Path, on_damage: Callable[[CatoptraError], None] | None) -> None:
        self._path, self._on_damage = path, on_damage
        self._schemas: set[int] = set()
        self._channels: set[int] = set()

    def report_damage(self, reason: str) -> None:
        """Report what a killed writer or a faulty disk leaves; an error unless it is repaired."""
        if self._on_damage is None:
            raise CatoptraError(reason)
        self._on_damage(CatoptraError(reason))

    def parse(self, opcode: int, body: bytes) -> Iterator[Any]:
        """Records of one record's body: itself, those of a chunk, or none of an unknown kind."""
        if opcode != Opcode.CHUNK:
            yield from self._parse_plain(opcode, body)
            return
        try:
            chunk = records.Chunk.read(ReadDataStream(BytesIO(body)))
            data = self._unpack(chunk)
            if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
                raise ValueError("the checksum of a chunk is another one")
            inner = list(_split(data))
        except _DAMAGES as error:
            self.report_damage(f"{self._path}: a damaged chunk: {error}")
            return
        for inner_opcode, inner_body in inner:
            yield from self._parse_plain(inner_opcode, inner_body)

    def _unpack(self, chunk: Any) -> bytes:
        size = chunk.uncompressed_size
        if size > MAX_CHUNK_BYTES:
            raise self._error(f"a chunk unpacks to {size} bytes; the limit is {MAX_CHUNK_BYTES}")
        match chunk.compression:
            case "":
                data: bytes = chunk.data
            case "zstd":
                decompressor = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES)
                data = decompressor.stream_reader(chunk.data).read(size + 1)
            case "lz4":
                data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
            case other:
                raise self._error(f"a chunk is packed by {other[:20]!r}, which is unknown here")
        if len(data) != size:
            raise ValueError(f"a chunk does not unpack to the {size} bytes that it states")
        return data

    def _parse_plain(self, opcode: int, body: bytes) -> Iterator[Any]:
        """Record of a body that is no chunk; none of an unknown kind."""
        stream = ReadDataStream(BytesIO(body))
        try:
            if opcode == Opcode.CHUNK:
                raise self._error("a chunk is in a chunk")
            if opcode == Opcode.MESSAGE:
                record: Any = records.Message.read(stream, len(body))
            elif opcode in _RECORDS:
                record = _RECORDS[Opcode(opcode)].read(stream)
            else:
                return
        except _DAMAGES as error:
            raise self._error(f"a damaged record: {error}") from error
        reason = self._find_gap(record)
        if reason:
            self.report_damage(f"{self._path}: {reason}")
        else:
            yield record

    def _find_gap(self, record: Any) -> str:
        """What a record refers to and the file does not have: a damaged chunk may have had it."""
        match record:
            case records.Schema():
                name = record.name.replace("/msg/", "/")
                if name not in _TYPE_HASHES or record.data != schema_text(name).encode():
                    raise self._error(f"its type {record.name[:60]!r} is none of Catoptra's")
                self._schemas.add(record.id)
            case records.Channel() if record.schema_id not in self._schemas:
                return f"topic {record.topic[:60]!r} has no type"
            case records.Channel():
                self._channels.add(record.id)
            case records.Message() if record.channel_id not in self._channels:
                return "a message has no topic"
            case records.Attachment():
                if Path(record.name).name != record.name or "\\" in record.name:
                    raise self._error(f"an attachment names a path: {record.name[:60]!r}")
        return ""

    def _error(self, reason: str) -> CatoptraError:
        return CatoptraError(f"{self._path}: {reason}")


def _split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcodes and bodies of the records of a chunk."""
    place = 0
    while place < len(data):
        body = place + 9
        end = body + int.from_bytes(data[place + 1 : body], "little")
        if end > len(data):
            raise ValueError("a record in a chunk is longer than the chunk")
        yield data[place], data[body:end]
        place = end
