"""Consistency of the limits."""

from __future__ import annotations

from catoptra_protocol import limits


def test_two_names_fit_into_a_server_line() -> None:
    assert 2 * limits.MAX_NAME_CHARS + 100 < limits.MAX_SERVER_LINE_BYTES


def test_server_line_of_maximum_length_fits_our_reader() -> None:
    assert limits.MAX_SERVER_LINE_BYTES < limits.MAX_LINE_BYTES


def test_image_of_4096_px_square_is_accepted() -> None:
    assert 4 + 3 * 4096 * 4096 <= limits.MAX_IMAGE_PAYLOAD_BYTES
    assert 4096 * 4096 <= limits.MAX_IMAGE_PIXELS
