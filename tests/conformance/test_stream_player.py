"""The player of the stream against servers that misbehave, in a thread of this process."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, Reply, StatusReply
from catoptra_protocol.stream.requests import Request
from conformance.conversation_file import Conversation, StepSpec
from conformance.stream_player import play_conversation
from helpers.scripted_stream import Script, serve_stream_script

GET_STATUS_STEP: StepSpec = {
    "request": {"kind": "get_status"},
    "reply": {"kind": "status", "server": "C.*"},
}


def play_steps(script: Script, *steps: StepSpec) -> str:
    """Outcome of these steps with a scripted server."""
    with serve_stream_script(script) as port:
        conversation = Conversation("c", "", "stream", True, steps)
        variables = {"class": "C", "spawn_pose": "{Start S}"}
        return play_conversation(conversation, ("127.0.0.1", port), variables)


def make_status(id_: int, *, server: str = "Catoptra", clock: str = "realtime") -> Reply:
    """A status reply."""
    return StatusReply(1, id_, server, "field", (), clock, 1, False, 0)


def test_play_when_all_replies_match_passes() -> None:
    def script(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(make_status(request.id))]]

    assert play_steps(script, GET_STATUS_STEP, GET_STATUS_STEP) == ""


@pytest.mark.parametrize(
    ("reply", "expected_reason"),
    [
        (Error(1, "no room"), "step 1 (request): kind 'error', not 'status': no room"),
        (make_status(2), "step 1 (request): id 2, not 1"),
        (make_status(1, server="Other"), "step 1 (request): server 'Other', not 'C.*'"),
    ],
    ids=["kind", "id", "text"],
)
def test_play_when_the_reply_differs_reports_the_difference(
    reply: Reply, expected_reason: str
) -> None:
    reason = play_steps(lambda request: [[bytes_from_message(reply)]], GET_STATUS_STEP)
    assert reason == expected_reason


def test_play_when_a_reply_lacks_a_field_names_the_field() -> None:
    assert "'id'" in play_steps(lambda request: [[b"\x81\xa4kind\xa2ok"]], GET_STATUS_STEP)


def test_play_when_a_spawn_is_requested_fills_in_class_and_pose() -> None:
    requests: list[Request] = []

    def script(request: Request) -> list[list[bytes]]:
        requests.append(request)
        return [[bytes_from_message(Error(request.id, "no"))]]

    spawn = {"request": {"kind": "spawn", "name": "N"}, "reply": {"kind": "error"}}
    assert play_steps(script, spawn) == ""
    (request,) = requests
    assert dataclasses.asdict(request) == {
        "id": 1,
        "class_name": "C",
        "name": "N",
        "location_m": None,
        "rotation_rad": (0.0, 0.0, 0.0),
        "start": "S",
    }
