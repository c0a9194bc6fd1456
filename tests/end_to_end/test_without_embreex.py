"""A server process where embreex cannot be imported: raster serves its frames."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.configs import FIELD
from helpers.opengl import device_or_skip
from helpers.server_process import start_server

# Python imports this module of the first folder on its path before anything else.
HIDE = """
import importlib.util, sys
find_spec = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: (
    None if name == "embreex" else find_spec(name, package)
)
sys.modules["embreex"] = None  # an import raises ModuleNotFoundError
"""
CLASS = "USARBot.OmniP2AT"


@pytest.fixture(autouse=True)
def _hide_embreex(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "hidden"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(HIDE)
    monkeypatch.setenv("PYTHONPATH", str(folder))


def test_server_without_embreex_serves_frames_by_raster(tmp_path: Path) -> None:
    device_or_skip().close()
    with (
        start_server(tmp_path, "--renderer", "auto", world=FIELD) as server,
        server.connect_robot() as robot,
        server.connect_images() as images,
    ):
        robot.spawn(CLASS, start_pose="Centre")
        images.get_frame()
        assert images.get_frame().rgb.any()
        assert server.terminate() == 0
    log = server.log.read_text()
    assert "the package embreex, which trace needs, is not installed" in log
    assert "Traceback" not in log
