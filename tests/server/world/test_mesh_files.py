"""Mesh files of every format, written here and read back; binary PLY and STL against trimesh."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.world_file import read_world
from catoptra_server.runtime.memory import MIB, MemoryBudget
from catoptra_server.world.mesh_files import MeshPart, read_triangle_file
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.textures import linear_light
from catoptra_server.world.world_description import MeshFile
from helpers.loaded_files import load_mesh_file
from helpers.mesh_file_samples import (
    export_mesh,
    make_announcing_png,
    make_coloured_square,
    make_plain_square,
    make_textured_square,
    write_gltf_with_image_file,
    write_textured_dae,
    write_textured_gltf,
    write_tinted_dae,
    write_tinted_glb,
    write_tinted_obj,
)

RED = (1.0, 0.0, 0.0)
# Byte 188 of 255 in sRGB is half the light; in glTF bytes are light itself.
HALF = 188
HALF_OF_SRGB = 0.50288


def load(path: Path, *, scale: float = 1.0, up: str = "z") -> MeshPart:
    """The only mesh of a file."""
    (mesh,) = load_mesh_file(MeshFile(path, scale, up))
    return mesh


def normal(mesh: MeshPart) -> np.ndarray:
    a, b, c = mesh.corners[0]
    cross: np.ndarray = np.cross(b - a, c - a)
    return cross / np.linalg.norm(cross)


@pytest.mark.parametrize("ending", ["glb", "obj", "ply", "stl", "dae"])
def test_square_of_any_format_is_two_triangles_facing_up(tmp_path: Path, ending: str) -> None:
    mesh = load(export_mesh(make_plain_square(), tmp_path / f"square.{ending}"))
    assert mesh.corners.shape == (2, 3, 3)
    np.testing.assert_allclose(normal(mesh), (0.0, 0.0, -1.0), atol=1e-12)
    assert mesh.appearance.texture is None


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: export_mesh(make_textured_square(pbr=True), folder / "m.glb"),
        lambda folder: export_mesh(make_textured_square(), folder / "m.obj"),
        write_textured_gltf,
        write_textured_dae,
    ],
    ids=["glb", "obj", "gltf", "dae"],
)
def test_texture_of_a_file_is_unmirrored_and_times_its_colour(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    mesh = load(path := write(tmp_path))
    assert mesh.appearance.texture is not None
    assert mesh.appearance.texture[:, :, 0].tolist() == [[255, 0], [0, 255]]
    # trimesh writes Kd 0.4 to MTL files.
    albedo = linear_light(np.array([0.4] * 3))[0] if path.suffix == ".obj" else 1.0
    np.testing.assert_array_equal(mesh.appearance.albedo, albedo)
    # The image's bottom left corner, (0, 1), is the square's (-1, -1), which is (-1, 1) in SAE.
    corner = (mesh.corners[..., :2] == (-1.0, 1.0)).all(axis=-1)
    np.testing.assert_array_equal(
        mesh.appearance.uv[corner], np.tile([0.0, 1.0], (corner.sum(), 1))
    )


@pytest.mark.parametrize("ending", ["glb", "ply", "obj"])
def test_vertex_colours_of_a_file_become_face_colours(tmp_path: Path, ending: str) -> None:
    mesh = load(export_mesh(make_coloured_square(), tmp_path / f"m.{ending}"))
    np.testing.assert_allclose(mesh.appearance.albedo, (RED, RED), atol=1e-12)


@pytest.mark.parametrize(
    ("write", "albedo"),
    [
        (write_tinted_glb, HALF / 255.0),
        (write_tinted_obj, HALF_OF_SRGB),
        (write_tinted_dae, HALF_OF_SRGB),
    ],
    ids=["glb is linear", "obj is sRGB", "dae is sRGB"],
)
def test_colour_of_a_material_is_linear_light(
    tmp_path: Path, write: Callable[[Path, int], Path], albedo: float
) -> None:
    mesh = load(write(tmp_path, HALF))
    assert mesh.appearance.texture is None
    # Formats keep bytes or three digits.
    np.testing.assert_allclose(mesh.appearance.albedo[0], (albedo, 0.0, 0.0), atol=2e-3)


def test_mesh_without_a_colour_is_mid_grey(tmp_path: Path) -> None:
    np.testing.assert_array_equal(
        load(export_mesh(make_plain_square(), tmp_path / "m.stl")).appearance.albedo, 0.5
    )


def test_scaled_mesh_is_in_metres(tmp_path: Path) -> None:
    mesh = load(export_mesh(make_plain_square(), tmp_path / "m.stl"), scale=0.001)
    assert np.ptp(mesh.corners[..., 0]) == pytest.approx(0.002)


@pytest.mark.parametrize(
    ("up", "point", "in_sae"),
    [
        ("z", (1.0, 2.0, 3.0), (1.0, -2.0, -3.0)),  # x forward, y left, z up
        ("y", (1.0, 2.0, 3.0), (-3.0, 1.0, -2.0)),  # x right, y up, z backwards
    ],
)
def test_mesh_is_rotated_into_sae_by_its_up_axis(
    tmp_path: Path, up: str, point: tuple[float, ...], in_sae: tuple[float, ...]
) -> None:
    corners = np.array([point, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    mesh = trimesh.Trimesh(corners, [[0, 1, 2]], process=False)
    turned = load(export_mesh(mesh, tmp_path / "m.ply"), up=up).corners[0, 0]
    np.testing.assert_allclose(turned, in_sae, atol=1e-12)


def test_node_transforms_of_a_scene_apply(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for x in (0.0, 10.0):
        scene.add_geometry(
            make_plain_square(), transform=trimesh.transformations.translation_matrix((x, 0, 0))
        )
    meshes = load_mesh_file(MeshFile(export_mesh(scene, tmp_path / "m.glb"), up="z"))
    assert sorted(mesh.corners[..., 0].mean().round(6) for mesh in meshes) == pytest.approx(
        [-1 / 3, 10 - 1 / 3], abs=0.4
    )


@pytest.mark.parametrize("ending", ["glb", "gltf", "obj", "ply", "stl", "dae"])
@pytest.mark.parametrize(
    "content",
    [b"", b"garbage\n" * 20, bytes(range(256)) * 4, b"\x00" * 100, b"{}", b"<xml"],
    ids=["empty", "text", "bytes", "zeros", "json", "xml"],
)
def test_file_without_a_mesh_is_rejected_by_name(
    tmp_path: Path, ending: str, content: bytes
) -> None:
    path = tmp_path / f"m.{ending}"
    path.write_bytes(content)
    with pytest.raises(
        ConfigError, match=rf"m\.{ending}: File=.*expected a (readable mesh|mesh with)"
    ):
        load_mesh_file(MeshFile(path))


@pytest.mark.parametrize("ending", ["glb", "ply", "stl", "dae"])
def test_truncated_file_is_rejected(tmp_path: Path, ending: str) -> None:
    path = export_mesh(make_coloured_square(), tmp_path / f"m.{ending}")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ConfigError, match="expected a"):
        load_mesh_file(MeshFile(path))


@pytest.mark.parametrize("name", ["m.xyz", "m", "m.png", "m.zip", "m.zae", "m.tar.gz", "m.3dxml"])
def test_file_of_an_unknown_format_is_rejected_by_its_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("1 2 3\n")
    with pytest.raises(ConfigError, match=r"a mesh file of a known format: \.glb"):
        load_mesh_file(MeshFile(path))


def test_missing_file_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="a mesh file that exists"):
        load_mesh_file(MeshFile(tmp_path / "m.glb"))


@pytest.mark.parametrize("bad", ["nan 0 0", "inf 0 0", "0 -inf 0", "1e300 0 0"])
def test_triangles_without_a_finite_position_are_dropped_and_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, bad: str
) -> None:
    path = tmp_path / "m.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nv {bad}\nf 1 2 3\nf 1 2 4\n")
    assert len(load(path).corners) == 1
    (record,) = caplog.records
    assert (
        "m.obj: left out 1 of 2 triangles with a corner beyond 1e+06 m or no number"
        in record.getMessage()
    )
    assert record.getMessage().endswith("the first is number 1")


@pytest.mark.parametrize("form", ["gltf", "obj"])
def test_missing_image_of_a_mesh_is_an_error_or_a_message(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, form: str
) -> None:
    if form == "gltf":
        path = write_gltf_with_image_file(tmp_path, "paint.png")
    else:
        path = tmp_path / "m.obj"
        (tmp_path / "m.mtl").write_text("newmtl 0\nmap_Kd paint.png\n")
        vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
        path.write_text(f"mtllib m.mtl\nusemtl 0\n{vertices}f 1/1 2/2 3/3\n")
    reason = rf"material 0='paint\.png': expected a file inside {tmp_path}; MissingTextures=grey"
    with pytest.raises(ConfigError, match=reason):
        load_mesh_file(MeshFile(path))
    (mesh,) = load_mesh_file(MeshFile(path, has_optional_textures=True))
    assert mesh.appearance.texture is not None
    assert mesh.appearance.texture.tolist() == [[[188, 188, 188]]]
    assert [r.getMessage() for r in caplog.records if r.name.startswith("catoptra")] == [
        f"{path}: missing paint.png: material 0 is drawn without (once)"
    ]


@pytest.mark.parametrize("bad", ["nan 0", "inf 1", "1e30 0"])
def test_triangles_without_finite_texture_coordinates_are_dropped_and_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, bad: str
) -> None:
    path = export_mesh(make_textured_square(), tmp_path / "m.obj")
    lines = path.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("vt "))
    lines[first + 1] = f"vt {bad}"
    path.write_text("\n".join(lines))
    kept = load(path)
    assert len(kept.corners) == 1
    assert np.isfinite(kept.appearance.uv).all()
    assert any("texture coordinates that are no finite" in r.getMessage() for r in caplog.records)


@pytest.mark.parametrize("scale", [1.0, 1e-170, 1e-3])
def test_triangles_without_area_are_dropped_at_any_scale(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, scale: float
) -> None:
    path = tmp_path / "m.obj"
    path.write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv 1e-6 1e-6 0\n"
        "f 1 2 3\nf 1 2 4\nf 1 1 2\nf 2 2 2\nf 1 2 5\n"
    )
    assert len(load(path, scale=scale).corners) == 2
    assert not caplog.records


def test_square_with_one_texture_coordinate_shows_that_texel(tmp_path: Path) -> None:
    path = export_mesh(make_textured_square(), tmp_path / "m.obj")
    lines = path.read_text().splitlines()
    path.write_text("\n".join("vt 0.25 0.75" if x.startswith("vt ") else x for x in lines))
    mesh = load(path)
    assert len(mesh.corners) == 2
    assert np.ptp(mesh.appearance.uv, axis=(0, 1)).tolist() == [0.0, 0.0]


def write_glb(folder: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """The plain square as glTF with its JSON changed."""
    path = export_mesh(make_plain_square(), folder / "m.glb")
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    header = json.loads(data[20 : 20 + length])
    change(header)
    text = json.dumps(header).encode()
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + data[20 + length :]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def announce_zeros(header: dict[str, Any]) -> None:
    for accessor in header["accessors"]:
        accessor.pop("bufferView")
        accessor["count"] = 3 * 10**9


def test_accessor_that_announces_gigabytes_is_rejected_unread(tmp_path: Path) -> None:
    path = write_glb(tmp_path, announce_zeros)
    with pytest.raises(ConfigError, match=r"m\.glb: File=.*fewer or smaller accessors.* MiB"):
        load_mesh_file(MeshFile(path))


def repeat_node(header: dict[str, Any]) -> None:
    """Show the mesh at a thousand nodes."""
    (mesh_node,) = (node for node in header["nodes"] if "mesh" in node)
    first = len(header["nodes"])
    header["nodes"] += [{"mesh": mesh_node["mesh"], "name": f"n{n}"} for n in range(1000)]
    header["scenes"][0]["nodes"] = list(range(first, first + 1000))


def test_instances_of_a_mesh_count_each(tmp_path: Path) -> None:
    path = write_glb(tmp_path, repeat_node)
    assert len(load_mesh_file(MeshFile(path))) == 1000
    with pytest.raises(
        ConfigError, match=r"m\.glb: File='mesh .* of 2 triangles'.*fewer triangles"
    ):
        load_mesh_file(MeshFile(path), MemoryBudget(MIB))


@pytest.mark.parametrize("ending", ["obj", "ply", "stl", "dae", "glb"])
def test_file_larger_than_the_memory_limit_is_rejected_unread(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"m.{ending}"
    with path.open("wb") as file:
        file.truncate(40 * 10**9)  # sparse: takes no space on the disk
    with pytest.raises(ConfigError, match=r"File='40000000000 bytes'.*a smaller mesh file"):
        load_mesh_file(MeshFile(path))


@pytest.mark.parametrize(
    "write",
    [lambda folder: export_mesh(make_textured_square(), folder / "m.obj"), write_textured_dae],
    ids=["obj", "dae"],
)
def test_image_of_a_mesh_that_announces_gigabytes_is_rejected_undecoded(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    path = write(tmp_path)
    (image_path,) = tmp_path.glob("*.png")
    image_path.write_bytes(make_announcing_png(12_000, 12_000))
    with pytest.raises(ConfigError, match=r"\.png: Texture='12000 x 12000 px'.* MiB"):
        load_mesh_file(MeshFile(path))


def test_mirrored_copy_of_a_mesh_faces_the_same_side(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(make_plain_square(), transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    mesh = load(export_mesh(scene, tmp_path / "m.glb"))
    np.testing.assert_allclose(normal(mesh), (0.0, 0.0, -1.0), atol=1e-12)


def test_triangles_beyond_every_world_are_dropped_and_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    mesh = make_plain_square()
    mesh.vertices[3] = (2e6, 0.0, 0.0)
    loaded = load(export_mesh(mesh, tmp_path / "m.obj"))
    assert len(loaded.corners) == 1
    assert "left out 1 of 2 triangles" in caplog.text


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
    assert (mesh.colours is not None) == (expected.visual.kind == "vertex")
    if mesh.colours is not None:
        np.testing.assert_array_equal(mesh.colours, linear_light(expected.visual.vertex_colors))


def test_stl_has_the_triangles_that_trimesh_reads(tmp_path: Path) -> None:
    path = export_mesh(make_plain_square(), tmp_path / "m.stl")
    mesh, expected = read_triangle_file(path), trimesh.load_mesh(path, process=False)
    assert mesh is not None
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], expected.vertices[expected.faces])
    assert mesh.colours is mesh.face_colours is None


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


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_file_of_points_alone_is_rejected_as_such(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"points{suffix}"
    cloud = trimesh.PointCloud(np.random.default_rng(0).random((50, 3)))
    trimesh.Scene(cloud).export(path) if suffix == ".glb" else cloud.export(path)
    with pytest.raises(ConfigError, match="a mesh with triangles: this file has none"):
        load_mesh_file(MeshFile(path))


@pytest.mark.parametrize("ending", ["glb", "obj", "dae"])
def test_file_is_read_once_for_all_of_its_scales_and_axes(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = export_mesh(make_plain_square(), tmp_path / f"m.{ending}")
    places = ("", "Scale=2", "Scale=3,Up=z", "Scale=(X=1,Y=-1,Z=1)", "Scale=2")
    lines = (f"Meshes=(File={file.name},{place})" for place in places)
    (tmp_path / "w.ini").write_text("\n".join(("[Catoptra.World]", *lines)))
    reads, parse, read = Counter[str](), json.loads, Path.read_bytes

    def count(name: str, value: Any) -> Any:
        reads[name] += 1
        return value

    monkeypatch.setattr(Path, "read_bytes", lambda path: count(path.name, read(path)))
    # Not what libraries parse with hooks of their own.
    monkeypatch.setattr(
        json,
        "loads",
        lambda text, **hooks: count("" if hooks else file.name, parse(text, **hooks)),
    )
    scene = build_scene(read_world(tmp_path / "w.ini")[0])
    assert reads[file.name] == 1
    assert len(scene.objects) == len(places)
    each = [scene.corners[scene.item_index == index] for index in range(len(places))]
    sizes = np.array([float(np.ptp(corners, axis=(0, 1)).max()) for corners in each])
    np.testing.assert_allclose(sizes / sizes[0], (1.0, 2.0, 3.0, 1.0, 2.0), atol=1e-6)
