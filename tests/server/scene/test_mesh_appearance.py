"""Colours, textures and lighting of meshes as trimesh reads them, written here and read back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from catoptra_server.world.mesh_files import load_mesh_file
from catoptra_server.world.textures import (
    MeshAppearance,
    Texture,
    no_texture_coordinates,
    read_appearance,
)
from catoptra_server.world.world_description import MeshFile, linear_from_srgb
from helpers.mesh_file_samples import (
    FACES,
    UV,
    export_mesh,
    make_coloured_square,
    make_plain_square,
    make_quadrant_image,
    write_unlit_glb,
    write_unlit_gltf,
)

# Red, green, blue and dark grey at the square's corners.
COLOURS = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [51, 51, 51, 255]])
DARK = 51 / 255


def read(path: Path) -> MeshAppearance:
    """Appearance of the only mesh of a file."""
    (mesh,) = load_mesh_file(MeshFile(path))
    return mesh.appearance


def decode_image(image: object) -> Texture:
    raise AssertionError(f"no mesh here has an image, such as {image}")


def make_colourful_square() -> trimesh.Trimesh:
    mesh = make_plain_square()
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=COLOURS)
    return mesh


@pytest.mark.parametrize(
    ("ending", "dark"), [("glb", DARK), ("ply", float(linear_from_srgb(np.array(DARK))))]
)
def test_colours_at_vertices_are_linear_at_the_corners(
    tmp_path: Path, ending: str, dark: float
) -> None:
    look = read(export_mesh(make_colourful_square(), tmp_path / f"m.{ending}"))
    linear = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [dark, dark, dark]])
    assert look.corner_albedo is not None
    np.testing.assert_allclose(look.corner_albedo, linear[FACES], atol=1e-12)
    np.testing.assert_allclose(look.albedo, linear[FACES].mean(axis=1), atol=1e-12)


def test_one_colour_at_all_vertices_makes_no_corner_colours(tmp_path: Path) -> None:
    look = read(export_mesh(make_coloured_square(), tmp_path / "m.ply"))
    assert look.corner_albedo is None
    np.testing.assert_array_equal(look.albedo, [[1.0, 0, 0], [1, 0, 0]])


def test_corner_colours_follow_the_winding_of_a_mirrored_copy(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(make_colourful_square(), transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    (mesh,) = load_mesh_file(MeshFile(export_mesh(scene, tmp_path / "m.glb")))
    assert mesh.appearance.corner_albedo is not None
    # The red vertex, (-1, -1), is at (1, -1) in the copy, which is (1, 1) in SAE.
    is_red = (mesh.appearance.corner_albedo == (1.0, 0.0, 0.0)).all(axis=-1)
    np.testing.assert_allclose(mesh.corners[is_red][:, :2], [[1.0, 1.0]] * 2)


@pytest.mark.parametrize("has_image", [False, True])
def test_colours_at_vertices_multiply_the_material(tmp_path: Path, has_image: bool) -> None:
    material = PBRMaterial(
        baseColorFactor=[1.0, 0.0, 1.0, 1.0],
        baseColorTexture=make_quadrant_image() if has_image else None,
    )
    mesh = make_plain_square()
    mesh.visual = TextureVisuals(uv=UV, material=material)
    mesh.visual.vertex_attributes["color"] = COLOURS.astype(np.uint8)
    look = read(export_mesh(mesh, tmp_path / "m.glb"))
    assert (look.texture is not None) is has_image
    assert look.corner_albedo is not None
    np.testing.assert_allclose(look.corner_albedo[0], [[1, 0, 0], [0, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("colours", "linear"),
    [
        (np.array([[0.25, 0.5, 1.0, 1.0]] * 3, dtype=np.float32), (0.25, 0.5, 1.0)),
        (np.array([[np.nan, -1.0, np.inf, 1.0]] * 3, dtype=np.float32), (0.0, 0.0, 1.0)),
        (np.array([[0, 13107, 65535]] * 3, dtype=np.uint16), (0.0, 0.2, 1.0)),
    ],
    ids=["fractions", "no fractions", "16 bits"],
)
def test_colours_of_any_type_are_fractions(
    colours: np.ndarray, linear: tuple[float, float, float]
) -> None:
    visual = SimpleNamespace(kind="texture", vertex_attributes={"color": colours})
    visual.material = PBRMaterial(baseColorFactor=[1.0, 1.0, 1.0, 1.0])
    look = read_appearance(
        SimpleNamespace(visual=visual), np.array([[0, 1, 2]]), decode_image, is_gltf=True
    )
    np.testing.assert_allclose(look.albedo, [linear], atol=1e-7)


@pytest.mark.parametrize("write", [write_unlit_glb, write_unlit_gltf], ids=["glb", "gltf"])
def test_material_without_lights_is_unlit_and_keeps_its_colour(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    meshes = load_mesh_file(MeshFile(write(tmp_path)))
    assert sorted((mesh.appearance.unlit, mesh.appearance.albedo[0, 0]) for mesh in meshes) == [
        (False, pytest.approx(0.0)),
        (True, pytest.approx(1.0)),
    ]


def test_file_without_the_extension_is_lit(tmp_path: Path) -> None:
    assert not read(export_mesh(make_coloured_square(), tmp_path / "m.glb")).unlit


def test_texture_coordinates_of_a_plain_mesh_take_no_memory() -> None:
    uv = no_texture_coordinates(10**9)
    assert uv.shape == (10**9, 3, 2)
    assert uv.strides == (0, 0, 0)
