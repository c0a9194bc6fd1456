"""Recordings as readers that share no code with us find them: rosbags, mcap, cv2 and NumPy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap_ros2._dynamic import serialize_dynamic

from catoptra_client.recording.mcap_file import (
    MAGIC,
    RecordingWriter,
    read_records,
    repair_recording,
)
from catoptra_client.recording.recorder import Recorder, RecordingPlan
from catoptra_client.recording.ros2_messages import encode_cdr, read_definitions, schema_text
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.requests import ImageEncoding
from helpers.bags import matrix_of, read_bag
from helpers.configs import OMNI_ROBOT, ROBOTS, Edit, write_edited_copy
from helpers.server_process import start_server


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded drive of three seconds."""
    folder = tmp_path_factory.mktemp("recording")
    path = folder / "bag" / "drive.mcap"
    path.parent.mkdir()
    # Small pictures, of which a loaded machine draws enough.
    sizes = (Edit(f"Resolution{side}=360", f"Resolution{side}=120") for side in "XY")
    write_edited_copy(OMNI_ROBOT, folder, *sizes)
    robot = write_edited_copy(ROBOTS / "p2at_omni_full.ini", folder)
    with start_server(folder, robot=robot) as server, server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", start_pose=client.get_start_poses()[0].name)
        client.drive(1.0, 2.0)
        plan = RecordingPlan(channels=("range", "ids"), encoding=ImageEncoding.PNG, hz=10.0)
        progress = Recorder(path, plan, stream_port=server.stream_port).record(3.0)
    assert progress.num_dropped == 0
    return path


def test_both_readers_find_every_message_with_stamps_that_never_go_back(recording: Path) -> None:
    topics = read_bag(recording.parent)
    with recording.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert sum(map(len, topics.values())) == summary.statistics.message_count
    assert len(topics["/ground_truth"]) > 20
    for topic, messages in topics.items():
        stamps = [stamp for stamp, _ in messages]
        assert stamps == sorted(stamps), topic


def test_transforms_are_a_tree_from_map_to_the_camera(recording: Path) -> None:
    topics = read_bag(recording)
    edges = {
        (transform.child_frame_id, transform.header.frame_id)
        for topic in ("/tf", "/tf_static")
        for _, message in topics[topic]
        for transform in message.transforms
    }
    parents = dict(edges)
    assert len(parents) == len(edges)
    (camera,) = (child for child in parents if child.endswith("_optical_frame"))
    assert (parents.pop("base_link"), parents.pop("odom")) == ("odom", "map")
    # Who comes late is given the newest one alone.
    newest = topics["/tf_static"][-1][1].transforms
    assert {transform.child_frame_id for transform in newest} == set(parents)
    assert {camera, "Scanner1", "F1", "INS"} <= set(parents)
    assert set(parents.values()) == {"base_link"}
    # Sonar F1 looks to the left, where y is positive in REP 103.
    (sonar,) = (one.transform for one in newest if one.child_frame_id == "F1")
    assert sonar.translation.y > 0.1 < sonar.rotation.z


def test_drift_is_between_map_and_odom_and_the_sum_is_the_true_pose(recording: Path) -> None:
    topics = read_bag(recording)
    headers = {stamp: json.loads(message.data) for stamp, message in topics["/catoptra/frame"]}
    odometry = [(stamp, one.pose.pose.position) for stamp, one in topics["/odom"]]
    stamps = np.array([stamp for stamp, _ in odometry])
    assert len(topics["/tf"]) > 5
    drifts = set()
    for stamp, message in topics["/tf"]:
        links = {one.child_frame_id: matrix_of(one.transform) for one in message.transforms}
        place = (links["odom"] @ links["base_link"])[:3, 3]
        drifts.add(tuple(links["odom"][:2, 3]))
        x, y, z = headers[stamp]["world_from_robot"]["position_m"]
        assert np.allclose(place, (x, -y, -z), atol=1e-12)
        # A reading is at most a fifth of a second away, in which it moves by 4 cm.
        near = odometry[int(np.argmin(np.abs(stamps - stamp)))][1]
        assert np.hypot(*(links["base_link"][:2, 3] - (near.x, near.y))) < 0.045
    assert len(drifts) > 3


def test_ranges_without_echo_are_infinite_and_limits_those_of_the_sensor(recording: Path) -> None:
    topics = read_bag(recording)
    scan, sonar = topics["/scan/Scanner1"][0][1], topics["/range/F1"][0][1]
    assert (scan.range_min, scan.range_max, sonar.max_range) == pytest.approx((0.1, 20.0, 5.0))
    ranges_m = np.concatenate([one.ranges for _, one in topics["/scan/Scanner1"]])
    assert ranges_m[np.isfinite(ranges_m)].max() < 20.0


def test_commands_are_recorded_as_lines_and_as_a_speed(recording: Path) -> None:
    topics = read_bag(recording)
    lines = [json.loads(message.data)["line"] for _, message in topics["/catoptra/commands"]]
    assert [line.split()[0] for line in lines] == ["INIT", "DRIVE"]
    ((_, twist),) = topics["/cmd_vel"]
    # Wheels of 0.13 m at 1 and 2 rad/s; the faster right ones turn it to the left.
    assert twist.linear.x == pytest.approx(1.5 * 0.13, rel=0.05)
    assert twist.angular.z > 0.2


def test_mirror_has_no_false_camera_info_and_its_ranges_are_metres(recording: Path) -> None:
    topics = read_bag(recording)
    (info, *_) = (messages for topic, messages in topics.items() if "camera_info" in topic)
    assert not info[0][1].k.any()
    (images,) = (messages for topic, messages in topics.items() if topic.endswith("/range"))
    image = images[0][1]
    ranges_m = image.data.view("<f4").reshape(image.height, image.width)
    assert image.encoding == "32FC1"
    assert np.isfinite(ranges_m).all()
    assert 0.1 < ranges_m[ranges_m > 0.0].min() < 5.0
    (calibration,) = (messages for topic, messages in topics.items() if "calibration" in topic)
    assert json.loads(calibration[0][1].data)["picture"] == "flipped"


def test_file_of_a_killed_writer_is_read_after_repair(recording: Path, tmp_path: Path) -> None:
    whole = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    for share in (0.3, 0.7, 0.95):
        cut.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(CatoptraError, match="--repair"):
            list(read_records(cut))
        count, _ = repair_recording(cut)
        assert sum(map(len, read_bag(tmp_path).values())) == count > 0
        assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.mcap", "metadata.yaml"]


def test_repair_leaves_out_a_damaged_chunk_alone(recording: Path, tmp_path: Path) -> None:
    data, path = bytearray(recording.read_bytes()), tmp_path / "damaged.mcap"
    place, chunks = len(MAGIC), []
    while data[place] != 0x0F:
        length = int.from_bytes(data[place + 1 : place + 9], "little")
        if data[place] == 0x06:
            chunks.append(place)
        place += 9 + length
    assert len(chunks) > 2
    # The checksum of a late one: topics that it does not declare go on.
    data[chunks[-2] + 9 + 24] ^= 1
    path.write_bytes(data)
    with pytest.raises(CatoptraError, match="checksum"):
        list(read_records(path))
    count, damages = repair_recording(path)
    assert list(damages.values()) == [1]
    assert 0 < count == sum(map(len, read_bag(path).values()))


def record(opcode: int, body: bytes) -> bytes:
    return bytes([opcode]) + len(body).to_bytes(8, "little") + body


def text(value: str) -> bytes:
    return len(value).to_bytes(4, "little") + value.encode()


CHUNK_OF_10_GB = bytes(16) + (10**10).to_bytes(8, "little") + bytes(4) + text("zstd") + bytes(8)
BOMB = bytes(16) + (1000).to_bytes(8, "little") + bytes(4) + text("zstd")
PACKED = zstandard.compress(bytes(2**28))
HOSTILE = {
    "does not unpack to the 1000 bytes": MAGIC
    + record(6, BOMB + len(PACKED).to_bytes(8, "little") + PACKED),
    "no MCAP file": b"PK\x03\x04" + bytes(99),
    "ends within a record": MAGIC + b"\x06" + (2**62).to_bytes(8, "little"),
    "unpacks to 10000000000 bytes": MAGIC + record(6, CHUNK_OF_10_GB),
    "none of Catoptra's": MAGIC
    + record(3, b"\1\0" + text("evil_msgs/msg/Evil") + text("ros2msg") + text("")),
    "names a path": MAGIC + record(9, bytes(16) + text("../../x") + text("") + bytes(8) + bytes(4)),
    "damaged record": MAGIC + record(3, b"\1\0" + b"\xff\xff\0\0ab"),
    "has no topic": MAGIC + record(5, bytes(22)),
}


@pytest.mark.parametrize("reason", HOSTILE)
def test_hostile_file_is_rejected_with_its_reason(reason: str, tmp_path: Path) -> None:
    path = tmp_path / "hostile.mcap"
    path.write_bytes(HOSTILE[reason])
    with pytest.raises(CatoptraError, match=reason):
        list(read_records(path))
    before = path.read_bytes()
    if reason != "ends within a record":
        with pytest.raises(CatoptraError, match=reason):
            repair_recording(path)
        assert path.read_bytes() == before


@pytest.mark.parametrize("type_name", sorted(read_definitions()))
def test_encoded_message_is_that_of_another_encoder(type_name: str) -> None:
    message, name = make_message(type_name), type_name.replace("/", "/msg/")
    expected = serialize_dynamic(name, schema_text(type_name))[name](message)
    assert encode_cdr(type_name, message) == expected


def make_message(type_name: str) -> dict[str, Any]:
    """A message of a type; its arrays have three values, then none."""
    message: dict[str, Any] = {}
    for line in read_definitions()[type_name].splitlines():
        kind, *names = line.split()[:2] or [""]
        if not names or "=" in line:
            continue
        kind, _, size = kind.partition("[")
        if kind in read_definitions():
            value: Any = make_message(kind)
        else:
            value = {"string": "abcd", "bool": True}.get(kind, len(message) + 1)
        count = int(size[:-1] or 3 * (len(message) % 2)) if size else 0
        message[names[0]] = [value] * count if size else value
    return message


def test_second_file_of_a_folder_leaves_the_metadata_of_the_first(tmp_path: Path) -> None:
    for name in ("first.mcap", "second.mcap"):
        with RecordingWriter(tmp_path / name) as writer:
            writer.add_metadata("catoptra", {"robot": name})
    assert '"first.mcap"' in (tmp_path / "metadata.yaml").read_text()
