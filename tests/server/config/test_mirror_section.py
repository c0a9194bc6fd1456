"""The mirror of an item: class, parameters, and the mesh drawn for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.mirrors import HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mirror_section import read_mirror, read_surface
from catoptra_server.robot.render_settings import MirrorSurface, PerPixel
from catoptra_server.scene.mirror_mesh import Interpolation, Tessellation


def read_from(folder: Path, class_name: str, *lines: str) -> tuple[Mirror, MirrorSurface]:
    """Mirror and surface of a section with the lines of a class."""
    path = folder / "mirror.ini"
    item = f"Mesh=(ItemClass=class'Catoptra.{class_name}',ItemName=\"M\")"
    path.write_text("\n".join(("[R]", item, f"[Catoptra.{class_name}]", *lines)))
    file = IniFile(path)
    section = file.get_section(f"Catoptra.{class_name}")
    return read_mirror(file.get_section("R").get_struct("Mesh"), section), read_surface(section)


@pytest.mark.parametrize(
    ("class_name", "lines", "mirror"),
    [
        ("HyperbolicMirror", ("K=3", "C=2", "MetresPerUnit=0.5"), HyperbolicMirror(3.0, 1.0)),
        ("ParabolicMirror", ("HorizonRadius=4",), ParabolicMirror(0.4)),
    ],
)
def test_mirror_has_the_parameters_of_its_section_in_metres(
    tmp_path: Path, class_name: str, lines: tuple[str, ...], mirror: Mirror
) -> None:
    assert read_from(tmp_path, class_name, *lines) == (mirror, PerPixel())


@pytest.mark.parametrize(
    ("line", "surface"),
    [
        ("Polygons=0", PerPixel()),
        ("Polygons=7", Tessellation(7, 1)),
        ("Polygons=16", Tessellation(4, 4)),
        ("Polygons=18", Tessellation(9, 2)),
        ("Sectors=17\nRings=1", Tessellation(17, 1)),
        ("Polygons=64\nInterpolation=position", Tessellation(8, 8, Interpolation.POSITION)),
    ],
)
def test_surface_is_exact_or_a_grid(tmp_path: Path, line: str, surface: MirrorSurface) -> None:
    assert read_from(tmp_path, "ParabolicMirror", "HorizonRadius=1", line)[1] == surface


@pytest.mark.parametrize("count", [11, 17, 97, 1009])
def test_surface_of_one_ring_by_a_prime_number_is_refused_with_the_size_of_a_grid(
    tmp_path: Path, count: int
) -> None:
    with pytest.raises(ConfigError, match=f"such as {count - 1}: {count} is one ring"):
        read_from(tmp_path, "ParabolicMirror", "HorizonRadius=1", f"Polygons={count}")


def test_class_that_is_no_mirror_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"Catoptra.HyperbolicMirror or Catoptra.ParabolicMirror"):
        read_from(tmp_path, "Cone", "K=3")
