"""The example program that draws the README's first picture, against a server process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from catoptra_client.frame import rgb_from_image_bytes
from helpers.configs import REPOSITORY
from helpers.server_process import DEADLINE_S, start_server

PROGRAM = REPOSITORY / "examples/first_look.py"
PICTURE = REPOSITORY / "docs/first-look.png"


def test_program_draws_the_picture_of_the_readme(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    with start_server(tmp_path, robot=PROGRAM.with_suffix(".ini")) as server:
        drawn = subprocess.run(
            [sys.executable, str(PROGRAM), str(path), "--port", str(server.stream_port)],
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
            check=False,
        )
    assert drawn.returncode == 0, drawn.stderr
    assert "640 x 640 px" in drawn.stdout
    assert "4^2 samples" in drawn.stdout
    picture, committed = (rgb_from_image_bytes(p.read_bytes()) for p in (path, PICTURE))
    assert picture.shape == committed.shape
    # Kernels for other instructions round differently: a sample at an edge is another one, a node
    # of hidden sky a byte darker. 0.056 levels with the AVX2 kernel.
    assert np.mean(np.abs(picture.astype(int) - committed)) < 0.1


def test_picture_is_small_enough_for_a_page() -> None:
    assert PICTURE.stat().st_size < 300_000
