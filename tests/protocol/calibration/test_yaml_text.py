"""YAML of calibration files: OpenCV's head and matrices, aliases, numbers."""

from __future__ import annotations

import pytest
import yaml

from catoptra_protocol.calibration.files import format_number, format_numbers, parse_yaml
from catoptra_protocol.errors import ConfigError

OPENCV = """%YAML:1.0
---
K: !!opencv-matrix
   rows: 1
   cols: 2
   dt: d
   data: [ 1.5, 2.0 ]
"""


def test_opencv_s_head_and_matrices_are_read() -> None:
    for head in ("%YAML:1.0", "%YAML 1.0"):
        document = parse_yaml(OPENCV.replace("%YAML:1.0", head), "f")
        assert document["K"]["data"] == [1.5, 2.0]


@pytest.mark.parametrize(
    "text",
    ["a: &x [1, 2]\nb: [*x, *x]\n", "a: !!python/object/apply:os.getcwd []\n", "a: [", "\x00"],
)
def test_aliases_and_code_are_rejected_with_the_file(text: str) -> None:
    with pytest.raises(ConfigError, match=r"f.*plain YAML"):
        parse_yaml(text, "f")


@pytest.mark.parametrize("value", [180.0, 1e-5, -2.5e300, 0.1, 1e22])
def test_number_has_a_point_and_reads_back_as_the_same_double(value: float) -> None:
    text = format_number(value)
    assert "." in text
    assert yaml.safe_load(text) == value
    assert yaml.safe_load(format_numbers((value, 1.0))) == [value, 1.0]
