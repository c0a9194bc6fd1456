"""The stream over the loopback: requests, rude peers, and those beside them."""

from __future__ import annotations

import asyncio

import msgpack
import pytest

from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import (
    CameraIs,
    Done,
    LandmarksAre,
    Refused,
    StartsAre,
    StatusIs,
)
from catoptra_protocol.wire.stream_requests import (
    AskCamera,
    AskFrame,
    AskLandmarks,
    AskStarts,
    AskStatus,
    Encoding,
)
from catoptra_server.simulation import Left
from catoptra_server.transports import zmq_stream
from helpers.loopback import play
from helpers.stream_messages import LAW
from helpers.stream_peer import raw_peer
from helpers.stream_scene import FACTS, Scene, streaming


def test_requests_about_the_server_are_answered() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as peer:
                camera = await peer.ask(AskCamera(1, ""))
                assert isinstance(camera, CameraIs)
                assert (camera.camera, camera.camera_law) == ("Omni", LAW)
                assert camera.plan == "traced"
                assert camera.robot_from_mirror.position_m == (0.1, 0.0, -0.5)
                marks = await peer.ask(AskLandmarks(2))
                assert isinstance(marks, LandmarksAre)
                assert marks.landmarks[0].upper_colour == "yellow"
                starts = await peer.ask(AskStarts(3))
                assert isinstance(starts, StartsAre)
                assert starts.starts == FACTS.starts
                status = await peer.ask(AskStatus(4))
                assert isinstance(status, StatusIs)
                assert (status.clients, status.has_robot) == (1, False)

    play(scene())


def test_camera_when_unknown_is_refused_with_those_that_are_known() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as peer:
                answer = await peer.ask(AskCamera(1, "Rear"))
                assert answer == Refused(1, "no camera 'Rear': this server's robots have Omni")

    play(scene())


MALFORMED = {
    "empty": (b"",),
    "garbage": (b"\xc1\xff\0",),
    "text": (b"INIT {ClassName USARBot.P2AT}\r\n",),
    "no kind": (msgpack.packb({"id": 1}),),
    "unknown kind": (msgpack.packb({"kind": "fly", "id": 1}),),
    "missing field": (msgpack.packb({"kind": "ask_step", "id": 1}),),
    "not finite": (msgpack.packb({"kind": "ask_step", "id": 1, "time_s": float("inf")}),),
    "a part too many": (msgpack.packb({"kind": "ask_status", "id": 1}), b"more"),
    "an answer": (msgpack.packb({"kind": "pulse", "version": 1}),),
}


@pytest.mark.parametrize("parts", MALFORMED.values(), ids=MALFORMED.keys())
def test_message_when_malformed_is_refused_and_nobody_is_disturbed(
    parts: tuple[bytes, ...],
) -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as rude, raw_peer(server.port) as other:
                assert (await other.frame())[0].sequence == 1
                assert await rude.refusal(*parts)
                assert (await other.frame())[0].sequence == 2
                assert (await rude.frame())[0].sequence == 3

    play(scene())


def test_part_when_longer_than_any_request_ends_its_connection_only() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as rude, raw_peer(server.port) as other:
                await rude.send(bytes(1024 * 1024))
                for number in range(1, 4):
                    assert (await other.frame())[0].sequence == number

    play(scene())


def test_camera_when_nobody_asks_for_frames_is_not_drawn() -> None:
    async def scene() -> None:
        drawn = Scene()
        async with streaming(drawn) as server:
            with raw_peer(server.port) as peer:
                for number in range(1, 20):
                    await peer.ask(AskStatus(number))
                server.pulse()
        assert drawn.drawn == 0

    play(scene())


def test_subscriber_when_it_stalls_costs_one_frame_and_no_other_its_own() -> None:
    async def scene() -> None:
        drawn = Scene(640, 480)
        async with streaming(drawn) as server:
            with raw_peer(server.port, keeps=1) as stalled, raw_peer(server.port) as other:
                await stalled.ask_frame()
                headers = [(await other.frame())[0] for _ in range(100)]
        sequences = [header.sequence for header in headers]
        assert sequences == sorted(set(sequences))
        # 100 for one, at most one more for the other: nothing is drawn for who does not read.
        assert sequences[-1] <= drawn.drawn <= 101
        assert {header.dropped for header in headers} == {0}

    play(scene())


def test_subscriber_when_it_asks_and_asks_without_reading_is_sent_a_bounded_number() -> None:
    async def scene() -> None:
        async with streaming(Scene(640, 480)) as server:
            with raw_peer(server.port, keeps=1) as stalled, raw_peer(server.port) as other:
                for _ in range(100):
                    await stalled.ask_frame()
                    await other.frame()
                rude, served = sorted((p.slot for p in server.peers), key=lambda slot: slot.sent)
                # Eight of 0.9 MB wait here, the rest is in the kernel's buffers and the peer's.
                assert 1 <= rude.sent <= 25
                assert rude.dropped >= 50
                assert (served.sent, served.dropped) == (100, 0)

    play(scene())


def test_peer_when_its_connection_is_gone_leaves_the_simulation() -> None:
    async def scene() -> None:
        record = Scene()
        async with streaming(record) as server:
            with raw_peer(server.port) as peer:
                await peer.ask(AskStatus(1))
                (client,) = server.peers
            while not record.posted:
                server.pulse()
                await asyncio.sleep(0)
            assert record.posted == [Left(client)]
            assert server.peers == ()

    play(scene())


def test_peer_when_busy_is_sent_a_few_pulses_only_and_stays() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as busy:
                await busy.ask(AskStatus(1))
                for _ in range(1000):  # more than its socket keeps
                    server.pulse()
                await busy.send(bytes_from_message(AskStatus(2)))
                pulses = 0
                while (await busy.message()).KIND == "pulse":
                    pulses += 1
                # ZeroMQ takes fewer where it cannot send as fast as this loop.
                assert 0 < pulses <= zmq_stream.IDLE_PULSES
                server.pulse()
                assert (await busy.message()).KIND == "pulse"
                assert len(server.peers) == 1

    play(scene())


def test_peer_when_it_waits_is_sent_every_pulse() -> None:
    async def scene() -> None:
        blind = Scene(draws=False)
        async with streaming(blind) as server:
            with raw_peer(server.port) as waiting:
                await waiting.ask(AskStatus(1))
                await waiting.ask_frame()
                while not server.peers[0].slot.is_waiting:
                    await asyncio.sleep(0)
                for _ in range(100):
                    server.pulse()
                    assert (await waiting.message()).KIND == "pulse"

    play(scene())


def test_peer_when_gone_after_long_idleness_leaves_and_others_stay() -> None:
    async def scene() -> None:
        scene = Scene()
        async with streaming(scene) as server:
            with raw_peer(server.port) as other:
                await other.ask(AskStatus(1))
                with raw_peer(server.port) as peer:
                    await peer.ask(AskStatus(1))
                    for _ in range(100):
                        server.pulse()
                    assert len(server.peers) == 2
                while len(server.peers) == 2:
                    server.pulse()
                    await asyncio.sleep(0)
                assert [type(request) for request in scene.posted] == [Left]
                await other.ask(AskStatus(2))

    play(scene())


def test_answer_when_delivered_after_the_end_goes_nowhere() -> None:
    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as peer:
                await peer.ask(AskStatus(1))
                (client,) = server.peers
        client.answer(Done(1))

    play(scene())


def test_peers_when_there_are_enough_further_ones_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(zmq_stream, "MAX_PEERS", 1)

    async def scene() -> None:
        async with streaming(Scene()) as server:
            with raw_peer(server.port) as first, raw_peer(server.port) as second:
                await first.ask(AskStatus(1))
                assert await second.ask(AskStatus(5)) == Refused(5, "1 clients are served, no more")

    play(scene())


def test_server_when_it_ends_ends_every_peer() -> None:
    async def scene() -> None:
        record = Scene()
        async with streaming(record) as server:
            with raw_peer(server.port) as peer:
                await peer.ask(AskStatus(1))
                await peer.send(bytes_from_message(AskFrame(2, "", "", Encoding.RAW)))
                (client,) = server.peers
                server.close_peers()
                assert record.posted == [Left(client)]

    play(scene())
