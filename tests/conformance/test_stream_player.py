"""The stream's player against servers that do wrong, in a thread of this process."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, Reply, StatusReply
from catoptra_protocol.stream.requests import Request
from conformance.conversation_file import Conversation, StepSpec
from conformance.stream_player import play_conversation
from helpers.scripted_stream import Script, serve_stream_script
from helpers.stream_messages import HEADER

GET_STATUS_STEP: StepSpec = {
    "ask": {"kind": "ask_status"},
    "answer": {"kind": "status", "server": "C.*"},
}
GET_FRAME_STEP: StepSpec = {
    "ask": {"kind": "ask_frame", "robot": "", "camera": "", "encoding": "raw"},
    "answer": {"kind": "frame"},
}
HEADER_WITHOUT_CAMERA = dataclasses.replace(HEADER, camera_law=None)
PICTURE = bytes(HEADER.width_px * HEADER.height_px * 3)


def play_steps(script: Script, *steps: StepSpec) -> str:
    """Return what holding these steps with a scripted server says."""
    with serve_stream_script(script) as port:
        talk = Conversation("c", "", "stream", True, steps)
        return play_conversation(talk, ("127.0.0.1", port), {"class": "C", "place": "{Start S}"})


def make_status(id_: int, *, server: str = "Catoptra", clock: str = "realtime") -> Reply:
    """Return a status."""
    return StatusReply(1, id_, server, "field", (), clock, 1, False, 0)


def test_hold_when_all_is_well_says_nothing() -> None:
    def script(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(make_status(request.id))]]

    assert play_steps(script, GET_STATUS_STEP, GET_STATUS_STEP) == ""


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (Error(1, "no room"), "step 1 (ask): kind 'refused', not 'status': no room"),
        (make_status(2), "step 1 (ask): id 2, not 1"),
        (make_status(1, server="Other"), "step 1 (ask): server 'Other', not 'C.*'"),
    ],
    ids=["kind", "id", "text"],
)
def test_hold_when_the_answer_is_another_says_how(answer: Reply, said: str) -> None:
    assert play_steps(lambda request: [[bytes_from_message(answer)]], GET_STATUS_STEP) == said


def test_hold_when_an_answer_lacks_a_field_names_it() -> None:
    assert "'id'" in play_steps(lambda request: [[b"\x81\xa4kind\xa4done"]], GET_STATUS_STEP)


def test_hold_when_a_frame_is_no_newer_says_so() -> None:
    def script(request: Request) -> list[list[bytes]]:
        header = dataclasses.replace(HEADER_WITHOUT_CAMERA, id=request.id, sequence=7)
        return [[bytes_from_message(header), PICTURE]]

    assert play_steps(script, GET_FRAME_STEP, GET_FRAME_STEP) == "step 2 (ask): frame 7 after 7"


def test_hold_when_a_picture_is_not_what_its_header_says_says_so() -> None:
    def script(request: Request) -> list[list[bytes]]:
        return [
            [
                bytes_from_message(dataclasses.replace(HEADER_WITHOUT_CAMERA, id=request.id)),
                PICTURE[1:],
            ]
        ]

    assert "its picture has 71 bytes" in play_steps(script, GET_FRAME_STEP)


def test_hold_when_a_spawn_is_asked_fills_in_class_and_place() -> None:
    asked: list[Request] = []

    def script(request: Request) -> list[list[bytes]]:
        asked.append(request)
        return [[bytes_from_message(Error(request.id, "no"))]]

    spawn = {"ask": {"kind": "ask_spawn", "name": "N"}, "answer": {"kind": "refused"}}
    assert play_steps(script, spawn) == ""
    (request,) = asked
    assert dataclasses.asdict(request) == {
        "id": 1,
        "class_name": "C",
        "name": "N",
        "location_m": None,
        "rotation_rad": (0.0, 0.0, 0.0),
        "start": "S",
    }
