"""The stream over the loopback: requests, malformed messages, and their effect on other clients."""

from __future__ import annotations

import asyncio
import math

import msgpack
import pytest

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    LandmarksReply,
    Ok,
    StartPosesReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    GetCameraRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetStartPosesRequest,
    GetStatusRequest,
    ImageEncoding,
)
from catoptra_server.frames.frame import Frame
from catoptra_server.serve import port as port_module
from catoptra_server.serve.stream import peer as peer_module
from catoptra_server.serve.stream.peer import StreamPeer
from catoptra_server.simulation.events import ClientDisconnected
from helpers.fake_simulation import SERVER_INFO, FakeSimulation, serve_fake_simulation
from helpers.loopback import wait_until
from helpers.stream_messages import CAMERA_MODEL
from helpers.stream_peer import connect_raw_peer
from helpers.zmtp import connect_with_handshake, send_until_closed, zmtp_frame


async def test_requests_about_the_server_have_replies() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as peer:
            camera = await peer.send_request(GetCameraRequest(1, ""))
            assert isinstance(camera, CameraReply)
            assert (camera.camera, camera.camera_model) == ("Omni", CAMERA_MODEL)
            assert camera.plan == "traced"
            assert camera.robot_from_mirror.position_m == (0.1, 0.0, -0.5)
            landmarks = await peer.send_request(GetLandmarksRequest(2))
            assert isinstance(landmarks, LandmarksReply)
            assert landmarks.landmarks[0].upper_colour == "yellow"
            starts = await peer.send_request(GetStartPosesRequest(3))
            assert isinstance(starts, StartPosesReply)
            assert starts.start_poses == SERVER_INFO.start_poses
            status = await peer.send_request(GetStatusRequest(4))
            assert isinstance(status, StatusReply)
            assert (status.num_clients, status.has_robot) == (1, False)


# Parts of a message, and the id of the error.
MALFORMED = {
    "empty": ((b"",), 0),
    "garbage": ((b"\xc1\xff\0",), 0),
    "text": ((b"INIT {ClassName USARBot.P2AT}\r\n",), 0),
    "no kind": ((msgpack.packb({"id": 3}),), 3),
    "unknown kind": ((msgpack.packb({"kind": "fly", "id": 3}),), 3),
    "missing field": ((msgpack.packb({"kind": "step", "id": 3}),), 3),
    "not finite": ((msgpack.packb({"kind": "step", "id": 3, "time_s": float("inf")}),), 3),
    "id 0": ((msgpack.packb({"kind": "get_status", "id": 0}),), 0),
    "two parts": ((msgpack.packb({"kind": "get_status", "id": 3}), b"more"), 0),
    "a reply": ((msgpack.packb({"kind": "heartbeat", "version": 1}),), 0),
}


@pytest.mark.parametrize(("parts", "id_"), MALFORMED.values(), ids=MALFORMED.keys())
async def test_message_when_malformed_is_an_error_and_disturbs_no_other_client(
    parts: tuple[bytes, ...], id_: int
) -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as malformed, connect_raw_peer(server.port) as other:
            assert (await other.get_frame())[0].sequence == 1
            error = await malformed.receive_error(*parts)
            assert error.id == id_
            assert error.reason
            assert (await other.get_frame())[0].sequence == 2
            assert (await malformed.get_frame())[0].sequence == 3


async def test_part_when_longer_than_any_request_ends_only_its_connection() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as malformed, connect_raw_peer(server.port) as other:
            await malformed.send(bytes(1024 * 1024))
            for number in range(1, 4):
                assert (await other.get_frame())[0].sequence == number


async def test_camera_when_no_client_requests_frames_is_not_rendered() -> None:
    simulation = FakeSimulation()
    async with serve_fake_simulation(simulation) as server:
        with connect_raw_peer(server.port) as peer:
            for number in range(1, 20):
                await peer.send_request(GetStatusRequest(number))
            server.send_heartbeats()
    assert simulation.num_rendered == 0


async def test_client_when_it_stalls_costs_one_frame_and_none_of_another_client() -> None:
    simulation = FakeSimulation(640, 480)
    async with serve_fake_simulation(simulation) as server:
        with (
            connect_raw_peer(server.port, high_water_mark=1) as stalled,
            connect_raw_peer(server.port) as other,
        ):
            await stalled.request_frame()
            headers = [(await other.get_frame())[0] for _ in range(100)]
    sequences = [header.sequence for header in headers]
    assert sequences == sorted(set(sequences))
    # 100 for one client, at most one for the other, which does not read.
    assert sequences[-1] <= simulation.num_rendered <= 101
    assert {header.dropped_frames for header in headers} == {0}


async def test_client_when_it_requests_without_reading_is_sent_a_bounded_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A slow machine must not end the client before it has sent its requests.
    monkeypatch.setattr(peer_module, "MAX_BLOCKED_S", math.inf)
    monkeypatch.setitem(port_module._VANISHED_OPTIONS, "TCP_USER_TIMEOUT", 0)
    async with serve_fake_simulation(FakeSimulation(640, 480)) as server:
        with (
            connect_raw_peer(server.port, high_water_mark=1) as stalled,
            connect_raw_peer(server.port) as other,
        ):
            num_frames = 0
            # Until the first one is dropped, which is later where buffers are larger.
            while num_frames < 1000:
                await stalled.request_frame()
                await other.get_frame()
                num_frames += 1
                senders = [peer.frame_sender for peer in server.peers]
                # The stalled client's first request may still be on its way.
                if len(senders) < 2:
                    continue
                unread, served = sorted(senders, key=lambda sender: sender.num_sent)
                if num_frames >= 100 and unread.num_dropped:
                    break
            # Two of 0.9 MB are queued, one waits, the rest is in the buffers of the kernel and
            # the peer.
            assert 1 <= unread.num_sent <= 20
            assert unread.num_dropped >= 1
            assert (served.num_sent, served.num_dropped) == (num_frames, 0)


async def test_peer_when_busy_is_sent_a_few_heartbeats_only_and_stays() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as busy:
            await busy.send_request(GetStatusRequest(1))
            for _ in range(1000):  # more than its socket can queue
                server.send_heartbeats()
            await busy.send(bytes_from_message(GetStatusRequest(2)))
            num_heartbeats = 0
            while (await busy.receive_head()).KIND == "heartbeat":
                num_heartbeats += 1
            # ZeroMQ accepts fewer where it cannot send as fast as this loop.
            assert 0 < num_heartbeats <= 16
            server.send_heartbeats()
            assert (await busy.receive_head()).KIND == "heartbeat"
            assert len(server.peers) == 1


async def test_peer_when_it_waits_is_sent_every_heartbeat() -> None:
    idle = FakeSimulation(renders_frames=False)
    async with serve_fake_simulation(idle) as server:
        with connect_raw_peer(server.port) as waiting:
            await waiting.send_request(GetStatusRequest(1))
            await waiting.request_frame()
            while not server.peers[0].frame_sender.has_pending_request:
                await asyncio.sleep(0)
            for _ in range(100):
                server.send_heartbeats()
                assert (await waiting.receive_head()).KIND == "heartbeat"


async def test_peer_when_disconnected_after_long_idleness_is_removed_and_others_stay() -> None:
    simulation = FakeSimulation()
    async with serve_fake_simulation(simulation) as server:
        with connect_raw_peer(server.port) as other:
            await other.send_request(GetStatusRequest(1))
            with connect_raw_peer(server.port) as peer:
                await peer.send_request(GetStatusRequest(1))
                for _ in range(100):
                    server.send_heartbeats()
                assert len(server.peers) == 2
            while len(server.peers) == 2:
                server.send_heartbeats()
                await asyncio.sleep(0)
            assert [type(event) for event in simulation.posted_events] == [ClientDisconnected]
            await other.send_request(GetStatusRequest(2))


async def test_reply_when_sent_after_the_end_is_dropped() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as peer:
            await peer.send_request(GetStatusRequest(1))
            (client,) = server.peers
    client.send_reply(Ok(1))


async def test_peer_when_the_limit_is_reached_gets_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(peer_module, "MAX_PEERS", 1)
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as first, connect_raw_peer(server.port) as second:
            await first.send_request(GetStatusRequest(1))
            assert await second.send_request(GetStatusRequest(5)) == Error(
                5, "the limit of 1 clients is reached"
            )


async def test_server_when_it_ends_disconnects_every_peer() -> None:
    simulation = FakeSimulation()
    async with serve_fake_simulation(simulation) as server:
        with connect_raw_peer(server.port) as peer:
            await peer.send_request(GetStatusRequest(1))
            await peer.send(bytes_from_message(GetFrameRequest(2, "", "", ImageEncoding.RAW)))
            (client,) = server.peers
            server.disconnect_peers()
            assert simulation.posted_events == [ClientDisconnected(client.robot)]


async def test_newcomer_with_the_identity_of_a_departed_client_is_another_client() -> None:
    simulation = FakeSimulation()
    async with serve_fake_simulation(simulation) as server:
        robots = []
        for number in range(20):
            # Without a pause: the server has not noticed the end of the connection before.
            with connect_raw_peer(server.port, identity=b"same") as peer:
                status = await peer.send_request(GetStatusRequest(1))
                assert isinstance(status, StatusReply)
                assert not status.has_robot
                (client,) = server.peers
                robots.append(client.robot)
                client.robot.has_robot = True
                assert simulation.posted_events == list(map(ClientDisconnected, robots[:-1]))
            assert len(set(robots)) == number + 1


async def test_reply_when_it_is_for_a_departed_client_does_not_reach_its_successor() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port, identity=b"same") as peer:
            await peer.send_request(GetStatusRequest(1))
            (departed,) = server.peers
        with connect_raw_peer(server.port, identity=b"same") as peer:
            await peer.send_request(GetStatusRequest(1))
            departed.send_reply(Ok(2))
            await peer.send_request(GetStatusRequest(3))


async def test_client_when_it_never_reads_its_replies_is_disconnected_and_others_stay(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with serve_fake_simulation(FakeSimulation(640, 480)) as server:
        with connect_raw_peer(server.port) as peer:
            await peer.send_request(GetStatusRequest(1))
            await asyncio.to_thread(request_frames_until_closed, server.port)
            await peer.send_request(GetStatusRequest(3))
            await wait_until(lambda: len(server.peers) == 1, "end of the deaf client")
    assert caplog.text.count("reads nothing: disconnected") == 1


def request_frames_until_closed(port: int) -> None:
    """Request frames without reading any, until the server closes the connection."""
    requests = (GetFrameRequest(id_, "", "", ImageEncoding.RAW) for id_ in range(1, 101))
    block = b"".join(zmtp_frame(bytes_from_message(request)) for request in requests)
    with connect_with_handshake(port) as deaf:
        send_until_closed(deaf, block)


async def test_frame_requests_when_superseded_have_an_error_each() -> None:
    async with serve_fake_simulation(FakeSimulation(renders_frames=False)) as server:
        with connect_raw_peer(server.port) as peer:
            for _ in range(12):
                await peer.request_frame()
            for number in range(1, 12):
                expected = Error(number, f"superseded by request {number + 1}")
                assert (await peer.receive())[0] == expected


async def test_frame_when_its_encoding_raises_is_an_error_and_the_next_is_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def raise_error(*arguments: object) -> bytes:
        raise ZeroDivisionError

    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as peer:
            with monkeypatch.context() as patch:
                patch.setattr(Frame, "encode", raise_error)
                await peer.request_frame()
                reply = (await peer.receive())[0]
            assert isinstance(reply, Error)
            assert (reply.id, "internal fault" in reply.reason) == (1, True)
            assert (await peer.get_frame())[0].sequence == 2


async def test_heartbeats_when_one_raises_go_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(peer_module, "HEARTBEAT_INTERVAL_S", 0.001)
    simulation = FakeSimulation(renders_frames=False)
    async with serve_fake_simulation(simulation) as server:
        with connect_raw_peer(server.port) as peer:
            await peer.send_request(GetStatusRequest(1))
            with monkeypatch.context() as patch:
                patch.setattr(StreamPeer, "wants_heartbeat", lambda *_: 1 / 0)
                await wait_until(lambda: "heartbeats failed" in caplog.text, "failed heartbeat")
            await peer.request_frame()
            assert (await peer.receive_head()).KIND == "heartbeat"
