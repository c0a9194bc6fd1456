"""Files of samples."""

from __future__ import annotations

import io

import numpy as np
import pytest

from catoptra_server.datasets.png_files import decode_png
from catoptra_server.datasets.sample import RenderedSample, encode_json, encode_sample

RANDOM = np.random.default_rng(2)


def make_sample() -> RenderedSample:
    """Sample of 5 x 4 px with channels of each kind."""
    normals = RANDOM.normal(size=(4, 5, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return RenderedSample(
        "000007",
        RANDOM.integers(0, 256, (4, 5, 3)).astype(np.uint8),
        {
            "range": np.array([[1.5, np.inf, 2.0, 3.0, 4.0]] * 4, dtype=np.float32),
            "ids": RANDOM.integers(0, 60000, (4, 5)).astype(np.uint16),
            "normal": normals.astype(np.float32),
            "flow": np.full((4, 5, 2), np.nan, dtype=np.float32),
        },
        {"key": "000007", "b": 0.1, "a": None},
    )


def test_files_hold_the_sample() -> None:
    sample = make_sample()
    files = encode_sample(sample)
    assert [*files] == ["flow.npy", "ids.png", "json", "normal.npy", "range.npy", "rgb.png"]
    np.testing.assert_array_equal(decode_png(files["rgb.png"]), sample.rgb)
    np.testing.assert_array_equal(decode_png(files["ids.png"]), sample.channels["ids"])
    ranges = np.load(io.BytesIO(files["range.npy"]))
    np.testing.assert_array_equal(ranges, sample.channels["range"])
    normals = np.load(io.BytesIO(files["normal.npy"]))
    assert normals.dtype == np.float16
    cosines = (normals.astype(float) * sample.channels["normal"]).sum(axis=-1)
    cosines /= np.linalg.norm(normals.astype(float), axis=-1)
    assert np.degrees(np.arccos(np.minimum(cosines, 1.0))).max() < 0.05
    assert encode_sample(sample) == files


def test_json_has_no_text_for_a_number_that_is_not_finite() -> None:
    assert encode_json({"b": 1, "a": [0.1, None]}) == b'{"a":[0.1,null],"b":1}'
    with pytest.raises(ValueError, match="JSON"):
        encode_json({"a": float("nan")})
