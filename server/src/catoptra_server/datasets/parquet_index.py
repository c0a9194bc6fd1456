"""Index of a data set as a Parquet file, where pyarrow is installed: a row for each sample."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.shard_writer import write_whole

INDEX_NAME = "index.parquet"
REMEDY = "pip install 'catoptra-server[parquet]', or leave parquet out of the recipe's Formats"

_COLUMNS = ("key", "index", "sequence", "step", "time_s", "world", "camera", "robot", "brightness")


def require_pyarrow() -> None:
    """Raise CatoptraError where pyarrow is missing: before anything is drawn."""
    try:
        import pyarrow.parquet  # noqa: F401 - asks whether it can be imported
    except ImportError as error:
        raise CatoptraError(f"a Parquet index needs pyarrow: {REMEDY}") from error


def write_parquet_index(folder: Path, metadata: Iterable[Mapping[str, Any]]) -> None:
    """Write the index of a data set.

    Args:
        folder: Folder of the data set.
        metadata: Of all samples, in order.
    """
    require_pyarrow()
    import pyarrow
    import pyarrow.parquet

    rows = [_row(one) for one in metadata]
    file = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), file)
    write_whole(folder / INDEX_NAME, [file.getvalue()])


def _row(metadata: Mapping[str, Any]) -> dict[str, Any]:
    row = {name: metadata[name] for name in _COLUMNS}
    pose = metadata["world_from_camera"]
    names = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
    values = (*pose["position_m"], *pose["quaternion_xyzw"])
    return row | dict(zip(names, values, strict=True))
