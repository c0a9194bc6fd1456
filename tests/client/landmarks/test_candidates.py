"""Cylinder views and candidates: rows, columns, landmarks of equal appearance."""

from __future__ import annotations

import dataclasses
import math

import pytest

from catoptra_client.landmarks.blobs import Blob, Viewpoint
from catoptra_client.landmarks.candidates import CylinderView, require_distinct_colours
from catoptra_client.landmarks.detector import DEFAULT_CYLINDER
from catoptra_protocol.errors import DomainError
from client.landmarks import synthetic_frames

VIEW = CylinderView(synthetic_frames.make_camera(), DEFAULT_CYLINDER, Viewpoint())
BEACON = next(row for row in synthetic_frames.FIELD_LANDMARKS if row.kind == "beacon")


def test_columns_beyond_the_image_continue_around() -> None:
    assert VIEW.azimuth_from_column(0.0) == pytest.approx(math.pi)
    assert VIEW.azimuth_from_column(730.0) == pytest.approx(-math.pi + 10 * math.pi / 360)


def test_drop_is_measured_from_the_viewpoint_to_a_fraction_of_the_band() -> None:
    assert [VIEW.drop_m(BEACON, share) for share in (0.0, 0.5, 1.0)] == pytest.approx(
        [0.4, 0.3, 0.2]
    )


@pytest.mark.parametrize(
    ("top", "bottom", "cut"), [(0, 5, True), (170, 180, True), (1, 179, False)]
)
def test_blob_at_an_edge_is_cut(top: float, bottom: float, cut: bool) -> None:
    blob = Blob("cyan", 9, 5.0, 0.5 * (top + bottom), 2, 8, top, bottom)
    assert VIEW.touches_edge(blob) == cut


def test_landmarks_of_equal_appearance_are_rejected() -> None:
    twin = dataclasses.replace(BEACON, name="twin", x_m=0.0)
    with pytest.raises(DomainError, match=r"twin and .* do not distinguish them"):
        require_distinct_colours([BEACON, twin])


def test_beacon_of_one_colour_is_rejected() -> None:
    plain = dataclasses.replace(BEACON, upper_colour=BEACON.lower_colour)
    with pytest.raises(DomainError, match="one colour"):
        require_distinct_colours([plain])


def test_field_landmarks_have_distinct_colours() -> None:
    require_distinct_colours(synthetic_frames.FIELD_LANDMARKS)
