"""Notes: what a server accepts, and the text of a note with values of NumPy."""

from __future__ import annotations

import json

import numpy as np
import pytest

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_NOTE_BYTES, MAX_NOTE_NAME_CHARS, MAX_NOTES
from catoptra_protocol.notes import check_note, check_note_count, text_from_note


@pytest.mark.parametrize("name", ["e", "ekf", "my filter", "caf\xe9", "n" * MAX_NOTE_NAME_CHARS])
def test_note_when_its_name_is_printable_is_accepted(name: str) -> None:
    check_note(name, "{}")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "0 characters: expected 1 to 64"),
        ("n" * (MAX_NOTE_NAME_CHARS + 1), "65 characters"),
        ("n" * 10**6, "1000000 characters"),
        ("a\nb", r"'a\nb': expected printable"),
        ("\x1b[2J", r"'\x1b[2J'"),
        ("\x9b2J", "printable"),
        ("\u202eabc", "printable"),
        ("\ud800", "printable"),
    ],
    ids=ascii,
)
def test_note_when_its_name_is_no_label_has_a_short_reason(name: str, reason: str) -> None:
    with pytest.raises(LocalProtocolError) as caught:
        check_note(name, "{}")
    found = str(caught.value)
    assert reason in found
    assert len(found) < 200
    assert found.isascii()


def test_note_when_one_byte_too_long_is_refused() -> None:
    fits = '{"x":"' + (MAX_NOTE_BYTES - 8) * "y" + '"}'
    assert len(fits) == MAX_NOTE_BYTES
    check_note("a", fits)
    with pytest.raises(LocalProtocolError, match="8193 bytes: at most 8192"):
        check_note("a", fits + " ")


@pytest.mark.parametrize("text", ["", "[]", "1", "{", '{"x":NaN}', '{"x":1e999}', '{"x":1,"x":2}'])
def test_note_when_its_text_is_no_object_of_finite_numbers_is_refused(text: str) -> None:
    with pytest.raises(LocalProtocolError, match="note 'a': "):
        check_note("a", text)


def test_names_when_as_many_as_allowed_can_only_be_used_again() -> None:
    names = {f"note {number}": None for number in range(MAX_NOTES)}
    check_note_count(names, "note 3")
    with pytest.raises(LocalProtocolError, match="8 names"):
        check_note_count(names, "another")
    del names["note 0"]
    check_note_count(names, "another")


def test_text_of_arrays_and_scalars_of_numpy_has_their_numbers() -> None:
    note = {
        "pose": np.array([1.0, 2.0, 0.5]),
        "covariance": np.eye(3),
        "count": np.int64(3),
        "detections": [{"range_m": np.float32(0.5), "accepted": np.bool_(True)}],
    }
    assert json.loads(text_from_note("ekf", note)) == {
        "pose": [1.0, 2.0, 0.5],
        "covariance": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "count": 3,
        "detections": [{"range_m": 0.5, "accepted": True}],
    }


@pytest.mark.parametrize(
    ("note", "reason"),
    [
        ({"pose": np.array([np.nan])}, "note 'ekf': no JSON object"),
        ({"pose": [float("inf")]}, "note 'ekf': no JSON object"),
        ({"pose": 1j}, "complex is no value of JSON"),
        ({"pose": np.array([1j])}, "complex is no value of JSON"),
        ({"image": np.zeros((640, 480))}, "at most 8192"),
    ],
    ids=["NaN", "infinity", "complex", "complex array", "image"],
)
def test_note_when_it_has_no_text_is_not_sent(note: dict[str, object], reason: str) -> None:
    with pytest.raises(LocalProtocolError, match=reason):
        text_from_note("ekf", note)


def test_note_when_its_name_is_no_label_is_not_sent() -> None:
    with pytest.raises(LocalProtocolError, match="printable"):
        text_from_note("a\n", {})
