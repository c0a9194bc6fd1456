"""`catoptra-server map`: a picture of a world from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from catoptra_server.__main__ import main
from helpers.configs import WORLDS
from helpers.mesh_features import Gltf, pbr, png


def draw(tmp_path: Path, world: str, *options: str) -> np.ndarray:  # type: ignore[type-arg] # (h, w, 3) uint8
    out = tmp_path / "plan.png"
    assert main(["map", world, "--out", str(out), "--size", "300", *options]) == 0
    return np.asarray(Image.open(out))


def test_map_has_free_floor_obstacles_landmarks_and_starts(tmp_path: Path) -> None:
    rgb = draw(tmp_path, "four_legged_2006").astype(int)
    red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    assert (green > red + 20).sum() > 5000  # free
    assert ((red < 85) & (blue < 100)).sum() > 300  # walls
    assert ((red > 190) & (green < 90) & (blue < 40)).sum() > 20  # starts
    assert ((red > 200) & (green < 60) & (blue > 120)).sum() > 20  # magenta of the beacons
    plan = draw(tmp_path, str(WORLDS / "four_legged_2006.ini"))
    np.testing.assert_array_equal(plan, rgb)


def test_world_with_an_opacity_in_a_texture_has_a_map(tmp_path: Path) -> None:
    document = Gltf(**pbr(texture=0, alphaMode="MASK", doubleSided=True))
    rgba = np.tile(np.uint8((0, 0, 255, 255)), (4, 4, 1))
    assert draw(tmp_path, str(document.texture(png(rgba)).write(tmp_path))).any()


def test_map_of_an_empty_robot_name_or_format_is_rejected_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (
        ["four_legged", "--out", str(tmp_path / "a.png")],
        ["corridor", "--out", str(tmp_path / "a.png"), "--robot", "p2at_omny"],
    ):
        with pytest.raises(SystemExit) as ended:
            main(["map", *words])
        assert ended.value.code == 2
    for path in (tmp_path / "a.xyz", tmp_path / "none" / "a.png"):
        assert main(["map", "corridor", "--out", str(path)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert "did you mean four_legged_2006?" in lines[0]
