"""Attacks on the ZeroMQ stream: floods of requests, deaf peers, identities used again.

Each function attacks until the server ends the connection; `attacker_process` calls it again.
"""

from __future__ import annotations

import contextlib
import time
from itertools import count, repeat

from catoptra_protocol.stream.requests import (
    FrameVariant,
    GetFrameRequest,
    GetLandmarksRequest,
    GetStatusRequest,
    ImageEncoding,
    SetAccuracyRequest,
    SpawnRequest,
)
from helpers import zmtp
from load.attack_tools import (
    HONEST_ROBOT,
    TIMEOUT_S,
    AttackedPorts,
    AttackingPeer,
    connect_peer,
    connect_robot,
    flood,
)


def flood_landmark_requests(ports: AttackedPorts) -> None:
    """Request the projections of the landmarks without pause."""
    with connect_peer(ports) as peer:
        _spawn(peer, "Landmarks", (2.0, 0.0, 0.0))
        peer.flood(GetLandmarksRequest(id_, "Landmarks", "") for id_ in count(2))


def flood_plan_requests(ports: AttackedPorts) -> None:
    """Request plans, each for another budget."""
    with connect_peer(ports) as peer:
        _spawn(peer, "Plans", (2.0, -0.7, 0.0))
        peer.flood(SetAccuracyRequest(id_, "", None, 5.0 + id_ % 9973 / 100.0) for id_ in count(2))


def change_max_error(ports: AttackedPorts) -> None:
    """Change the largest error by SET, and have a picture drawn with each value."""
    robot = connect_robot(ports, "MaxError", location="2.0,-1.4,0")
    with robot, connect_peer(ports) as peer:
        robot.setblocking(False)
        for id_ in count(1):
            tolerance_px = 0.05 + 0.04 * (id_ % 25)
            line = f"SET {{Type Camera}} {{Opcode MaxError}} {{Params {tolerance_px:.2f}}}\r\n"
            flood(robot, [line.encode()])
            peer.send(GetFrameRequest(id_, "MaxError", "", ImageEncoding.JPEG))
            peer.wait_for_replies(1)


def request_unknown_cameras(ports: AttackedPorts) -> None:
    """Request frames, each of another robot or camera that does not exist."""
    with connect_peer(ports) as peer:
        peer.flood(
            GetFrameRequest(id_, f"Robot{id_ % 2 * id_}", f"Camera{id_}", ImageEncoding.RAW)
            for id_ in count(1)
        )


def spell_one_camera(ports: AttackedPorts) -> None:
    """Request frames of one camera, whose name has another case each time, 200 a second."""
    name = "OmniCamPillar_Link4"
    with connect_peer(ports) as peer:
        for id_ in count(1):
            spelled = "".join(
                letter.upper() if id_ >> place & 1 else letter.lower()
                for place, letter in enumerate(name)
            )
            peer.send(GetFrameRequest(id_, HONEST_ROBOT, spelled, ImageEncoding.JPEG))
            peer.discard_replies()
            time.sleep(0.005)


def request_expensive_labels(ports: AttackedPorts) -> None:
    """Request a variant with 256 polygons, 16 samples and labels, six times a second."""
    with connect_peer(ports) as peer:
        for id_ in count(1):
            variant = FrameVariant(polygons=256, samples=4)
            peer.send(
                GetFrameRequest(id_, HONEST_ROBOT, "", ImageEncoding.RAW, variant, ("range", "ids"))
            )
            peer.discard_replies()
            time.sleep(0.16)


def hold_variants_unread(ports: AttackedPorts) -> None:
    """Request a variant of eight on each of 40 connections, and read none."""
    with contextlib.ExitStack() as peers:
        for number in range(40):
            peer = peers.enter_context(connect_peer(ports, receive_buffer=4096))
            variant = FrameVariant(max_error_px=0.5 + 0.1 * (number % 8))
            peer.send(
                *(
                    GetFrameRequest(id_, HONEST_ROBOT, "", ImageEncoding.RAW, variant)
                    for id_ in range(1, 9)
                )
            )
            time.sleep(0.02)
        time.sleep(TIMEOUT_S)


def request_in_bursts(ports: AttackedPorts) -> None:
    """Send forty requests at once, and read the replies late."""
    with connect_peer(ports) as peer:
        for id_ in count(1, 40):
            peer.send(*(GetStatusRequest(id_ + i) for i in range(20)))
            peer.send(*(GetLandmarksRequest(id_ + 20 + i) for i in range(19)))
            peer.send(GetFrameRequest(id_ + 39, "", "", ImageEncoding.JPEG))
            peer.wait_for_replies(8)
            peer.discard_replies()


def request_unread_stream_frames(ports: AttackedPorts) -> None:
    """Request frames on the stream, and read none."""
    with connect_peer(ports, receive_buffer=4096) as peer:
        for id_ in count(1):
            peer.send(GetFrameRequest(id_, "", "", ImageEncoding.RAW))


def reuse_identity(ports: AttackedPorts) -> None:
    """Spawn a robot, leave, and connect again at once with the same ZeroMQ identity."""
    for number in count():
        with connect_peer(ports, identity=b"reused") as peer:
            _spawn(peer, f"Reused{number % 3}", (-2.0, -1.0, 0.0))


def hold_unterminated_message(ports: AttackedPorts) -> None:
    """Send parts of a message that never ends, until disconnected."""
    with zmtp.connect_with_handshake(ports.stream) as connection:
        connection.settimeout(TIMEOUT_S)
        part = zmtp.zmtp_frame(b"part", zmtp.MORE)
        flood(connection, repeat(part))


def _spawn(peer: AttackingPeer, name: str, location_m: tuple[float, float, float]) -> None:
    request = SpawnRequest(
        id=1,
        class_name="USARBot.OmniP2AT",
        name=name,
        location_m=location_m,
        rotation_rad=(0.0, 0.0, 0.0),
        start=None,
    )
    peer.send(request)
    peer.wait_for_replies(1)
