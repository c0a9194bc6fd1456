"""OBJ and MTL files that are hostile: one line each, before memory is taken."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.world.world_description import MeshFile
from helpers.loaded_files import load_mesh_file

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n"
FACE = "usemtl m\nf 1/1 2/1 3/1\n"


def write(folder: Path, text: str, mtl: str) -> Path:
    (folder / "m.mtl").write_text(mtl)
    (folder / "m.obj").write_text(text)
    return folder / "m.obj"


@pytest.mark.parametrize(
    ("text", "mtl", "reason"),
    [
        (FACE, "newmtl m\nmap_Kd ../secret.png\n", "a file inside"),
        (FACE, "newmtl m\nmap_Kd /etc/passwd\n", "a file inside"),
        (FACE, "newmtl m\nKd red\n", "readable mesh file"),
        (FACE, "newmtl m\nd x\n", "readable mesh file"),
        (FACE, "".join(f"newmtl m{n}\n" for n in range(10**5)), "more than 10000 materials"),
        ("f 1 2 9\n", "", "readable mesh file"),
        ("f 1 2 -9\n", "", "readable mesh file"),
        ("f 1 2 99999999999999999999\n", "", "readable mesh file"),
        ("f a b c\n", "", "readable mesh file|at least one triangle"),
        ("f 1 2\n", "", "readable mesh file|at least one triangle"),
    ],
)
def test_hostile_file_is_rejected_in_one_line(
    tmp_path: Path, text: str, mtl: str, reason: str
) -> None:
    (tmp_path / "secret.png").write_bytes(b"x")
    folder = tmp_path / "model"
    folder.mkdir()
    path = write(folder, "mtllib m.mtl\n" + TRIANGLE + text, mtl)
    with pytest.raises(ConfigError, match=reason) as error:
        load_mesh_file(MeshFile(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("line", "missing"),
    [("Part Studio 1.mtl", "Part Studio 1.mtl"), ("m.mtl Part Studio.MTL", "Part Studio.MTL")],
)
def test_missing_library_is_named_whole(tmp_path: Path, line: str, missing: str) -> None:
    path = write(tmp_path, f"mtllib {line}\n{TRIANGLE}", "newmtl a\n")
    with pytest.raises(ConfigError) as error:
        load_mesh_file(MeshFile(path))
    assert error.value.value == missing
