"""Cameras with a mirror: the three groups of the paper, each kind of mirror, and its mesh."""

from __future__ import annotations

import dataclasses
import logging
import math
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.cube_map import Face
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
from catoptra_server.config.robot_file import read_robot, read_robots
from catoptra_server.render.renderer import AccuracyTarget, MirrorSurface, PerPixel
from catoptra_server.simulation.robot_description import OmniCameraDescription
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from helpers.configs import OMNI_ROBOT, ROBOTS, Edit, find_line_number, write_edited_copy

CAPTURE = 'Parent="OmniCam",Direction=(X=0,Y=1.5708,Z=3.1416)'
CLIENT_W = '[USARBot.USARCameraTextureClientW]\nDestTexture="OmniCamW"\nFOV=90'
PARABOLIC = (
    Edit("class'Catoptra.HyperbolicMirror'", "class'Catoptra.ParabolicMirror'"),
    Edit("[Catoptra.HyperbolicMirror]", "[Catoptra.ParabolicMirror]\nHorizonRadius=0.5"),
)


def edit_position(members: str) -> Edit:
    """Position of the capture camera, which the bundled robot leaves out."""
    return Edit(CAPTURE, CAPTURE.replace("Direction", f"Position=({members}),Direction"))


def read_camera(path: Path) -> OmniCameraDescription:
    camera = read_robot(path)[0].omni_camera
    assert camera is not None
    return camera


def read_from(folder: Path, class_name: str, *lines: str) -> tuple[Mirror, MirrorSurface]:
    """Mirror and surface of the bundled robot with these lines in its mirror's section."""
    write_edited_copy(OMNI_ROBOT, folder)
    path = folder / "mirror.ini"
    mesh = f'StaticMeshes=(ItemClass=class\'Catoptra.{class_name}\',ItemName="M",Parent="OmniCam")'
    head = ("[Configuration]", "BasedOn=p2at_omni.ini", "[USARBot.OmniP2AT]", mesh)
    path.write_text("\n".join((*head, f"[Catoptra.{class_name}]", *lines)))
    camera = read_camera(path)
    return camera.camera.mirror, camera.render_settings.surface


def test_camera_when_read_is_the_paper_s() -> None:
    camera = read_camera(OMNI_ROBOT)
    assert camera.name == "OmniCamPillar_Link4"
    assert camera.camera.mirror == HyperbolicMirror(11.546, 0.1 * 2.321)
    assert (camera.camera.width_px, camera.camera.height_px) == (360, 360)
    assert math.degrees(camera.camera.rim_rad) == pytest.approx(120.0)
    assert camera.camera.rim_radius_px == pytest.approx(180.0)
    # The reference set-up: the paper's mirror in 360 px.
    assert camera.camera.horizon_radius_px == pytest.approx(103.45267, abs=5e-6)
    # Its focal length is 1086.096 px.
    assert camera.capture_fov_rad == pytest.approx(2.0 * math.atan(180.0 / 1086.096), abs=1e-6)
    assert camera.render_settings.surface == PerPixel()


def test_camera_when_read_has_five_texture_clients_at_the_viewpoint() -> None:
    camera = read_camera(OMNI_ROBOT)
    assert [client.face for client in camera.texture_clients] == list(Face)[:5]
    assert camera.texture_clients[0].texture == "OmniCamN"
    assert {client.fov_rad for client in camera.texture_clients} == {0.5 * math.pi}
    np.testing.assert_allclose(camera.robot_from_mirror.translation, (0.0, 0.0, -0.4543))


def test_camera_when_its_name_is_empty_is_not_there(tmp_path: Path) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit('ItemName="OmniCam",', 'ItemName="",'))
    assert read_robot(path)[0].omni_camera is None


def test_mirror_when_parabolic_has_an_orthographic_camera(tmp_path: Path) -> None:
    camera = read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, *PARABOLIC))
    assert camera.camera.mirror == ParabolicMirror(0.05)
    assert camera.capture_fov_rad == 0.0


@pytest.mark.parametrize(
    ("yaw", "up_azimuth_rad"),
    [("3.1416", 0.0), ("0", math.pi), ("-1.5708", 0.5 * math.pi), ("1.5708", 1.5 * math.pi)],
)
def test_capture_camera_when_turned_by_quarters_is_up_exactly(
    tmp_path: Path, yaw: str, up_azimuth_rad: float
) -> None:
    edit = Edit(CAPTURE, CAPTURE.replace("3.1416", yaw))
    camera = read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, edit))
    assert camera.camera.image_up_azimuth_rad == up_azimuth_rad


def test_capture_camera_when_turned_by_any_angle_keeps_the_angle(tmp_path: Path) -> None:
    edit = Edit(CAPTURE, CAPTURE.replace("3.1416", "2.6416"))
    camera = read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, edit))
    assert camera.camera.image_up_azimuth_rad == pytest.approx(2.6416 - math.pi, abs=1e-5)


def test_texture_clients_when_a_sixth_is_written_are_six(tmp_path: Path) -> None:
    upward = Edit(CLIENT_W, f"{CLIENT_W}\n[USARBot.USARCameraTextureClientU]\nTextureSize=512")
    camera = read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, upward))
    assert [client.face for client in camera.texture_clients] == list(Face)
    assert camera.render_settings.face_size_px == 512


@pytest.mark.parametrize(
    "edit",
    [edit_position("X=0,Y=0,Z=0.2321"), Edit(CAPTURE, 'Parent="OmniCam"')],
    ids=["the pinhole's position", "no direction"],
)
def test_capture_camera_without_a_pose_looks_up_from_the_pinhole(
    tmp_path: Path, edit: Edit
) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, edit)
    assert read_camera(path).camera == read_camera(OMNI_ROBOT).camera


@pytest.mark.parametrize("c", ["2.321", "1.5"])
def test_capture_camera_without_a_position_follows_the_focus(tmp_path: Path, c: str) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("C=2.321", f"C={c}"))
    assert read_camera(path).camera.mirror.pinhole_distance_m == pytest.approx(0.1 * float(c))


def test_texture_client_without_a_section_is_named_in_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    section = "[USARBot.USARCameraTextureClientE]"
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit(section, section.replace("tE]", "tEast]")))
    with caplog.at_level(logging.WARNING):
        _, file = read_robot(path)
    assert f"no section {section}: a texture client renders" in caplog.text
    (unknown,) = file.unknown_names()
    assert unknown.suggestion == section.strip("[]")


def test_stride_of_earlier_versions_when_written_is_an_unknown_key(tmp_path: Path) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("Samples=2", "TraceStride=1"))
    _, file = read_robot(path)
    assert [entry.key for entry in file.unknown_names()] == ["TraceStride"]


def test_accuracy_target_when_written_is_read(tmp_path: Path) -> None:
    assert read_camera(OMNI_ROBOT).render_settings.accuracy_target == AccuracyTarget()
    edit = Edit("Samples=2", "Samples=2\nMaxErrorPx=0.5\nBudgetMs=20")
    assert read_camera(
        write_edited_copy(OMNI_ROBOT, tmp_path, edit)
    ).render_settings.accuracy_target == AccuracyTarget(0.5, 20.0)


@pytest.mark.parametrize(
    "edits",
    [
        (Edit("ResolutionX=360", "ResolutionX=8192"), Edit("ResolutionY=360", "ResolutionY=8192")),
        (
            Edit("ResolutionX=360", "ResolutionX=720"),
            Edit("Samples=2 ", "Samples=16 "),
            Edit("ResolutionY=360", "ResolutionY=720"),
        ),
        (Edit(CLIENT_W, f"{CLIENT_W}\nTextureSize=8192"),),
        (
            Edit(CLIENT_W, f"{CLIENT_W}\nTextureSize=4096"),
            Edit("ResolutionX=360", "ResolutionX=360\nFaceSamples=8"),
        ),
    ],
)
def test_camera_when_larger_than_the_memory_limit_is_rejected_at_its_line(
    tmp_path: Path, edits: tuple[Edit, ...]
) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, *edits)
    expected = (
        r"OmniCaptureCamera\.ResolutionX='\d+ x \d+ px, Samples=.*fewer pixels.* MiB.* of 1024"
    )
    with pytest.raises(ConfigError, match=expected) as caught:
        read_robots(path)
    assert caught.value.location.line == find_line_number(path, "ResolutionX=")
    robots, _ = read_robots(path, limit_bytes=2**36)
    assert robots[0].omni_camera is not None


@pytest.mark.parametrize(("lines", "fits"), [("SelfView=auto", True), ("Vignetting=auto", False)])
def test_effects_of_the_scene_take_less_memory_than_those_of_the_image(
    tmp_path: Path, lines: str, fits: bool
) -> None:
    # A view of 2048 px at 2 x 2 samples takes 465 MiB, all effects of the image 500 bytes a pixel.
    resolution = Edit("ResolutionX=360", f"ResolutionX=2048\n{lines}")
    path = write_edited_copy(
        OMNI_ROBOT,
        tmp_path,
        Edit("ResolutionY=360", "ResolutionY=2048"),
        Edit("SelfView=auto", ""),
        resolution,
    )
    with nullcontext() if fits else pytest.raises(ConfigError, match="fewer pixels"):
        read_robots(path)


def test_mirror_when_cut_into_too_many_polygons_is_rejected(tmp_path: Path) -> None:
    edit = Edit("Polygons=0 ", "Sectors=10000\nRings=51\n")
    with pytest.raises(ConfigError, match="at most 1000000 polygons"):
        read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, edit))


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
        ("Polygons=1024", Tessellation(32, 32)),
        ("Sectors=64\nRings=16", Tessellation(64, 16)),
        ("Sectors=17\nRings=1", Tessellation(17, 1)),
        ("Polygons=64\nInterpolation=position", Tessellation(8, 8, Interpolation.POSITION)),
    ],
)
def test_surface_is_exact_or_a_grid(tmp_path: Path, line: str, surface: MirrorSurface) -> None:
    assert read_from(tmp_path, "ParabolicMirror", "HorizonRadius=1", line)[1] == surface


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
        "ProfileMirror",
        ("Radii=0,1e-320,0.02,0.03", "Sags=0,0.002,0.008,0.018", "VertexDistance=0.2"),
        r"section='Catoptra\.ProfileMirror'.*computed with \(overflow",
    ),
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


def test_profile_of_a_file_is_that_of_the_keys(tmp_path: Path) -> None:
    (tmp_path / "ball.csv").write_text("0, 5.0\n10, 5.8\n20, 8.2\n30, 12.2\n40, 17.8\n")
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


def test_mirror_has_focal_length_and_centre_of_a_calibration(tmp_path: Path) -> None:
    plain = ball_camera(tmp_path, "Central=always")
    focal_px = 1.1 / plain.inverse_focal_length
    keys = (
        f"FocalLength={focal_px}",
        f"FocalLengthY={1.01 * focal_px}",
        "CentreU=170",
        "CentreV=188",
    )
    camera = ball_camera(tmp_path, "Central=always", "[Catoptra.OmniCaptureCamera]", *keys)
    assert camera.centre_px == (170.0, 188.0)
    assert camera.scale_px == pytest.approx(1.1 * plain.scale_px, rel=1e-12)
    assert camera.plane.stretch == pytest.approx((1.0, 0.0, 0.0, 1.01))


def test_defocus_of_a_mirror_needs_a_viewpoint_or_its_approximation(tmp_path: Path) -> None:
    effect = ("[Catoptra.OmniCaptureCamera]", "Defocus=always")
    with pytest.raises(ConfigError, match=r"Defocus.*without a single viewpoint"):
        ball_camera(tmp_path, "Central=never", *effect)
    omni = read_ball(tmp_path, "Central=always", *effect)
    assert [one.effect.name for one in omni.effects.settings][-1] == "Defocus"
