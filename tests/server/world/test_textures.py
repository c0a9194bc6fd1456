"""Image files and their sizes, levels and footprints of samples, and the appearance of meshes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.runtime.memory import (
    BYTES_PER_TEXEL,
    BYTES_PER_TRIANGLE,
    PEAK_BYTES_PER_TEXEL,
    MemoryBudget,
)
from catoptra_server.world.shading import sample_texture
from catoptra_server.world.textures import (
    MAX_STRETCH,
    MeshAppearance,
    TextureReader,
    build_levels,
    footprint_texels,
    linear_light,
    no_texture_coordinates,
    sample_levels,
    uv_gradients,
    uv_steps,
)
from catoptra_server.world.world_description import MeshFile, linear_from_srgb
from helpers.loaded_files import load_mesh_file, load_texture
from helpers.mesh_file_samples import (
    FACES,
    UV,
    export_mesh,
    make_announcing_png,
    make_coloured_square,
    make_plain_square,
    make_quadrant_image,
    write_unlit_glb,
    write_unlit_gltf,
)

RNG = np.random.default_rng(7)


def make_image(height: int, width: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return RNG.integers(0, 256, (height, width, 3)).astype(np.uint8)


@pytest.mark.parametrize("shape", [(8, 8), (5, 7), (1, 9), (13, 1), (1, 1), (6, 3)])
def test_every_level_has_the_mean_light_of_the_image(shape: tuple[int, int]) -> None:
    image = make_image(*shape)
    mean = linear_from_srgb(image / 255.0).mean(axis=(0, 1))
    kept, *coarser = build_levels(image)
    assert kept is image
    for level in coarser:
        np.testing.assert_allclose(level.mean(axis=(0, 1)), mean, rtol=1e-5)


@pytest.mark.parametrize("shape", [(8, 6, 3), (5, 6, 4), (4, 7, 4)])
def test_levels_are_the_means_of_float32_light_to_the_last_bit(shape: tuple[int, int, int]) -> None:
    image = RNG.integers(0, 256, shape).astype(np.uint8)
    light = linear_from_srgb(image / 255.0).astype(np.float32)
    light[..., 3:] = image[..., 3:] / np.float32(255.0)
    if shape[0] % 2 == 0:
        rows = np.float32(0.5) * (light[0::2] + light[1::2])
    else:
        at = np.arange(2, dtype=np.float32)[:, None, None]
        rows = ((2 - at) * light[0:-2:2] + 2 * light[1:-1:2] + (at + 1) * light[2::2]) / 5
    if shape[1] % 2 == 0:
        expected = np.float32(0.5) * (rows[:, 0::2] + rows[:, 1::2])
    else:
        at = np.arange(3, dtype=np.float32)[:, None]
        parts = (3 - at) * rows[:, 0:-2:2] + 3 * rows[:, 1:-1:2] + (at + 1) * rows[:, 2::2]
        expected = parts / 7
    np.testing.assert_array_equal(build_levels(image)[1], expected.astype(np.float32))


def test_sides_are_halved_and_rounded_down_to_one_texel() -> None:
    sizes = [level.shape[:2] for level in build_levels(make_image(21, 6))]
    assert sizes == [(21, 6), (10, 3), (5, 1), (2, 1), (1, 1)]


def test_texel_of_an_odd_side_is_the_mean_of_the_part_that_it_covers() -> None:
    image = make_image(5, 1)
    rows = linear_from_srgb(image / 255.0)
    # 2.5 old rows each: the third is shared.
    upper = (rows[0] + rows[1] + 0.5 * rows[2]) / 2.5
    np.testing.assert_allclose(build_levels(image)[1][0], upper, rtol=1e-5)


def test_coordinates_of_a_triangle_change_by_its_gradients() -> None:
    corners, uv = RNG.normal(size=(6, 3, 3)), RNG.normal(size=(6, 3, 2))
    gradients = uv_gradients(corners, uv)
    moved = np.einsum("nki,nci->nck", gradients, corners[:, 1:] - corners[:, :1])
    np.testing.assert_allclose(moved, uv[:, 1:] - uv[:, :1], atol=1e-9)
    assert not uv_gradients(np.zeros((1, 3, 3)), uv[:1]).any()


def test_steps_are_the_differences_of_coordinates_where_neighbouring_rays_meet_the_plane() -> None:
    normal = np.array([[0.1, -0.2, -0.9]])
    gradients = RNG.normal(size=(1, 2, 3))
    gradients -= np.einsum("nki,ni->nk", gradients, normal)[..., None] * normal / 0.86
    directions = np.array([[0.6, 0.0, 0.8]])
    beside = 1e-6 * RNG.normal(size=(1, 2, 3))

    def meet(direction: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> np.ndarray:  # type: ignore[type-arg]
        return 2.0 * (normal @ directions[0]) / (normal @ direction) * direction

    expected = [
        gradients[0] @ (meet(directions[0] + beside[0, side]) - meet(directions[0]))
        for side in range(2)
    ]
    found = uv_steps(gradients, normal, np.array([2.0]), directions, beside)
    # The second derivative, over steps of a millionth.
    np.testing.assert_allclose(found[0], expected, atol=1e-10)


def test_footprint_of_a_square_is_its_side_whatever_its_direction() -> None:
    turned = 0.01 * np.array([[[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] for a in (0, 1, 2)])
    np.testing.assert_allclose(footprint_texels(turned, (300, 300)), 3.0)


@pytest.mark.parametrize(("stretch", "expected"), [(2.0, 2.0), (50.0, MAX_STRETCH)])
def test_longer_axis_counts_up_to_a_multiple_of_the_shorter(
    stretch: float, expected: float
) -> None:
    steps = np.array([[[stretch, 0.0], [0.0, 1.0]]]) / 64.0
    np.testing.assert_allclose(footprint_texels(steps, (64, 64)), expected)


def test_small_footprint_reads_the_image_itself() -> None:
    image, uv = make_image(9, 12), RNG.uniform(-2.0, 2.0, (50, 2))
    sharp = sample_texture(linear_from_srgb(image / 255.0), uv)
    for footprint in (0.0, 0.5, 1.0, 1.5):
        found = sample_levels(build_levels(image), uv, np.full(50, footprint))
        np.testing.assert_allclose(found, sharp, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(
    ("footprint", "fine", "weight"),
    [(2.0, 1, 0.0), (3.0, 1, 0.0), (3.5, 1, 0.5), (4.0, 2, 0.0), (1e9, 3, 0.0)],
)
def test_larger_footprints_read_their_level(footprint: float, fine: int, weight: float) -> None:
    levels, uv = build_levels(make_image(8, 8)), RNG.uniform(-2.0, 2.0, (50, 2))
    one, other = (
        sample_texture(levels[min(n, 3)].astype(np.float64), uv) for n in (fine, fine + 1)
    )
    found = sample_levels(levels, uv, np.full(50, footprint))
    np.testing.assert_allclose(found, (1.0 - weight) * one + weight * other, atol=1e-6)


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "CMYK", "1", "I;16"])
def test_texture_of_any_mode_is_rgb(tmp_path: Path, mode: str) -> None:
    path = tmp_path / ("q.tif" if mode == "CMYK" else "q.png")
    make_quadrant_image().convert("I" if mode == "I;16" else mode).convert(mode).save(path)
    assert load_texture(path).shape == (2, 2, 3)


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x89PNG\r\n\x1a\n" + bytes(50)])
def test_texture_that_is_no_image_is_rejected_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "q.png"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"q\.png: Texture=.*expected an image file"):
        load_texture(path)


def test_truncated_texture_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "q.png"
    make_quadrant_image().resize((64, 64)).save(path)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ConfigError, match="an image file"):
        load_texture(path)


@pytest.mark.parametrize("side_px", [7000, 13_300, 60_000])
def test_texture_that_announces_gigabytes_is_rejected_undecoded(
    tmp_path: Path, side_px: int
) -> None:
    path = tmp_path / "q.png"
    path.write_bytes(make_announcing_png(side_px, side_px))
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match=r"q\.png: Texture=.*(a smaller image|exceeds limit)"):
            load_texture(path)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_textures_count_together(tmp_path: Path) -> None:
    for number in range(3):
        make_quadrant_image().resize((300, 300 + number)).save(tmp_path / f"{number}.png")
    with TextureReader(MemoryBudget(3 * BYTES_PER_TEXEL * 300 * 301 - 1)) as textures:
        textures.load(tmp_path / "0.png")
        textures.load(tmp_path / "1.png")
        with pytest.raises(ConfigError, match=r"'300 x 302 px'.*3 MiB"):
            textures.load(tmp_path / "2.png")


def test_textures_of_a_large_house_fit_beside_its_triangles() -> None:
    with TextureReader(has_texels=False) as textures:
        for number in range(87):
            image = make_announcing_png(1024, 1024) + bytes([number])
            textures.decode(image, SourceLocation("house"))
        house = 146_448 * BYTES_PER_TRIANGLE
        textures.memory.reserve(
            house, where=SourceLocation("house"), key="Mesh", value="", remedy=""
        )


def test_texture_that_is_decoded_in_more_memory_than_there_is_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "q.png"
    path.write_bytes(make_announcing_png(300, 300))
    with (
        TextureReader(MemoryBudget(PEAK_BYTES_PER_TEXEL * 300 * 300 - 1)) as textures,
        pytest.raises(ConfigError, match=r"'300 x 300 px'.*a smaller image"),
    ):
        textures.load(path)


def test_image_is_held_and_counted_once_under_all_names_of_its_content(tmp_path: Path) -> None:
    for name in ("q.png", "r.png"):
        make_quadrant_image().resize((300, 300)).save(tmp_path / name)
    (tmp_path / "link.png").symlink_to(tmp_path / "q.png")
    # Less than three of the four names would take.
    with TextureReader(MemoryBudget(PEAK_BYTES_PER_TEXEL * 300 * 300)) as textures:
        first = textures.load(tmp_path / "q.png")
        data = (tmp_path / "q.png").read_bytes()
        for other in ("r.png", "link.png"):
            assert textures.load(tmp_path / other) is first
        assert textures.decode(data, SourceLocation("m.glb")) is first
        textures.wait(first)
        assert first[0, 0].tolist() == [255, 0, 0]


def test_file_is_read_once_however_often_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_quadrant_image().save(tmp_path / "q.png")
    reads = []
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: (reads.append(path), read(path))[1])
    with TextureReader() as textures:
        for _ in range(5):
            textures.load(tmp_path / "q.png")
    assert reads == [tmp_path / "q.png"]


def test_many_images_are_decoded_by_other_threads_in_their_own_arrays(tmp_path: Path) -> None:
    pictures = [make_image(40, 30) for _ in range(40)]
    for number, picture in enumerate(pictures):
        Image.fromarray(picture).save(tmp_path / f"{number}.png")
    with TextureReader() as textures:
        held = [textures.load(tmp_path / f"{number}.png") for number in range(40)]
        for texture, picture in zip(held, pictures, strict=True):
            textures.wait(texture)
            np.testing.assert_array_equal(texture, picture)
            assert not texture.flags.writeable


def test_texture_of_a_format_that_needs_another_program_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "q.eps"
    make_quadrant_image().save(path)
    with pytest.raises(ConfigError, match="an image file"):
        load_texture(path)


# Red, green, blue and dark grey at the square's corners.
COLOURS = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [51, 51, 51, 255]])
DARK = 51 / 255


def read(path: Path) -> MeshAppearance:
    """Appearance of the only mesh of a file."""
    (mesh,) = load_mesh_file(MeshFile(path))
    return mesh.appearance


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
    (mesh,) = load_mesh_file(MeshFile(export_mesh(scene, tmp_path / "m.glb"), up="z"))
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
        (np.array([0.5, 0.0, 1.0, 1.0], dtype=np.float32), (0.21404, 0.0, 1.0)),
        (np.array([np.nan, -1.0, np.inf], dtype=np.float32), (0.0, 0.0, 1.0)),
        (np.array([0, 32768, 65535], dtype=np.uint16), (0.0, 0.21404, 1.0)),
        (np.array([0, 188, 255, 3], dtype=np.uint8), (0.0, 0.50289, 1.0)),
    ],
    ids=["fractions", "no fractions", "16 bits", "bytes"],
)
def test_colours_of_any_type_are_fractions(
    colours: np.ndarray, linear: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(linear_light(colours), linear, atol=2e-5)


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
