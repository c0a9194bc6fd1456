"""JSON, YAML and fields of calibration files."""

from __future__ import annotations

import math

import pytest
import yaml

from catoptra_protocol.calibration.files import (
    Fields,
    format_number,
    format_numbers,
    parse_json,
    parse_yaml,
)
from catoptra_protocol.errors import ConfigError


def test_object_is_read() -> None:
    assert parse_json('{"a": 1.5}', "f") == {"a": 1.5}


@pytest.mark.parametrize("text", ["[]", "{", '{"a": NaN}', '{"a": 1, "a": 2}', '{"a":' * 50])
def test_text_that_is_no_plain_object_is_rejected_with_the_file(text: str) -> None:
    with pytest.raises(ConfigError, match=r"f.*JSON"):
        parse_json(text, "f")


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


VALUES = {
    "number": 2,
    "text": "a",
    "size": [640, 480],
    "truth": True,
    "nothing": math.nan,
    "huge": 10**400,
    "child": {"inner": -1.0},
    "items": [{"x": 1.0}],
}
FIELDS = Fields("file.yaml", VALUES)


def test_values_are_read_by_type() -> None:
    assert FIELDS.get_number("number") == 2.0
    assert FIELDS.get_number("missing", 3.0) == 3.0
    assert FIELDS.get_positive("number") == 2.0
    assert FIELDS.get_size_px("size") == (640, 480)
    assert FIELDS.get_numbers("size") == (640.0, 480.0)
    assert FIELDS.get_text("text") == FIELDS.get_choice("text", ("a", "b")) == "a"
    assert FIELDS.get_child("child").get_number("inner") == -1.0
    assert FIELDS.get_item("items", 0).get_number("x") == 1.0
    assert FIELDS.has("text")
    assert not FIELDS.has("missing")


@pytest.mark.parametrize("name", ["text", "truth", "nothing", "huge", "missing", "size"])
def test_value_that_is_no_finite_number_is_rejected(name: str) -> None:
    with pytest.raises(ConfigError, match=rf"file\.yaml: {name}=.*a finite number"):
        FIELDS.get_number(name)


def test_error_in_an_object_has_its_path() -> None:
    with pytest.raises(ConfigError, match=r"child\.inner='-1\.0': expected a number above 0"):
        FIELDS.get_child("child").get_positive("inner")
    with pytest.raises(ConfigError, match=r"items\[0\]\.y='missing'"):
        FIELDS.get_item("items", 0).get_number("y")
    with pytest.raises(ConfigError, match="at least 2"):
        FIELDS.get_item("items", 1)


def test_lists_of_another_length_and_long_ones_are_rejected() -> None:
    with pytest.raises(ConfigError, match="a list of 3 finite numbers"):
        FIELDS.get_numbers("size", 3)
    with pytest.raises(ConfigError, match="a list of finite numbers"):
        Fields("f", {"long": [0.0] * 5000}).get_numbers("long")
