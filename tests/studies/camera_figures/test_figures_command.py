from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import cv2
import pytest

from catoptra_studies.camera_figures.figure_spec import FigureInputs, write_figures
from catoptra_studies.camera_figures.figures_command import FIGURES
from catoptra_studies.cli import main
from catoptra_studies.commands import open_progress
from helpers.configs import FIELD, OMNI_ROBOT, WORLDS

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_BYTES = 300_000


@pytest.fixture(scope="module")
def folder(inputs: FigureInputs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("figures") / "new"
    with open_progress(is_visible=False) as progress:
        write_figures(FIGURES, inputs, output, progress)
    return output


@pytest.fixture(scope="module")
def index(folder: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    return read


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.file)
def test_figure_is_a_png_of_its_page_below_the_limit(folder: Path, figure: Any) -> None:
    data = (folder / figure.file).read_bytes()

    assert data.startswith(PNG_SIGNATURE)
    assert len(data) < MAX_BYTES
    pixels = cv2.imread(str(folder / figure.file))
    assert pixels.shape[:2] == (figure.height_px, figure.width_px)
    assert pixels.std() > 10.0  # something is drawn


def test_index_has_every_figure_in_order(index: dict[str, Any]) -> None:
    assert [entry["file"] for entry in index["figures"]] == [figure.file for figure in FIGURES]
    assert list(index["metrics"]) == [Path(figure.file).stem for figure in FIGURES]
    for entry in index["figures"]:
        assert all(entry[key].strip() for key in ("paper_reference", "title", "caption", "alt"))


def test_every_decimal_number_of_a_caption_is_a_metric(index: dict[str, Any]) -> None:
    for entry in index["figures"]:
        numbers = index["metrics"][Path(entry["file"]).stem].values()
        for text in re.findall(r"\d+\.\d+", entry["caption"]):
            rounding = 0.5 * 10.0 ** -len(text.partition(".")[2])
            assert any(abs(float(text) - n) <= 1.01 * rounding for n in numbers), entry["caption"]


def test_figure_10_has_both_maps_and_says_which_one_is_not_the_papers(
    index: dict[str, Any],
) -> None:
    worlds = [name.partition(":")[0] for name in index["timings"]["frame_rates"]]
    assert list(dict.fromkeys(worlds)) == ["DM-spqrSoccer2006_250", "corridors-and-rooms"]
    (entry,) = (one for one in index["figures"] if one["paper_reference"] == "Figure 10")
    assert "DM-Mapping_250. The latter is not available here" in entry["caption"]
    assert "load by other programs" in entry["caption"]


def test_exact_model_is_exact_to_the_rounding_of_its_rays(index: dict[str, Any]) -> None:
    # Unit vectors in float32 are good to 2^-24 = 6e-8; times up to 210 px a radian at the rim.
    assert 0.0 < index["metrics"]["polygon_error"]["exact_model_max_px"] < 2e-5


def test_robot_file_when_missing_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, robot=tmp_path / "absent.ini") == 1
    assert "absent.ini" in capsys.readouterr().err


def test_robot_without_a_camera_is_rejected_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = OMNI_ROBOT.read_text(encoding="utf-8")
    blind = tmp_path / "blind.ini"
    blind.write_text(re.sub(r"(?m)^(?:StaticMeshes|CamTexActors|Cameras)=.*\n", "", text))

    assert run(tmp_path, robot=blind) == 1
    assert "no omnidirectional camera" in capsys.readouterr().err


def run(folder: Path, *, robot: Path) -> int:
    worlds = [
        "--world",
        str(FIELD),
        "--rooms-world",
        str(WORLDS / "corridors_and_rooms.ini"),
        "--rings-world",
        str(WORLDS / "incidence_rings.ini"),
    ]
    return main(["figures", "--robot", str(robot), *worlds, "--out", str(folder)])
