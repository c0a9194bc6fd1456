"""Notations of calibration files: JSON, YAML, XML, lines of numbers."""

from __future__ import annotations

import pytest
import yaml

from catoptra_protocol.calibration.files import (
    format_number,
    parse_document,
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
    for head in ("%YAML:1.0", "%YAML 1.0", "%YAML:1.0 # by hand"):
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


XML = """<?xml version="1.0"?>
<opencv_storage><K type_id="opencv-matrix"><rows>1</rows><data>1.5 2e-1</data></K>
<xi>0.5</xi><name>a b</name></opencv_storage>
"""


def test_xml_of_opencv_is_an_object_and_has_no_declarations() -> None:
    document = parse_document(XML, "f")
    assert document["K"] == {"rows": "1", "data": ["1.5", "2e-1"]}
    assert (document["xi"], document["name"]) == ("0.5", "a b")
    for text in (XML.replace("?>", '?><!DOCTYPE x [<!ENTITY e "e">]>'), "<a>", "<a>" * 99):
        with pytest.raises(ConfigError, match=r"f.*plain XML"):
            parse_document(text, "f")


def test_lines_are_those_of_ocamcalib_or_colmap() -> None:
    ocam = parse_document("# a\n2 1 0\n1 0\n3 4\n1 0 0\n480 640\n", "f")
    assert ocam["size"] == ["480", "640"]
    assert ocam["polynomial"] == ["2", "1", "0"]
    assert parse_document("# b\n7 EUCM 640 480 1.5\n", "f") == {
        "cameras": [{"model": "EUCM", "parameters": ["640", "480", "1.5"]}]
    }
