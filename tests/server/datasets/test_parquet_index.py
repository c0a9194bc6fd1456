"""The Parquet index, where pyarrow is installed."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.dataset_folder import require_pyarrow, write_parquet_index


def metadata(index: int) -> dict[str, Any]:
    """Metadata of a sample."""
    return {
        "key": f"{index:06d}",
        "index": index,
        "sequence": 0,
        "step": index,
        "time_s": 0.2 * index,
        "world": "field",
        "camera": "paper",
        "robot": "USARBot.OmniP2AT",
        "brightness": 1.0,
        "world_from_camera": {
            "position_m": [float(index), 0.0, -0.6],
            "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0],
        },
    }


def test_index_has_a_row_for_each_sample(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra [parquet]")
    write_parquet_index(tmp_path, map(metadata, range(3)))
    table = parquet.read_table(tmp_path / "index.parquet")
    assert table.column("key").to_pylist() == ["000000", "000001", "000002"]
    assert table.column("x_m").to_pylist() == [0.0, 1.0, 2.0]


def test_missing_package_is_an_error_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(CatoptraError, match=r"catoptra-server\[parquet\]"):
        require_pyarrow()
