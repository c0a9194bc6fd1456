"""The landmark file: the bundled one, and the errors of broken rows."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.landmarks import (
    Landmark,
    csv_from_landmarks,
    landmarks_from_lines,
    read_landmarks,
)
from catoptra_protocol.limits import MAX_LANDMARKS
from helpers.configs import REPOSITORY

HEADER = "name,kind,x_m,y_m,width_m,depth_m,band_bottom_m,band_top_m,lower_colour,upper_colour"
BEACON = "b1,beacon,1.35,-1.9,0.1,0.1,0.2,0.4,yellow,magenta"


def parse_landmark(*lines: str) -> tuple[Landmark, ...]:
    return landmarks_from_lines([HEADER, *lines], file="x.csv")


def test_bundled_file_has_four_beacons_and_two_goals() -> None:
    landmarks = read_landmarks(REPOSITORY / "configs/landmarks/four_legged_2006.csv")
    assert sorted(landmark.kind for landmark in landmarks) == 4 * ["beacon"] + 2 * ["goal"]
    beacons = {(m.lower_colour, m.upper_colour) for m in landmarks if m.kind == "beacon"}
    assert len(beacons) == 4  # each is known by its colours


def test_written_landmarks_read_back_the_same() -> None:
    landmarks = read_landmarks(REPOSITORY / "configs/landmarks/four_legged_2006.csv")
    quoted = dataclasses.replace(landmarks[0], name='a "b", c')
    lines = csv_from_landmarks((*landmarks, quoted)).split("\n")
    assert landmarks_from_lines(lines, file="x.csv") == (*landmarks, quoted)


def test_row_when_read_is_a_landmark() -> None:
    assert parse_landmark(BEACON) == (
        Landmark("b1", "beacon", 1.35, -1.9, 0.1, 0.1, 0.2, 0.4, "yellow", "magenta"),
    )


def test_band_centre_is_the_height_between_the_colours() -> None:
    assert parse_landmark(BEACON)[0].band_centre_m == pytest.approx(0.3)


def test_comments_blank_lines_and_spaces_are_ignored() -> None:
    lines = ["# a field", "", HEADER, "  # more", BEACON.replace(",", " , ")]
    assert landmarks_from_lines(lines, file="x.csv") == parse_landmark(BEACON)


def test_file_when_it_has_only_a_header_has_no_landmarks() -> None:
    assert parse_landmark() == ()


@pytest.mark.parametrize(
    ("old", "new", "key", "expected"),
    [
        ("beacon", "lamp", "kind", "one of beacon, goal"),
        ("yellow", "Yellow", "lower_colour", "one of cyan, magenta, yellow"),
        ("magenta", "pink", "upper_colour", "one of cyan, magenta, yellow"),
        ("1.35", "far", "x_m", "a number of metres"),
        ("1.35", "", "x_m", "a number of metres"),
        ("1.35", "inf", "x_m", "a number of metres"),
        ("0.1,0.1", "nan,0.1", "width_m", "a number of metres"),
        ("0.1,0.1", "0,0.1", "row", "width > 0"),
        ("1.35", "1e6", "x_m", "at most 100000"),
        ("beacon,1.35,-1.9,0.1,0.1", "goal,1.35,-1.9,0.1,0", "depth_m", "depth > 0"),
        ("0.2,0.4", "0.4,0.4", "row", "bottom < top"),
        ("0.2,0.4", "-0.1,0.4", "row", "0 <= bottom"),
        (",magenta", "", "row", "10 columns"),
        (",magenta", ",magenta,1", "row", "10 columns"),
    ],
)
def test_row_when_broken_names_file_line_key_and_expectation(
    old: str, new: str, key: str, expected: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_landmark("# the next one is wrong", BEACON.replace(old, new, 1))
    error = caught.value
    assert (error.location.file, error.location.line, error.key) == ("x.csv", 3, key)
    assert expected in error.expected


@pytest.mark.parametrize("lines", [[], ["# nothing"], [BEACON], [HEADER.replace("x_m", "x")]])
def test_header_when_missing_or_different_is_rejected(lines: list[str]) -> None:
    with pytest.raises(ConfigError, match="the columns name,kind,x_m"):
        landmarks_from_lines(lines, file="x.csv")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ((BEACON, BEACON), r"x\.csv:3: name='b1'.*only once"),
        ((BEACON.replace("b1", ""),), r"x\.csv:2: name=''"),
        # Longer than the limit of a CSV field; a quote that is never closed.
        ((BEACON.replace("b1", 200_000 * "x"),), r"x\.csv:2: row=.*a CSV"),
        ((BEACON.replace("b1", '"b1'),), r"x\.csv:2"),
    ],
    ids=["repeated name", "empty name", "long field", "open quote"],
)
def test_row_when_wrong_is_rejected_by_line(rows: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_landmark(*rows)


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00"])
def test_file_when_unreadable_is_named(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "x.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"x\.csv.*: file=.*(a readable CSV file|UTF-8)"):
        read_landmarks(path)


def test_file_of_40_gb_is_rejected_by_size(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    with path.open("wb") as file:
        file.truncate(40 * 10**9)  # sparse: takes no space on the disk
    with pytest.raises(ConfigError, match=r"x\.csv: file=.*at most 262144 bytes"):
        read_landmarks(path)


def test_row_beyond_the_largest_number_is_rejected_by_line() -> None:
    rows = [BEACON.replace("b1", f"b{n}") for n in range(MAX_LANDMARKS + 1)]
    assert len(parse_landmark(*rows[:-1])) == MAX_LANDMARKS
    with pytest.raises(ConfigError, match=rf"x\.csv:{MAX_LANDMARKS + 2}: .*at most 1024 landmarks"):
        parse_landmark(*rows)


def landmarks_or_error(lines: list[str]) -> tuple[tuple[Landmark, ...], ConfigError | None]:
    try:
        return landmarks_from_lines(lines, file="x.csv"), None
    except ConfigError as error:
        return (), error


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.text(alphabet=st.sampled_from("beacongl,.-+\"'#e10nif \n\r\0\u00e9"), max_size=80))
def test_text_when_arbitrary_is_read_or_rejected_with_a_line(text: str) -> None:
    lines = [HEADER, *text.split("\n")]
    landmarks, error = landmarks_or_error(lines)
    assert all(landmark.name for landmark in landmarks)
    assert error is None or 1 <= error.location.line <= len(lines)
