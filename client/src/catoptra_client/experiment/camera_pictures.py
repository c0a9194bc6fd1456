"""The camera's own pictures for the report: drawn by the server's command, or by someone else.

Where the server is not installed, as in the client's container, whoever has it draws them into the
output folder; figures.json is written last and says that they are there.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Any

from catoptra_client.experiment.report import Picture
from catoptra_client.experiment.session import Plan
from catoptra_protocol.errors import CatoptraError

Pictures = tuple[list[Picture], dict[str, Any]]

_AGAIN_AFTER_S = 0.2


class Drawing(Enum):
    """Who draws the pictures of the camera."""

    HERE = "here"
    ELSEWHERE = "elsewhere"
    NOBODY = "nobody"


def camera_pictures(plan: Plan, drawing: Drawing) -> Pictures:
    """Return the pictures that are in the plan's output, and the numbers that go with them."""
    match drawing:
        case Drawing.HERE:
            _draw(plan)
        case Drawing.ELSEWHERE:
            _await(plan.output / "figures.json", patience_s=plan.patience_s)
        case Drawing.NOBODY:
            return [], {}
    return read_pictures(plan.output)


def read_pictures(folder: Path) -> Pictures:
    """Return what figures.json of a folder lists."""
    drawn = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    return [_picture(entry) for entry in drawn["figures"]], drawn["numbers"]


def _picture(entry: dict[str, str]) -> Picture:
    title = f"{entry['title']} (the paper's {entry['figure']})"
    return Picture(entry["file"], title, entry["caption"], entry["alt"])


def _draw(plan: Plan) -> None:
    """Have the server's own command draw faces, cube, mirrors and comparisons."""
    command = [
        *(sys.executable, "-m", "catoptra_server.figures", "--output", str(plan.output)),
        *("--robot", str(plan.robot_file("p2at_omni.ini")), "--world", str(plan.world)),
        *("--rings-world", str(plan.world_file("incidence_rings.ini"))),
    ]
    if subprocess.run(command, check=False).returncode != 0:
        raise CatoptraError("the pictures of the camera could not be drawn: see the lines above")


def _await(
    file: Path,
    *,
    patience_s: float,
    clock: Callable[[], float] = time.monotonic,
    rest: Callable[[float], None] = time.sleep,
) -> None:
    deadline_s = clock() + patience_s
    while not (file.is_file() and file.stat().st_size):
        if clock() >= deadline_s:
            raise CatoptraError(
                f"nobody drew the pictures of the camera: {file} did not come within "
                f"{patience_s:g} s. Draw them with python -m catoptra_server.figures, or leave "
                "them out: --pictures nobody"
            )
        rest(_AGAIN_AFTER_S)
