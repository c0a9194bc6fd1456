"""The stream's player against servers that do wrong, in a thread of this process."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import Answer, Refused, StatusIs
from catoptra_protocol.wire.stream_requests import Request
from conformance.script import Conversation, Step
from conformance.stream_conversation import hold
from helpers.scripted_stream import Script, scripted_stream
from helpers.stream_messages import HEADER

ASK_STATUS: Step = {"ask": {"kind": "ask_status"}, "answer": {"kind": "status", "server": "C.*"}}
ASK_FRAME: Step = {
    "ask": {"kind": "ask_frame", "robot": "", "camera": "", "encoding": "raw"},
    "answer": {"kind": "frame"},
}
NO_CAMERA = dataclasses.replace(HEADER, camera_law=None)
PICTURE = bytes(HEADER.width_px * HEADER.height_px * 3)


def held(script: Script, *steps: Step) -> str:
    """Return what holding these steps with a scripted server says."""
    with scripted_stream(script) as port:
        talk = Conversation("c", "", "stream", True, steps)
        return hold(talk, ("127.0.0.1", port), {"class": "C", "place": "{Start S}"})


def status(id_: int, *, server: str = "Catoptra", clock: str = "realtime") -> Answer:
    """Return a status."""
    return StatusIs(1, id_, server, "field", (), clock, 1, False, 0)


def test_hold_when_all_is_well_says_nothing() -> None:
    def script(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(status(request.id))]]

    assert held(script, ASK_STATUS, ASK_STATUS) == ""


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (Refused(1, "no room"), "step 1 (ask): kind 'refused', not 'status': no room"),
        (status(2), "step 1 (ask): id 2, not 1"),
        (status(1, server="Other"), "step 1 (ask): server 'Other', not 'C.*'"),
    ],
    ids=["kind", "id", "text"],
)
def test_hold_when_the_answer_is_another_says_how(answer: Answer, said: str) -> None:
    assert held(lambda request: [[bytes_from_message(answer)]], ASK_STATUS) == said


def test_hold_when_an_answer_lacks_a_field_names_it() -> None:
    assert "'id'" in held(lambda request: [[b"\x81\xa4kind\xa4done"]], ASK_STATUS)


def test_hold_when_a_frame_is_no_newer_says_so() -> None:
    def script(request: Request) -> list[list[bytes]]:
        header = dataclasses.replace(NO_CAMERA, id=request.id, sequence=7)
        return [[bytes_from_message(header), PICTURE]]

    assert held(script, ASK_FRAME, ASK_FRAME) == "step 2 (ask): frame 7 after 7"


def test_hold_when_a_picture_is_not_what_its_header_says_says_so() -> None:
    def script(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(dataclasses.replace(NO_CAMERA, id=request.id)), PICTURE[1:]]]

    assert "its picture has 71 bytes" in held(script, ASK_FRAME)


def test_hold_when_a_spawn_is_asked_fills_in_class_and_place() -> None:
    asked: list[Request] = []

    def script(request: Request) -> list[list[bytes]]:
        asked.append(request)
        return [[bytes_from_message(Refused(request.id, "no"))]]

    spawn = {"ask": {"kind": "ask_spawn", "name": "N"}, "answer": {"kind": "refused"}}
    assert held(script, spawn) == ""
    (request,) = asked
    assert dataclasses.asdict(request) == {
        "id": 1,
        "class_name": "C",
        "name": "N",
        "location_m": None,
        "rotation_rad": (0.0, 0.0, 0.0),
        "start": "S",
    }
