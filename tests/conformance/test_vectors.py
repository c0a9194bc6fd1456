"""The vectors of `data` against our code: in one piece, byte by byte, cut anywhere, with a tail."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.usarsim import reports
from catoptra_protocol.usarsim.commands import Command, command_from_message
from catoptra_protocol.usarsim.control_connection import ControlClient
from catoptra_protocol.usarsim.grammar import Dialect, LineReader, parse_message
from catoptra_protocol.usarsim.image_port import (
    ImageFrameReader,
    ImageRequestReader,
    encode_frame_header,
)
from catoptra_protocol.usarsim.reports import Report, line_from_report

DATA = Path(__file__).parent / "data"
_DOCUMENT_KEYS = {"description", "meaning", "canonical", "complete", "dialect", "reports"}
EventReader = Callable[[bytes], list[Any]]  # Any: events of five channels, compared as JSON


@dataclass(frozen=True)
class ConformanceVector:
    """One pair of files."""

    channel: str
    name: str
    data: bytes
    meaning: list[Any]
    is_canonical: bool
    is_complete: bool
    dialect: Dialect
    source_reports: list[Any] | None
    """Reports that the server writes, where a client reads less; else None."""

    def __str__(self) -> str:
        return f"{self.channel}/{self.name}"


def read_vector(path: Path) -> ConformanceVector:
    """Vector of a JSON file and its neighbour of bytes."""
    document = json.loads(path.read_text(encoding="utf-8"))
    assert set(document) <= _DOCUMENT_KEYS
    return ConformanceVector(
        channel=path.parent.name,
        name=path.stem,
        data=path.with_suffix(".bytes").read_bytes(),
        meaning=document["meaning"],
        is_canonical=document.get("canonical", False),
        is_complete=document.get("complete", True),
        dialect=Dialect(document.get("dialect", "ut2004")),
        source_reports=document.get("reports"),
    )


def make_command_reader() -> EventReader:
    """Reader of commands without connection states."""
    reader = LineReader()

    def receive(data: bytes) -> list[Command]:
        found = (command_from_message(parse_message(line)) for line in reader.receive(data))
        return [command for command in found if command is not None]

    return receive


# Receiver of each channel, and bytes that begin a message without completing it.
CHANNELS: dict[str, tuple[Callable[[], EventReader], bytes]] = {
    "commands": (make_command_reader, b"DRIVE {Left 9} {Ri"),
    "reports": (lambda: ControlClient().receive, b"SEN {Type Odometry} {Na"),
    "image_requests": (lambda: ImageRequestReader().receive, b"UOKOKOKOK"),
    "image_frames": (lambda: ImageFrameReader().receive, encode_frame_header(2, 9)),  # type: ignore[arg-type] # an int, as a foreign server would have it
}


VECTORS = [read_vector(x) for name in CHANNELS for x in sorted((DATA / name).glob("*.json"))]


def decode_chunks(vector: ConformanceVector, *chunks: bytes) -> list[Any]:
    """Events of the chunks on the vector's channel, as JSON."""
    receive = CHANNELS[vector.channel][0]()
    events = [{type(e).__name__: asdict(e)} for chunk in chunks for e in receive(chunk)]
    return list(json.loads(json.dumps(events, default=bytes.hex)))


each_vector = pytest.mark.parametrize("vector", VECTORS, ids=str)


def test_data_when_listed_holds_pairs_for_every_channel() -> None:
    assert {vector.channel for vector in VECTORS} == set(CHANNELS)
    assert {path.name for path in DATA.iterdir() if path.is_dir()} == {
        *CHANNELS,
        "conversations",
        "stream",
    }
    for channel in CHANNELS:
        pairs = {path.stem for path in (DATA / channel).glob("*.json")}
        assert {path.stem for path in (DATA / channel).iterdir()} == pairs


@each_vector
def test_vector_when_played_in_one_piece_has_its_meaning(vector: ConformanceVector) -> None:
    assert decode_chunks(vector, vector.data) == vector.meaning


@each_vector
def test_vector_when_played_byte_by_byte_has_the_same_meaning(vector: ConformanceVector) -> None:
    single = [vector.data[i : i + 1] for i in range(len(vector.data))]
    assert decode_chunks(vector, *single) == vector.meaning


@each_vector
def test_vector_when_cut_anywhere_has_the_same_meaning(vector: ConformanceVector) -> None:
    # At most 400 cuts: each decodes the vector anew, and the longest one has kilobytes.
    cuts = range(0, len(vector.data), max(1, len(vector.data) // 400))
    for cut in cuts:
        assert decode_chunks(vector, vector.data[:cut], vector.data[cut:]) == vector.meaning


@pytest.mark.parametrize("vector", [v for v in VECTORS if v.is_complete], ids=str)
def test_vector_when_a_tail_follows_has_the_same_meaning(vector: ConformanceVector) -> None:
    tail = CHANNELS[vector.channel][1]
    assert decode_chunks(vector, vector.data + tail) == vector.meaning


@pytest.mark.parametrize("vector", [v for v in VECTORS if v.is_canonical], ids=str)
def test_vector_when_canonical_is_written_by_us_with_the_same_bytes(
    vector: ConformanceVector,
) -> None:
    written = (
        ControlClient().receive(vector.data)
        if vector.source_reports is None
        else build_reports(vector)
    )
    assert b"".join(line_from_report(x, vector.dialect) for x in written) == vector.data


def build_reports(vector: ConformanceVector) -> list[Report]:
    """Reports of the server, where a client reads others."""
    return [
        getattr(reports, kind)(
            **{name: _field_value(name, value) for name, value in fields.items()}
        )
        for document in vector.source_reports or []
        for kind, fields in document.items()
    ]


def _field_value(name: str, value: Any) -> Any:
    """Value of a field: lists become tuples, nested documents their own dataclasses."""
    if name == "texture_region":
        return reports.TextureRegion(**value)
    if name == "links":
        return tuple(
            reports.LinkConfiguration(**{k: _field_value(k, v) for k, v in link.items()})
            for link in value
        )
    return tuple(map(tuple, value)) if name == "items" else value
