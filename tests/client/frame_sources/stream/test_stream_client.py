"""Requests, frames, labels and landmarks of the stream, by scripted and real servers."""

from __future__ import annotations

import dataclasses
import itertools
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np
import pytest

from catoptra_client.frame import Frame, LabelledPixels
from catoptra_client.frame_sources.stream import zmq_socket
from catoptra_client.frame_sources.stream.stream_client import LandmarkProjection, StreamClient
from catoptra_protocol.camera_conf import pairs_from_omni_camera, pairs_from_perspective_camera
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    DeadlineExceededError,
    LocalProtocolError,
    RemoteProtocolError,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.mirrors import MIRRORS
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    FrameHeader,
    LandmarksReply,
    Ok,
    Reply,
    SensorReports,
    StartPosesReply,
    StateReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    ChannelRecord,
    DriveRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetStartPosesRequest,
    GetStateRequest,
    GetStatusRequest,
    ImageEncoding,
    LabelsRecord,
    ObjectRecord,
    PublishRequest,
    Request,
    ResetRequest,
    ShareControlRequest,
    Transform,
)
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_protocol.usarsim.reports import OdometryReading, Report, line_from_report
from helpers.scripted_stream import HEARTBEAT, Script, serve_stream_script
from helpers.stream_messages import HEADER, HEADER_WITH_DIFFERENCE, LANDMARK, UPRIGHT_TRANSFORM

HOST = "127.0.0.1"
_ResultT = TypeVar("_ResultT")


def call(reply: Callable[[int], Reply], request: Callable[[StreamClient], _ResultT]) -> _ResultT:
    """Result of a call of a client whose requests have this reply, by id."""
    with (
        serve_stream_script(lambda request: [[bytes_from_message(reply(request.id))]]) as port,
        StreamClient(HOST, port) as client,
    ):
        return request(client)


def step_with_replies(*replies: Callable[[int], Reply]) -> list[Report]:
    """Result of a step whose id, 2, has these replies."""

    def reply(request: Request) -> list[list[bytes]]:
        if isinstance(request, ResetRequest):
            return [[bytes_from_message(Ok(request.id))]]
        return [[bytes_from_message(one(request.id))] for one in replies]

    with serve_stream_script(reply) as port, StreamClient(HOST, port) as client:
        client.reset()
        return client.step(0.0)


def test_reply_when_it_follows_a_late_one_is_found_by_its_id() -> None:
    odometry = OdometryReading("Odometry", 1.0, 2.0, 0.5)
    line = line_from_report(odometry).decode().strip()
    replies = (lambda id_: Ok(id_ - 1)), (lambda id_: SensorReports(id_, (line,)))
    assert step_with_replies(*replies) == [odometry]


@pytest.mark.parametrize(
    ("reply", "error", "reason"),
    [
        (lambda id_: Error(id_, "no robot"), CatoptraError, "rejected the request: no robot"),
        (
            lambda _: Error(0, "no msgpack"),
            RemoteProtocolError,
            "cannot read the request: no msgpack",
        ),
        (Ok, RemoteProtocolError, "replied with ok"),
    ],
)
def test_reply_when_it_is_no_result_raises_with_the_reason(
    reply: Callable[[int], Reply], error: type[CatoptraError], reason: str
) -> None:
    with pytest.raises(error, match=reason):
        step_with_replies(reply)


CAMERA = OmniCamera(
    projection=MIRRORS["parabolic"](horizon_radius_m=0.03),
    width_px=6,
    height_px=4,
    centre_px=(3.0, 2.0),
    scale_px=1.5,
    rim_rad=1.75,
    image_up_azimuth_rad=0.0,
)
HEADER_WITH_CAMERA = dataclasses.replace(
    HEADER, camera_model=dict(pairs_from_omni_camera(CAMERA, 0.7))
)
IMAGE = np.arange(72, dtype=np.uint8).reshape(4, 6, 3)


def decode_frames(header: FrameHeader, *parts: bytes, frames: int = 1) -> list[Frame]:
    """Frames of a client, each of which arrives as this header and these parts."""

    def reply(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(dataclasses.replace(header, id=request.id)), *parts]]

    with serve_stream_script(reply) as port, StreamClient(HOST, port, clock=lambda: 3.0) as client:
        return [client.get_frame() for _ in range(frames)]


def decode_frame(header: FrameHeader, *parts: bytes) -> Frame:
    return decode_frames(header, *parts)[0]


def test_frame_when_raw_has_the_fields_of_its_header() -> None:
    frame = decode_frame(HEADER_WITH_CAMERA, IMAGE.tobytes())
    assert np.array_equal(frame.rgb, IMAGE)
    assert not frame.rgb.flags.writeable
    assert frame.camera == CAMERA
    assert frame.robot_from_mirror is not None
    assert frame.robot_from_mirror.translation.tolist() == [0.1, 0.0, -0.5]
    assert (frame.time_s, frame.age_s, frame.received_s) == (1.25, 0.03, 3.0)
    assert (frame.plan, frame.error_bound_px, frame.image_type) == ("trace", None, ImageType.RAW)
    assert [(effect.name, effect.enabled, effect.duration_ms) for effect in frame.effects] == [
        ("ShotNoise", True, 2.5)
    ]


def test_frame_when_png_is_the_same_image() -> None:
    _, data = cv2.imencode(".png", np.ascontiguousarray(IMAGE[..., ::-1]))
    frame = decode_frame(
        dataclasses.replace(HEADER_WITH_CAMERA, encoding=ImageEncoding.PNG), data.tobytes()
    )
    assert np.array_equal(frame.rgb, IMAGE)


def test_camera_when_its_pairs_stay_the_same_is_parsed_once() -> None:
    first, second = decode_frames(HEADER_WITH_CAMERA, IMAGE.tobytes(), frames=2)
    assert first.camera is second.camera
    without = dataclasses.replace(HEADER_WITH_CAMERA, camera_model=None)
    assert decode_frame(without, IMAGE.tobytes()).camera is None


BAD_MESSAGES: list[tuple[FrameHeader, tuple[bytes, ...], str]] = [
    (HEADER_WITH_CAMERA, (), "0 parts after the header"),
    (HEADER_WITH_CAMERA, (bytes(72), b""), "2 parts"),
    (HEADER_WITH_CAMERA, (bytes(71),), "71 bytes"),
    (dataclasses.replace(HEADER_WITH_CAMERA, width_px=-6, height_px=-4), (bytes(72),), "72 bytes"),
    (dataclasses.replace(HEADER_WITH_CAMERA, encoding=ImageEncoding.JPEG), (b"no file",), "JPEG"),
    (
        dataclasses.replace(HEADER_WITH_CAMERA, camera_model={"Mirror": "parabolic"}),
        (bytes(72),),
        "without",
    ),
]


@pytest.mark.parametrize(
    ("header", "parts", "expected_message"), BAD_MESSAGES, ids=lambda x: x if type(x) is str else ""
)
def test_frame_when_its_parts_disagree_is_rejected(
    header: FrameHeader, parts: tuple[bytes, ...], expected_message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=expected_message):
        decode_frame(header, *parts)


def test_image_when_of_another_size_than_its_header_is_rejected() -> None:
    _, data = cv2.imencode(".png", np.zeros((5, 6, 3), np.uint8))
    with pytest.raises(RemoteProtocolError, match=r"shape \(5, 6, 3\)"):
        decode_frame(
            dataclasses.replace(HEADER_WITH_CAMERA, encoding=ImageEncoding.PNG), data.tobytes()
        )


def test_frame_with_a_difference_has_it_apart_from_the_picture() -> None:
    header = dataclasses.replace(HEADER_WITH_CAMERA, difference=HEADER_WITH_DIFFERENCE.difference)
    frame = decode_frame(header, IMAGE.tobytes())
    assert np.array_equal(frame.rgb, IMAGE[:, :3])
    assert frame.difference_rgb is not None
    assert np.array_equal(frame.difference_rgb, IMAGE[:, 3:])
    assert frame.difference == HEADER_WITH_DIFFERENCE.difference


def test_frame_with_a_difference_of_another_width_is_refused() -> None:
    header = dataclasses.replace(HEADER_WITH_DIFFERENCE, width_px=5)
    with pytest.raises(RemoteProtocolError, match="equal widths"):
        decode_frame(header, bytes(5 * 4 * 3))


IDS = np.arange(6, dtype="<u2").reshape(2, 3)
RECORD = ChannelRecord("ids", "<u2", 1, ChannelEncoding.RAW, 12)
UPRIGHT = Transform((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))


def decode_labels(
    record: LabelsRecord, part: bytes, size_px: tuple[int, int] = (2, 3)
) -> LabelledPixels:
    """Labels of a frame of this height and width, as a client receives them."""
    height_px, width_px = size_px
    header = replace(
        HEADER, camera_model=None, height_px=height_px, width_px=width_px, labels=record
    )
    labels = decode_frame(header, bytes(18), part).labels
    assert labels is not None
    return labels


def test_channels_and_objects_are_decoded() -> None:
    crate = ObjectRecord(3, "crate", "object", 2, UPRIGHT, (0.5, 0.25, 0.125))
    packed = replace(RECORD, encoding=ChannelEncoding.ZLIB)
    for record, part in ((RECORD, IDS.tobytes()), (packed, zlib.compress(IDS.tobytes()))):
        found = decode_labels(LabelsRecord((record,), (crate,)), part)
        np.testing.assert_array_equal(found.truth.channels["ids"], IDS)
        (one,) = found.truth.objects
        np.testing.assert_allclose(one.corners().mean(axis=0), (1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("record", "part", "size", "message"),
    [
        (RECORD, IDS.tobytes()[:-1], (2, 3), "11 bytes, expected 12"),
        (replace(RECORD, dtype="<f4"), IDS.tobytes(), (2, 3), "no such channel"),
        (replace(RECORD, name="smell"), IDS.tobytes(), (2, 3), "no such channel"),
        (RECORD, b"", (-2, -3), "-3 x -2 px"),
        (RECORD, b"", (2**20, 2**20), "1048576 x 1048576 px"),
        (replace(RECORD, encoding=ChannelEncoding.ZLIB), b"no zlib", (2, 3), "header"),
    ],
)
def test_parts_that_do_not_match_are_errors(
    record: ChannelRecord, part: bytes, size: tuple[int, int], message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=message):
        decode_labels(LabelsRecord((record,)), part, size)


def test_swelling_part_is_not_inflated() -> None:
    bomb = zlib.compress(bytes(50_000_000), 9)
    packed = replace(RECORD, encoding=ChannelEncoding.ZLIB)
    with pytest.raises(RemoteProtocolError, match="13 bytes, expected 12"):
        decode_labels(LabelsRecord((packed,)), bomb)


EXPECTED_LANDMARK = Landmark("a", "beacon", 1.0, 2.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")


def test_landmarks_when_projected_have_pixel_and_time() -> None:
    visible = dataclasses.replace(LANDMARK, pixel=(3.0, 4.0), visible=True)
    hidden = dataclasses.replace(LANDMARK, pixel=None, visible=False)
    found = call(
        lambda id_: LandmarksReply(id_, (visible, hidden), 1.5),
        StreamClient.get_landmark_projections,
    )
    assert found == (
        LandmarkProjection(EXPECTED_LANDMARK, (3.0, 4.0), True, 1.5),
        LandmarkProjection(EXPECTED_LANDMARK, None, False, 1.5),
    )


# A timeout that expires in the test.
SHORT_S = 0.1
STATUS = StatusReply(1, 0, "Catoptra", "field", ("USARBot.OmniP2AT",), "realtime", 1, False, 0)
RAW_IMAGE = bytes(range(72))


def make_replies(request: Request) -> list[Reply]:
    """Replies of a well-behaved server."""
    match request:
        case GetStatusRequest(id_):
            return [dataclasses.replace(STATUS, id=id_)]
        case GetLandmarksRequest(id_, None):
            return [LandmarksReply(id_, (LANDMARK,))]
        case GetLandmarksRequest(id_):
            visible = dataclasses.replace(LANDMARK, pixel=(1.5, 2.5), visible=True)
            return [LandmarksReply(id_, (visible,), 0.25)]
        case GetStartPosesRequest(id_):
            return [StartPosesReply(id_, ())]
        case GetStateRequest(id_, robot, _):
            return [StateReply(id_, 1.5, (), robot, (), ())]
        case DriveRequest(id_) | ResetRequest(id_) | PublishRequest(id_) | ShareControlRequest(id_):
            return [Ok(id_)]
        case _:
            line = line_from_report(OdometryReading("Odometry", 1.0, 2.0, 0.5)).decode().strip()
            return [SensorReports(request.id, (line,), (1.0, 2.0, 0.0))]


def reply_to_all(request: Request) -> list[list[bytes]]:
    """Reply to every request; frames differ in their numbers only."""
    if isinstance(request, GetFrameRequest):
        header = dataclasses.replace(HEADER, id=request.id, sequence=request.id, camera_model=None)
        return [[bytes_from_message(header), RAW_IMAGE]]
    return [[bytes_from_message(reply)] for reply in make_replies(request)]


def ignore_request(request: Request) -> list[list[bytes]]:
    return []


def test_client_when_every_request_has_a_reply_returns_their_values() -> None:
    with serve_stream_script(reply_to_all) as port, StreamClient.connect(HOST, port) as client:
        assert client.get_status().world == "field"
        assert client.spawn("USARBot.OmniP2AT") == (1.0, 2.0, 0.0)
        assert client.step(0.2) == client.get_readings()
        client.drive(1.0, 2.0)
        client.reset()
        (mark,) = client.get_landmarks()
        assert (mark.name, mark.upper_colour) == (LANDMARK.name, LANDMARK.upper_colour)
        assert client.get_landmark_projections("Mine") == (
            LandmarkProjection(mark, (1.5, 2.5), True, 0.25),
        )
        assert client.get_start_poses() == ()


def test_note_sharing_and_drive_of_another_robot_are_requested() -> None:
    requests: list[Request] = []

    def record(request: Request) -> list[list[bytes]]:
        requests.append(request)
        return reply_to_all(request)

    with serve_stream_script(record) as port, StreamClient(HOST, port) as client:
        client.publish("ekf", {"pose": np.array([1.0, 2.0, 0.5])})
        client.share_control()
        client.share_control(False)
        client.drive(1.0, None, robot="Theirs")
        assert client.get_state("Theirs").robot == "Theirs"
        with pytest.raises(LocalProtocolError, match="no JSON object"):
            client.publish("ekf", {"pose": np.array([np.nan])})
    assert requests == [
        PublishRequest(1, "ekf", '{"pose":[1.0,2.0,0.5]}'),
        ShareControlRequest(2, True),
        ShareControlRequest(3, False),
        DriveRequest(4, 1.0, None, False, "Theirs"),
        GetStateRequest(5, "Theirs"),
    ]


def test_frames_when_iterated_are_requested_one_by_one() -> None:
    with serve_stream_script(reply_to_all) as port, StreamClient.connect(HOST, port) as client:
        frames = list(itertools.islice(client.iter_frames(encoding=ImageEncoding.RAW), 3))
    assert [frame.sequence for frame in frames] == [2, 3, 4]
    assert frames[0].rgb.tobytes() == RAW_IMAGE
    assert frames[0].rgb.shape == (4, 6, 3)
    assert (frames[0].robot_name, frames[0].missed_frames, frames[0].dropped_frames) == (
        "Mine",
        2,
        0,
    )


def test_replies_when_late_or_unknown_or_heartbeats_are_skipped() -> None:
    def reply_with_noise(request: Request) -> list[list[bytes]]:
        late = [bytes_from_message(Ok(request.id - 1))]
        return [[HEARTBEAT], late, [b"\x81\xa4kind\xa8forecast"], *reply_to_all(request)]

    with serve_stream_script(reply_with_noise) as port, StreamClient.connect(HOST, port) as client:
        client.drive(1.0, 1.0)
        assert client.get_frame(encoding=ImageEncoding.RAW).sequence == 3


def test_connection_when_there_is_no_server_names_the_address() -> None:
    with pytest.raises(ConnectionLostError, match=r"no stream server at .*--stream-port"):
        StreamClient.connect(HOST, 1, timeout_s=SHORT_S)


@pytest.mark.parametrize(
    ("sends_heartbeats", "error", "message"),
    [
        (False, ConnectionLostError, "no heartbeat"),
        (True, DeadlineExceededError, "sends heartbeats but not a frame"),
    ],
)
def test_server_when_it_sends_no_frame_is_lost_or_slow(
    sends_heartbeats: bool,
    error: type[CatoptraError],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(zmq_socket, "_SILENT_SERVER_TIMEOUT_S", 0.5)
    monkeypatch.setattr(zmq_socket, "_CHECK_INTERVAL_S", 0.1)
    with serve_stream_script(ignore_request, sends_heartbeats=sends_heartbeats) as port:
        with StreamClient(HOST, port, timeout_s=SHORT_S) as client:
            with pytest.raises(error, match=message):
                client.get_frame()


def test_camera_when_perspective_is_a_model_without_a_height() -> None:
    pairs = dict(pairs_from_perspective_camera(PerspectiveCamera(64, 48, 0.8)))

    def reply_with_camera(request: Request) -> list[list[bytes]]:
        reply = CameraReply(request.id, "USARBot.P2AT", "Camera", pairs, UPRIGHT_TRANSFORM, None)
        return [[bytes_from_message(reply)]]

    with serve_stream_script(reply_with_camera) as port, StreamClient(HOST, port) as client:
        assert client.get_camera("Camera") == PerspectiveCamera(64, 48, 0.8)
        with pytest.raises(RemoteProtocolError, match="Mirror"):
            client.get_camera_and_height("Camera")


def test_frames_when_the_server_restarts_continue() -> None:
    with serve_stream_script(reply_to_all) as port:
        client = StreamClient.connect(HOST, port)
        first = client.get_frame(encoding=ImageEncoding.RAW)
    with client, serve_stream_script(reply_to_all, port=port):
        again = client.get_frame(encoding=ImageEncoding.RAW)
        assert again.sequence == first.sequence + 1


def lose_first_request() -> Script:
    """Ignore the first request for a frame, as a server that restarts."""
    ids: list[int] = []

    def reply(request: Request) -> list[list[bytes]]:
        ids.append(request.id)
        return reply_to_all(request) if len(ids) > 1 else []

    return reply


def test_request_for_a_frame_when_lost_is_repeated() -> None:
    with serve_stream_script(lose_first_request()) as port, StreamClient(HOST, port) as client:
        assert client.get_frame(encoding=ImageEncoding.RAW).sequence == 1
