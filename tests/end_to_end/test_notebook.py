"""The example notebook, cell by cell against a server process, without Jupyter."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_client.frame_pictures import FrameView
from helpers.configs import REPOSITORY
from helpers.server_process import start_server, write_small_robot

NOTEBOOK = REPOSITORY / "examples/first_steps.ipynb"


def read_code_cells(port: int) -> list[str]:
    """Sources of the code cells, for a server at another port than the default."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert sum("5005" in source for source in sources) == 1
    return [source.replace("5005", str(port)) for source in sources]


def run_cell(source: str, names: dict[str, Any]) -> object:
    """Value of a cell's last expression, which a notebook displays; None for other statements."""
    body = ast.parse(source).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), str(NOTEBOOK), "exec"), names)
    if not isinstance(last, ast.Expr):
        return None
    value: object = eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names)
    return value


def test_cells_run_in_order_and_show_the_drive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names: dict[str, Any] = {}
    with start_server(tmp_path, robot=write_small_robot(tmp_path)) as server:
        values = [run_cell(source, names) for source in read_code_cells(server.stream_port)]
        assert server.terminate() == 0
    first, last = (value for value in values if isinstance(value, FrameView))
    assert first.panorama is not None
    assert first._repr_png_() != last._repr_png_()
    assert np.linalg.norm(names["frame"].world_from_robot.translation[:2]) > 0.05
    assert "trace" in capsys.readouterr().out


def test_notebook_is_stored_without_outputs() -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert all(not cell.get("outputs") and not cell.get("execution_count") for cell in cells)
