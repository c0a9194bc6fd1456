from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import cv2
import pytest
from catoptra_studies.camera_figures.figure_subject import FigureSubject
from rich.console import Console
from rich.progress import Progress

from catoptra_studies.camera_figures.figures_command import (
    EXIT_FAILURE,
    FIGURES,
    main,
    write_figures,
)
from helpers.configs import FIELD, OMNI_ROBOT, WORLDS

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
LARGEST_BYTES = 300_000


@pytest.fixture(scope="module")
def folder(subject: FigureSubject, tmp_path_factory: pytest.TempPathFactory) -> Path:
    written = tmp_path_factory.mktemp("figures") / "made"
    write_figures(subject, written, Progress(console=Console(quiet=True)))
    return written


@pytest.fixture(scope="module")
def told(folder: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    return read


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.file)
def test_figure_is_a_png_of_its_page_below_the_limit(folder: Path, figure: Any) -> None:
    data = (folder / figure.file).read_bytes()

    assert data.startswith(PNG_SIGNATURE)
    assert len(data) < LARGEST_BYTES
    pixels = cv2.imread(str(folder / figure.file))
    assert pixels.shape[:2] == (figure.height_px, figure.width_px)
    assert pixels.std() > 10.0  # something is drawn


def test_figures_json_tells_of_every_figure_in_order(told: dict[str, Any]) -> None:
    assert [entry["file"] for entry in told["figures"]] == [figure.file for figure in FIGURES]
    assert list(told["numbers"]) == [Path(figure.file).stem for figure in FIGURES]
    for entry in told["figures"]:
        assert all(entry[key].strip() for key in ("figure", "title", "caption", "alt"))


def test_every_decimal_number_of_a_caption_is_told_apart_too(told: dict[str, Any]) -> None:
    for entry in told["figures"]:
        numbers = told["numbers"][Path(entry["file"]).stem].values()
        for text in re.findall(r"\d+\.\d+", entry["caption"]):
            rounding = 0.5 * 10.0 ** -len(text.partition(".")[2])
            assert any(abs(float(text) - n) <= 1.01 * rounding for n in numbers), entry["caption"]


def test_bad_file_ends_with_a_message_and_no_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, robot=tmp_path / "absent.ini") == EXIT_FAILURE
    assert "absent.ini" in capsys.readouterr().err


def test_robot_without_a_camera_is_refused_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = OMNI_ROBOT.read_text(encoding="utf-8")
    blind = tmp_path / "blind.ini"
    blind.write_text(re.sub(r"(?m)^(?:StaticMeshes|CamTexActors|Cameras)=.*\n", "", text))

    assert run(tmp_path, robot=blind) == EXIT_FAILURE
    assert "no omnidirectional camera" in capsys.readouterr().err


def run(folder: Path, *, robot: Path) -> int:
    worlds = ["--world", str(FIELD), "--rings-world", str(WORLDS / "incidence_rings.ini")]
    return main(["--robot", str(robot), *worlds, "--output", str(folder)])
