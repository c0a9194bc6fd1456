"""The map of landmark positions."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_client.localization import find_landmark_position, make_landmark_map
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import read_landmarks

FIELD = Path(__file__).parents[3] / "configs/landmarks/four_legged_2006.csv"


def test_map_of_the_field_file_has_every_landmark() -> None:
    known = make_landmark_map(read_landmarks(FIELD))
    assert len(known) == 6
    beacon = find_landmark_position(known, "magenta_over_yellow")
    assert (beacon.x_m, beacon.y_m) == (1.35, -1.9)


def test_unknown_name_is_rejected_with_the_known_ones() -> None:
    with pytest.raises(DomainError, match=r"no landmark 'moon'.*cyan_goal.*yellow_goal"):
        find_landmark_position(make_landmark_map(read_landmarks(FIELD)), "moon")


def test_map_cannot_be_changed() -> None:
    known = make_landmark_map(())
    with pytest.raises(TypeError):
        known["a"] = None  # type: ignore[index]
