"""The mirror of an item: class, parameters, and the mesh drawn for it.

Wide-angle cameras without a mirror of robot files: lens, hand, mount, domain, memory."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.formats import kalibr
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.mirrors import (
    ConicalMirror,
    EquiangularMirror,
    HyperbolicMirror,
    Mirror,
    ParabolicMirror,
    ProfileMirror,
    RadialTableMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mirrors_and_lenses import read_mirror, read_surface
from catoptra_server.config.robot_file import read_robot, read_robots
from catoptra_server.render.render_settings import MirrorSurface, PerPixel
from catoptra_server.simulation.robot_description import OmniCameraDescription, RobotDescription
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from helpers.calibrated_cameras import TUM_VI
from helpers.configs import ROBOTS, Edit, write_edited_copy


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
    with pytest.raises(ConfigError, match=r"Catoptra\.HyperbolicMirror, .*Catoptra\.ProfileMirror"):
        read_from(tmp_path, "Cone", "K=3")


WITHOUT_VIEWPOINT = [
    ("SphericalMirror", ("Radius=0.03", "CentreDistance=0.2"), SphericalMirror(0.03, 0.2)),
    (
        "SphericalMirror",
        ("Radius=30", "CentreDistance=200", "MetresPerUnit=0.001", "RimAngle=100"),
        SphericalMirror(0.03, 0.2, math.radians(100.0)),
    ),
    (
        "ConicalMirror",
        ("HalfAngle=45", "ApexDistance=0.2", "RimAngle=97"),
        ConicalMirror(math.radians(45.0), 0.2, math.radians(97.0)),
    ),
    ("EquiangularMirror", ("Gain=11", "VertexDistance=0.1"), EquiangularMirror(11.0, 0.1)),
    (
        "ProfileMirror",
        ("Radii=0,0.01,0.02,0.03", "Sags=0,0.002,0.008,0.018", "VertexDistance=0.2", "RimAngle=90"),
        ProfileMirror((0.0, 0.01, 0.02, 0.03), (0.0, 0.002, 0.008, 0.018), 0.2, math.radians(90.0)),
    ),
    (
        "RadialTableMirror",
        (
            *("Angles=0,30,60,90", "Radii=0,100,150,180", "FocalLength=1000"),
            *("VertexDistance=0.2", "RimAngle=90"),
        ),
        RadialTableMirror((0.0, 30.0, 60.0, 90.0), (0.0, 0.1, 0.15, 0.18), 0.2, math.radians(90.0)),
    ),
]


@pytest.mark.parametrize(("class_name", "lines", "mirror"), WITHOUT_VIEWPOINT)
def test_mirror_without_a_viewpoint_is_read(
    tmp_path: Path, class_name: str, lines: tuple[str, ...], mirror: Mirror
) -> None:
    read, _ = read_from(tmp_path, class_name, *lines)
    assert type(read) is type(mirror)
    for field in dataclasses.fields(mirror):  # type: ignore[arg-type]
        assert getattr(read, field.name) == pytest.approx(getattr(mirror, field.name), rel=1e-12)


BAD_WITHOUT_VIEWPOINT = [
    (
        "SphericalMirror",
        ("Radius=0.3", "CentreDistance=0.2"),
        "CentreDistance=.*outside the sphere",
    ),
    ("SphericalMirror", ("Radius=0.03", "CentreDistance=0.2", "RimAngle=175"), r"RimAngle=.*171"),
    ("ConicalMirror", ("HalfAngle=45", "ApexDistance=0.2", "RimAngle=80"), "RimAngle=.*above 90"),
    ("EquiangularMirror", ("Gain=1", "VertexDistance=0.1"), "Gain=.*gain > 1"),
    ("ProfileMirror", ("Radii=0,1", "Sags=0,1", "VertexDistance=1"), "Sags=.*4 to 512"),
    (
        "RadialTableMirror",
        ("Angles=0,30,60,90", "Radii=0,100,150,180", "VertexDistance=0.2", "RimAngle=80"),
        "Radii=.*is the focal length in the unit",
    ),
    (
        "RadialTableMirror",
        ("Angles=0,30,60,90", "Radii=0,.1,.15,.18", "VertexDistance=0.2", "RimAngle=91"),
        "RimAngle=.*at most 90",
    ),
]


@pytest.mark.parametrize(("class_name", "lines", "message"), BAD_WITHOUT_VIEWPOINT)
def test_impossible_mirror_without_a_viewpoint_is_rejected_at_its_key(
    tmp_path: Path, class_name: str, lines: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read_from(tmp_path, class_name, *lines)


PROFILE = """# millimetres, of a measuring machine
radius, height
0, 5.0
10, 5.8

20, 8.2
30; 12.2
40\t17.8
"""


def test_profile_of_a_file_is_that_of_the_keys(tmp_path: Path) -> None:
    (tmp_path / "ball.csv").write_text(PROFILE)
    lines = ("Profile=ball.csv", "VertexDistance=200", "MetresPerUnit=0.001", "RimAngle=70")
    mirror, _ = read_from(tmp_path, "ProfileMirror", *lines)
    assert isinstance(mirror, ProfileMirror)
    assert mirror.radii_m == pytest.approx((0.0, 0.01, 0.02, 0.03, 0.04))
    assert mirror.sags_m == pytest.approx((0.0, 0.0008, 0.0032, 0.0072, 0.0128))


def test_radial_table_of_a_file_is_that_of_the_keys(tmp_path: Path) -> None:
    (tmp_path / "marks.csv").write_text("deg,px\n0,0\n30,100\n60,150\n90,180\n")
    lines = ("Table=marks.csv", "FocalLength=1000", "VertexDistance=0.2", "RimAngle=90")
    mirror, _ = read_from(tmp_path, "RadialTableMirror", *lines)
    assert isinstance(mirror, RadialTableMirror)
    assert mirror.angles_deg == (0.0, 30.0, 60.0, 90.0)
    assert mirror.image_radii == (0.0, 0.1, 0.15, 0.18)


@pytest.mark.parametrize("content", ["0, 0\n10, 0.8\n", ""])
def test_profile_of_too_few_rows_is_rejected_at_its_key(tmp_path: Path, content: str) -> None:
    (tmp_path / "ball.csv").write_text(content)
    lines = ("Profile=ball.csv", "VertexDistance=200")
    with pytest.raises(ConfigError, match=r"ProfileMirror\.Profile='ball\.csv'.*4 to 512"):
        read_from(tmp_path, "ProfileMirror", *lines)


def read_ball(folder: Path, *lines: str) -> OmniCameraDescription:
    """Camera of the bundled chrome ball, with further lines in its mirror's section."""
    for name in ("p2at_omni.ini", "p2at_sphere.ini"):
        write_edited_copy(ROBOTS / name, folder)
    path = folder / "p2at_sphere.ini"
    path.write_text(path.read_text().replace("Central=auto", "\n".join(lines)))
    omni = read_robot(path)[0].omni_camera
    assert omni is not None
    return omni


def ball_camera(folder: Path, *lines: str) -> OmniCamera:
    return read_ball(folder, *lines).camera


@pytest.mark.parametrize(
    ("lines", "error_px"),
    [
        ((), 0.25),
        (("CentralErrorPx=0.5",), 0.5),
        (("Central=never",), 0.0),
        (("Central=always",), 0.0),
    ],
)
def test_auto_leaves_near_scenes_to_each_frame(
    tmp_path: Path, lines: tuple[str, ...], error_px: float
) -> None:
    assert read_ball(tmp_path, *lines).render_settings.central_error_px == error_px


def test_rays_are_exact_unless_nothing_can_be_near_enough(tmp_path: Path) -> None:
    assert not ball_camera(tmp_path).is_central
    assert not ball_camera(tmp_path, "Central=never", "CentralErrorPx=1000").is_central
    assert ball_camera(tmp_path, "Central=always").is_central
    # A ball's rays miss its viewpoint by millimetres: 46 px at the mirror itself.
    assert ball_camera(tmp_path, "CentralErrorPx=60").is_approximated


def test_mesh_of_a_mirror_without_a_viewpoint_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"Polygons=.256.*one viewpoint"):
        ball_camera(tmp_path, "Polygons=256")


FISHEYE = ROBOTS / "p2at_fisheye.ini"

ITEM = "Cameras=(ItemClass=class'Catoptra.Eye',ItemName=\"Eye\",{mount})\n"


def read_eye(
    folder: Path,
    *lines: str,
    mount: str = "Position=(X=0,Y=0,Z=-0.5)",
    lens: str = "Lens=equidistant",
) -> OmniCameraDescription:
    """Camera of a robot file with these lines in the section of its lens camera."""
    write_edited_copy(ROBOTS / "p2at.ini", folder)
    path = folder / "robot.ini"
    item = ITEM.replace("{mount}", mount)
    path.write_text(
        "[Configuration]\nBasedOn=p2at.ini\n[USARBot.P2AT]\n"
        + item
        + "\n".join(("[Catoptra.Eye]", lens, *lines, ""))
    )
    robot, file = read_robot(path)
    assert file.unknown_names() == []
    (omni,) = robot.omni_cameras
    return omni


def bundled() -> RobotDescription:
    return read_robot(FISHEYE)[0]


def test_lens_when_hanging_has_the_robot_s_axes() -> None:
    hanging = bundled().omni_cameras[0]
    assert hanging.robot_from_mirror.rotation == pytest.approx(np.eye(3), abs=1e-5)
    assert bundled().viewpoint_height_m(hanging) == pytest.approx(0.6)


def test_lens_when_ahead_shows_the_right_on_the_right_and_the_floor_below() -> None:
    ahead = bundled().omni_cameras[1]
    camera, mount = ahead.camera, ahead.robot_from_mirror
    in_mirror = mount.inverse().rotate_directions(np.array([[1.0, 0, 0], [1, 1, 0], [1, 0, 1]]))
    centre, right, below = camera.pixel_from_direction(in_mirror)[0]
    assert centre == pytest.approx(camera.centre_px)
    assert right == pytest.approx((camera.centre_px[0] + camera.scale_px * math.pi / 4, centre[1]))
    assert below == pytest.approx((centre[0], camera.centre_px[1] + camera.scale_px * math.pi / 4))


def test_lens_by_its_field_of_view_touches_the_nearer_borders(tmp_path: Path) -> None:
    camera = read_eye(tmp_path, "FieldOfView=360", "ResolutionX=400", "ResolutionY=300").camera
    assert (camera.rim_rad, camera.rim_radius_px) == (math.pi, 150.0)


def test_lens_by_its_focal_length_has_the_calibrated_plane(tmp_path: Path) -> None:
    lines = ("FocalLength=100", "FocalLengthY=101", "Skew=0.5", "CentreU=310", "CentreV=330")
    camera = read_eye(tmp_path, *lines, "Picture=mirrored").camera
    assert (camera.projection, camera.scale_px) == (EquidistantLens(), 100.0)
    assert (camera.centre_px, camera.picture) == ((310.0, 330.0), Picture.MIRRORED)
    assert camera.plane.stretch == (1.0, 0.005, 0.0, 1.01)
    # The farthest corner is 330 px right and down: as far as the lens may be seen.
    assert camera.rim_rad == pytest.approx(math.pi)


def test_lens_when_its_corners_are_nearer_than_its_limit_ends_there(tmp_path: Path) -> None:
    camera = read_eye(tmp_path, "FocalLength=400").camera
    assert camera.rim_rad == pytest.approx(math.hypot(320, 320) / 400)


def test_lens_on_a_link_moves_with_the_link(tmp_path: Path) -> None:
    omni = read_eye(tmp_path, "FieldOfView=180", mount='Parent="CameraTilt"')
    robot = read_robot(tmp_path / "robot.ini")[0]
    at_rest = robot.robot_from_omni(omni, {})
    turned = robot.robot_from_omni(omni, {"camerapan": 0.5})
    assert not np.allclose(at_rest.rotation, turned.rotation)


BAD = [
    (("Lens=wide", "FieldOfView=90"), "Lens='wide': expected one of equidistant"),
    ((), "FocalLength.*a FocalLength in px, a FieldOfView in degrees or both"),
    (("FieldOfView=361",), "FieldOfView='361'"),
    (("FocalLength=100", "Stretch=1,2,3"), "four numbers"),
    (("FocalLength=100", "Stretch=1,0,0,-1"), "positive determinant"),
    (("FocalLength=100", "P1=0.1"), "radial distortion"),
    (("FieldOfView=90", "MirrorDust=auto"), "which has no mirror"),
    (("FieldOfView=90", "Picture=sideways"), "mirrored, flipped"),
]


@pytest.mark.parametrize(("lines", "message"), BAD)
def test_lens_when_impossible_is_rejected_at_its_key(
    tmp_path: Path, lines: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read_eye(tmp_path, *lines)


def test_calibration_file_is_the_camera(tmp_path: Path) -> None:
    (tmp_path / "chain.yaml").write_text(kalibr.write(TUM_VI, "left"))
    lines = ("CalibrationFile=chain.yaml", "CalibrationCamera=cam0")
    camera = read_eye(tmp_path, *lines, lens="").camera
    assert camera.projection == TUM_VI.projection
    assert (camera.width_px, camera.picture) == (512, Picture.FLIPPED)
    assert compute_residual(TUM_VI, camera).max_px < 1e-9
    narrow = read_eye(tmp_path, *lines, "FieldOfView=100", "Picture=mirrored", lens="").camera
    assert narrow.rim_rad == pytest.approx(math.radians(50.0))
    assert narrow.picture is Picture.MIRRORED


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("CalibrationFile=none.yaml",), "none.yaml"),
        (("CalibrationFile=chain.yaml", "CalibrationCamera=cam7"), r"cam7=.*missing"),
        (("CalibrationFile=chain.yaml", "FieldOfView=300"), r"FieldOfView=.*first fold"),
        (("CalibrationFile=chain.yaml", "ResolutionX=640"), r"ResolutionX='640'.*expected 512"),
        (("CalibrationFile=chain.yaml", "ResolutionY=480"), r"ResolutionY='480'.*expected 512"),
    ],
)
def test_calibration_file_that_does_not_fit_is_rejected(
    tmp_path: Path, lines: tuple[str, ...], message: str
) -> None:
    (tmp_path / "chain.yaml").write_text(kalibr.write(TUM_VI, "left"))
    with pytest.raises(ConfigError, match=message):
        read_eye(tmp_path, *lines, lens="")


def test_lens_when_larger_than_the_memory_limit_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="ResolutionX='8192 x 8192 px"):
        read_eye(tmp_path, "FieldOfView=90", "ResolutionX=8192", "ResolutionY=8192", "Samples=4")


def test_mirror_when_its_picture_is_flipped_has_its_axis_at_the_mirrored_column(
    tmp_path: Path,
) -> None:
    path = write_edited_copy(
        ROBOTS / "p2at_omni.ini", tmp_path, Edit("Samples=2", "Picture=flipped\nSamples=2")
    )
    (robot,), _ = read_robots(path)
    assert robot.omni_camera is not None
    camera = robot.omni_camera.camera
    assert isinstance(camera, OmniCamera)
    assert camera.picture is Picture.FLIPPED
    # Right of the robot is on the right of the picture.
    pixel, valid = camera.pixel_from_direction(np.array([0.0, 1.0, 0.5]))
    assert valid
    assert pixel[0] > camera.centre_px[0]
