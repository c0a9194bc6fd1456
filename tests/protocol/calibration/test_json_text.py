"""JSON of calibration files."""

from __future__ import annotations

import pytest

from catoptra_protocol.calibration.files import parse_json
from catoptra_protocol.errors import ConfigError


def test_object_is_read() -> None:
    assert parse_json('{"a": 1.5}', "f") == {"a": 1.5}


@pytest.mark.parametrize("text", ["[]", "{", '{"a": NaN}', '{"a": 1, "a": 2}', '{"a":' * 50])
def test_text_that_is_no_plain_object_is_rejected_with_the_file(text: str) -> None:
    with pytest.raises(ConfigError, match=r"f.*JSON"):
        parse_json(text, "f")
