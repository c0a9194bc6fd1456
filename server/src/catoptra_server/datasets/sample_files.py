"""Files of a sample: PNG where values are small integers, NumPy's format where they are not.

Ids and classes are never interpolated or compressed with loss. Normals are halved to float16: their
angle stays within 0.03 degrees.
"""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.shards import CHANNEL_FILES, METADATA, PICTURE
from catoptra_server.datasets.png_files import encode_png
from catoptra_server.datasets.sample import RenderedSample

# Types in files that differ from those of the channel.
_STORED_DTYPES = {"normal": np.dtype("<f2")}


def encode_sample(sample: RenderedSample) -> dict[str, bytes]:
    """Content of a sample's files by suffix, sorted: the same bytes for the same sample."""
    files = {PICTURE: encode_png(sample.rgb), METADATA: encode_json(sample.metadata)}
    for name, array in sample.channels.items():
        files[CHANNEL_FILES[name]] = _encode_channel(name, array)
    return dict(sorted(files.items()))


def _encode_channel(name: str, array: npt.NDArray[Any]) -> bytes:
    if CHANNEL_FILES[name].endswith(".png"):
        return encode_png(array)
    stored = np.ascontiguousarray(array, dtype=_STORED_DTYPES.get(name, array.dtype))
    file = io.BytesIO()
    # Version 1.0 of the format: a header of text, then the values as they lie in memory.
    np.lib.format.write_array(file, stored, version=(1, 0), allow_pickle=False)
    return file.getvalue()


def encode_json(content: Any) -> bytes:
    """JSON with sorted keys and without spaces; floats as the shortest text that reads back.

    Raises:
        ValueError: A number is not finite, which JSON has no text for.
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text.encode()
