"""The mark of the pictures that an exported file is of."""

from __future__ import annotations

import json

import pytest

from catoptra_protocol.calibration.calibrated_camera import mark_picture, read_picture_mark
from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.radial_camera import Picture

TEXTS = ["%YAML:1.0\n---\nxi: 1.0\n", "cam0:\n  xi: 1.0\n", '{\n  "value0": {"a": 1}\n}\n']


@pytest.mark.parametrize("picture", list(Picture))
@pytest.mark.parametrize("text", TEXTS)
def test_mark_of_a_text_is_read_again(text: str, picture: Picture) -> None:
    marked = mark_picture(text, picture)
    assert read_picture_mark(marked, "file") is picture
    # The head stays first for OpenCV, the first object for Basalt.
    assert marked.splitlines()[0] in (text.splitlines()[0], f"# catoptra_picture: {picture.value}")
    if text.startswith("{"):
        assert list(json.loads(marked)) == ["value0", "catoptra_picture"]


def test_file_of_another_program_has_no_mark() -> None:
    assert read_picture_mark("cam0:\n  picture: nice\n", "file") is None


def test_mark_of_no_hand_is_an_error() -> None:
    with pytest.raises(
        ConfigError, match=r"a\.yaml.*catoptra_picture='upside'.*mirrored or flipped"
    ):
        read_picture_mark("# catoptra_picture: upside\n", "a.yaml")
