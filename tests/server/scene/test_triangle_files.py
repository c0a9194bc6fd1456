"""Binary PLY and STL files, against trimesh; all other files are left to trimesh."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from catoptra_server.world.mesh_files import read_triangle_file
from helpers.mesh_file_samples import export_mesh, make_coloured_square, make_plain_square

HEADER = (
    "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
    "property float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]], dtype="<f4")
FACE = b"\x03" + np.array([0, 1, 2], dtype="<i4").tobytes()
BODY = VERTICES.tobytes() + FACE


def write(folder: Path, header: str = HEADER, body: bytes = BODY) -> Path:
    path = folder / "m.ply"
    path.write_bytes(header.encode() + body)
    return path


@pytest.mark.parametrize("make", [make_plain_square, make_coloured_square])
def test_ply_has_the_triangles_and_colours_that_trimesh_reads(
    tmp_path: Path, make: Callable[[], trimesh.Trimesh]
) -> None:
    path = export_mesh(make(), tmp_path / "m.ply")
    mesh, expected = read_triangle_file(path), trimesh.load_mesh(path, process=False)
    assert mesh is not None
    np.testing.assert_array_equal(mesh.vertices, expected.vertices)
    np.testing.assert_array_equal(mesh.faces, expected.faces)
    assert mesh.visual.kind == expected.visual.kind
    if mesh.visual.vertex_colors is not None:
        np.testing.assert_array_equal(
            mesh.visual.vertex_colors, expected.visual.vertex_colors[:, :3]
        )


def test_stl_has_the_triangles_that_trimesh_reads(tmp_path: Path) -> None:
    path = export_mesh(make_plain_square(), tmp_path / "m.stl")
    mesh, expected = read_triangle_file(path), trimesh.load_mesh(path, process=False)
    assert mesh is not None
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], expected.vertices[expected.faces])
    assert mesh.visual.kind is None


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("end_header", "comment made by hand\nobj_info 7\nend_header"),
        ("float z", "float32 z\nproperty float nx"),
        ("uchar int vertex_indices", "uint8 uint vertex_index"),
    ],
)
def test_variants_of_a_header_are_read(tmp_path: Path, old: str, new: str) -> None:
    body = BODY
    if "nx" in new:
        body = np.concatenate((VERTICES, np.zeros((3, 1), "<f4")), axis=1).tobytes() + FACE
    mesh = read_triangle_file(write(tmp_path, HEADER.replace(old, new), body))
    assert mesh is not None
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("binary_little_endian", "ascii"),
        ("binary_little_endian", "binary_big_endian"),
        ("element vertex 3", "element vertex 4"),
        ("element vertex 3", "element vertex -3"),
        ("element vertex 3", "element vertex 99999999999999999999"),
        ("element vertex 3", "element vertex x"),
        ("element face 1", "element face 0"),
        ("element face", "element edge"),
        ("property float z\n", ""),
        ("float z", "float z\nproperty float s"),
        ("float z", "int z"),
        ("float z", "quaternion z"),
        ("float z", "float x"),
        ("uchar int", "int int"),
        ("uchar int", "uchar short"),
        ("vertex_indices", "texcoord"),
        ("vertex_indices", "vertex_indices\nproperty uchar red"),
        ("end_header", "comment TextureFile t.png\nend_header"),
        ("end_header\n", ""),
        ("ply\n", "play\n"),
        ("ply\n", "ply" + 200 * "\n"),
    ],
)
def test_other_headers_are_left_to_trimesh(tmp_path: Path, old: str, new: str) -> None:
    assert old in HEADER
    assert read_triangle_file(write(tmp_path, HEADER.replace(old, new, 1))) is None


@pytest.mark.parametrize(
    "body",
    [
        BODY[:-1],
        BODY + b"\0",
        VERTICES.tobytes() + b"\x04" + FACE[1:],
        VERTICES.tobytes() + FACE[:-4] + b"\x03\0\0\0",
        VERTICES.tobytes() + FACE[:-4] + b"\xff\xff\xff\xff",
    ],
    ids=["truncated", "longer", "quadrilateral", "vertex 3 of 3", "vertex -1"],
)
def test_damaged_ply_is_left_to_trimesh(tmp_path: Path, body: bytes) -> None:
    assert read_triangle_file(write(tmp_path, body=body)) is None


@pytest.mark.parametrize("length", [0, 10, 83, 84, 133, 135])
def test_damaged_stl_is_left_to_trimesh(tmp_path: Path, length: int) -> None:
    path = tmp_path / "m.stl"
    path.write_bytes((b"\0" * 80 + b"\x01\0\0\0" + b"\0" * 100)[:length])
    assert read_triangle_file(path) is None


@pytest.mark.parametrize("name", ["m.obj", "m.glb", "m.dae", "m.gltf"])
def test_other_formats_are_left_to_trimesh(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(HEADER.encode() + BODY)
    assert read_triangle_file(tmp_path / name) is None
