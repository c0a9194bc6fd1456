"""`catoptra-studies real` on small pictures of our own: the whole study, and what it rejects."""

from __future__ import annotations

import json
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.real.picture_measures import encoded_level, linear_light
from catoptra_studies.real.real_command import main
from catoptra_studies.real.twin import TwinCamera, write_mirror_camera
from helpers.board_pictures import known_poses, write_lens, write_pictures

EFFECTS = (
    "Defocus=always", "DefocusByDepth=always", "FNumber=1.5", "PixelPitch=7.4e-6",
    "FocusDistance=0.3", "ShotNoise=always", "ReadNoise=always", "FullWell=3000",
    "ReadNoiseElectrons=8", "Vignetting=always",
)  # fmt: skip


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with six pictures through a mirror, lit ever more to the rim, and their camera file.

    Defocus, noise and vignetting are in the model; the gradient of light is not.
    """
    folder = tmp_path_factory.mktemp("own")
    lens = TwinCamera(write_lens(folder / "lens.ini", 320), folder, "lens_tripod").camera
    write_mirror_camera(folder / "small.ini", lens, focal_px=200.0, vertex_m=0.1)
    known = write_pictures(folder, folder / "small.ini", known_poses(6), effects=EFFECTS)
    v, u = np.mgrid[:240, :320] + 0.5 - np.array(known.camera.centre_px)[::-1, None, None]
    gain = 1.0 + 0.8 * (u * u + v * v) / known.camera.rim_radius_px**2
    for path in known.folder.iterdir():
        light = linear_light(np.asarray(PillowImage.open(path), np.float64)) * gain[..., None]
        PillowImage.fromarray(np.rint(encoded_level(light)).astype(np.uint8)).save(path)
    return folder


def run(folder: Path, out: Path, camera: Path, *more: str) -> int:
    options = ("--board", "6x5", "--square", "0.05", "--workers", "1", "--out", str(out))
    return main([str(folder), "--camera-file", str(camera), *options, *more])


def test_whole_study_of_six_pictures_writes_report_page_and_camera(
    own: Path, tmp_path: Path
) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- real: begin -->\n<!-- real: end -->\n")
    camera = own / "small.ini"
    more = ("--page", str(page), "--fitted", str(tmp_path / "fitted.ini"),
            "--effects", "defocus", "noise")  # fmt: skip
    assert run(own / "pictures", tmp_path / "out", camera, *more) == 0
    found = json.loads((tmp_path / "out/real.json").read_text())
    assert len(found["check"]) == 6
    for row in found["rows"].values():
        assert all(len(each) == 4 for each in row["closed"].values())
    rows = found["rows"]
    for name in ("edge width 10-90 %, px", "noise of white, grey levels"):
        assert rows[name]["remainder"]["clean twin"][2] < 0.0
    assert rows["noise of white, grey levels"]["closed"]["noise"][0] > 0.8
    assert rows["edge width 10-90 %, px"]["closed"]["defocus"][0] > 0.5

    # The gap of what the model has closes: no difference is in the remainder's interval.
    for name in ("edge width 10-90 %, px", "edge width below 80°, px", "edge width above 95°, px",
                 "noise of white, grey levels", "noise of black, grey levels"):  # fmt: skip
        _, low, high, count = rows[name]["remainder"]["fitted camera"]
        assert low <= 0.0 <= high, name
        assert count == 6
        assert rows[name]["remainder"]["clean twin"][0] < 0.0
    assert rows["colours of squares, Bhattacharyya"]["closed"]["fitted camera"][0] > 0.7
    # What it has not remains: the gradient, beside the lens's vignetting.
    assert rows["light lost at the rim, share"]["remainder"]["fitted camera"][1] > 0.2

    assert "Boards in 6 of 6" in page.read_text()
    assert (tmp_path / "real-twin.jpg").stat().st_size < 300_000
    assert "FNumber" in (tmp_path / "fitted.ini").read_text()
    assert "<table>" in (tmp_path / "out/report.html").read_text()


def copy_pictures(own: Path, folder: Path) -> Path:
    shutil.copytree(own / "pictures", folder)
    return folder


def leave_one_board(folder: Path) -> None:
    for path in sorted(folder.iterdir())[1:]:
        PillowImage.fromarray(np.full((240, 320, 3), 90, np.uint8)).save(path)


def remove_boards(folder: Path) -> None:
    for path in folder.iterdir():
        PillowImage.fromarray(np.full((240, 320, 3), 90, np.uint8)).save(path)


def change_a_size(folder: Path) -> None:
    PillowImage.fromarray(np.zeros((100, 120, 3), np.uint8)).save(folder / "picture3.png")


def change_all_sizes(folder: Path) -> None:
    for path in folder.iterdir():
        PillowImage.open(path).resize((400, 300)).save(path)


def turn_round(folder: Path) -> None:
    for path in folder.iterdir():
        PillowImage.open(path).transpose(PillowImage.Transpose.FLIP_LEFT_RIGHT).save(path)


def add_a_huge_one(folder: Path) -> None:
    """A PNG of 10^9 px by its header alone."""
    header = struct.pack(">IIBBBBB", 40_000, 25_000, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n"
    for chunk in (b"IHDR" + header, b"IDAT" + bytes(8)):
        data += struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (folder / "picture0.png").write_bytes(data)


def break_one(folder: Path) -> None:
    (folder / "picture2.png").write_bytes(b"no picture")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (remove_boards, r"found in 0 of 6 photographs, at least 4"),
        (leave_one_board, r"found in 1 of 6 photographs, at least 4"),
        (change_a_size, r"picture3\.png: 120 x 100 px, but picture0\.png has 320 x 240"),
        (change_all_sizes, r"400 x 300 px, but the camera file has 320 x 240"),
        (turn_round, r"turned round left to right"),
        (add_a_huge_one, r"picture0\.png: more than 67108864 px, which is not decoded"),
        (break_one, r"picture2\.png: no picture that can be read"),
    ],
)
def test_unusable_photographs_are_rejected_in_one_line(
    own: Path, tmp_path: Path, change: Callable[[Path], None], reason: str
) -> None:
    folder = copy_pictures(own, tmp_path / "pictures")
    change(folder)
    with pytest.raises(CatoptraError, match=reason) as caught:
        run(folder, tmp_path / "out", own / "small.ini")
    assert "\n" not in str(caught.value)


def test_folder_without_photographs_is_rejected(own: Path, tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match=r"no photographs"):
        run(tmp_path / "nowhere", tmp_path / "out", own / "small.ini")


@pytest.mark.parametrize(
    ("option", "reason"), [(("--board", "11"), "COLUMNSxROWS"), (("--square", "0"), "a square's")]
)
def test_wrong_board_is_a_mistake_of_the_command_line(
    own: Path, tmp_path: Path, option: tuple[str, str], reason: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    with pytest.raises(SystemExit):
        run(own / "pictures", tmp_path, own / "small.ini", *option)
    assert reason in capsys.readouterr().err
