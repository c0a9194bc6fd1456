"""The paper's three groups of elements: read from the bundled file, rejected if inconsistent.

Perspective cameras of robot files."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_server.config.robot_file import read_robot, read_robots
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.render.render_settings import AccuracyTarget, PerPixel
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


def test_camera_when_read_is_the_paper_s() -> None:
    camera = read_camera(OMNI_ROBOT)
    assert camera.name == "OmniCamPillar_Link4"
    assert camera.camera.mirror == HyperbolicMirror(11.546, 0.1 * 2.321)
    assert (camera.camera.width_px, camera.camera.height_px) == (360, 360)
    assert math.degrees(camera.camera.rim_rad) == pytest.approx(120.0)
    assert camera.camera.rim_radius_px == pytest.approx(180.0)
    # The reference set-up: the paper's mirror in 360 px.
    assert camera.camera.horizon_radius_px == pytest.approx(103.45267, abs=5e-6)
    assert camera.render_settings.surface == PerPixel()


def test_camera_when_read_has_five_texture_clients_at_the_viewpoint() -> None:
    camera = read_camera(OMNI_ROBOT)
    assert [client.face for client in camera.texture_clients] == list(Face)[:5]
    assert {client.fov_rad for client in camera.texture_clients} == {0.5 * math.pi}
    np.testing.assert_allclose(camera.robot_from_mirror.translation, (0.0, 0.0, -0.4543))


def test_capture_camera_when_read_sees_the_rim_under_its_field_of_view() -> None:
    # f = 1086.096 px and a rim of 180 px: the reference set-up.
    assert read_camera(OMNI_ROBOT).capture_fov_rad == pytest.approx(
        2.0 * math.atan(180.0 / 1086.096), abs=1e-6
    )


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


@pytest.mark.parametrize(
    ("edit", "surface"),
    [
        (Edit("Polygons=0 ", "Polygons=1024 "), Tessellation(32, 32)),
        (Edit("Polygons=0 ", "Sectors=64\nRings=16\n"), Tessellation(64, 16)),
    ],
)
def test_mirror_when_cut_into_polygons_has_the_split(
    tmp_path: Path, edit: Edit, surface: Tessellation
) -> None:
    assert (
        read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, edit)).render_settings.surface
        == surface
    )


def test_mirror_when_interpolated_by_position_reports_it(tmp_path: Path) -> None:
    edits = (
        Edit("Polygons=0 ", "Polygons=16 "),
        Edit("Interpolation=uv", "Interpolation=Position"),
    )
    surface = read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, *edits)).render_settings.surface
    assert surface == Tessellation(4, 4, Interpolation.POSITION)


def test_texture_clients_when_a_sixth_is_written_are_six(tmp_path: Path) -> None:
    upward = Edit(CLIENT_W, f"{CLIENT_W}\n[USARBot.USARCameraTextureClientU]\nTextureSize=512")
    camera = read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, upward))
    assert [client.face for client in camera.texture_clients] == list(Face)
    assert camera.render_settings.face_size_px == 512


@pytest.mark.parametrize(
    "edit",
    [
        edit_position("X=0,Y=0,Z=0.2321"),
        Edit(CAPTURE, 'Parent="OmniCam"'),
    ],
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


def test_camera_without_a_viewpoint_is_an_error_that_shows_its_line(tmp_path: Path) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("CamTexActors=(", ";CamTexActors=("))
    with pytest.raises(ConfigError) as caught:
        read_robot(path)
    assert caught.value.key == "USARBot.OmniP2AT.CamTexActors"
    assert 'OmniMirror of StaticMeshes is mounted on, such as (ItemName="OmniCam"' in str(
        caught.value
    )


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


def test_mirror_section_when_misspelt_is_named(tmp_path: Path) -> None:
    edit = Edit("[Catoptra.HyperbolicMirror]", "[Catoptra.HyperbolicMiror]")
    with pytest.raises(ConfigError, match=r"is \[Catoptra.HyperbolicMiror\] meant to be it\?"):
        read_robot(write_edited_copy(OMNI_ROBOT, tmp_path, edit))


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


BROKEN = [
    (Edit("K=11.546", "K=2"), "Catoptra.HyperbolicMirror.K", "k > 2"),
    (Edit("K=11.546", "K=1.9"), "K", "of at least 2"),
    (Edit("K=11.546", "K=abc"), "K", "a number of at least 2"),
    (Edit("C=2.321", "C=0"), "Catoptra.HyperbolicMirror.C", "c > 0"),
    (Edit("C=2.321", "C=-2.321"), "C", "of at least 0"),
    (Edit("RimAngle=120", "RimAngle=156"), "Catoptra.HyperbolicMirror.RimAngle", "below 155.405"),
    (Edit("RimAngle=120", "RimAngle=0"), "RimAngle", "from 1 to 179"),
    (Edit("'Catoptra.HyperbolicMirror'", "'Catoptra.Cone'"), "StaticMeshes.ItemClass", "Parabolic"),
    (edit_position("Z=0.2322"), "Cameras.Position", "or no Position; it is 0.1 mm off"),
    (edit_position("X=0.001,Z=0.2321"), "Cameras.Position", "it is 1 mm off"),
    (Edit("Y=1.5708,Z=3.1416", "Y=1.5,Z=3.1416"), "Cameras.Direction", "looking up"),
    (Edit("Y=1.5708,Z=3.1416", "Y=-1.5708,Z=0"), "Cameras.Direction", "looking up"),
    (
        Edit('"OmniMirror",Parent="OmniCam"', '"OmniMirror"'),
        "USARBot.OmniP2AT.StaticMeshes",
        "item",
    ),
    (Edit("(X=0,Y=0,Z=-0.4543)", "(X=0,Y=0,Z=abc)"), "Position.Z", "a number"),
    (Edit("ResolutionX=360", "ResolutionX=0"), "ResolutionX", "from 1 to 8192"),
    (Edit("ResolutionX=360", "ResolutionX=10000"), "ResolutionX", "from 1 to 8192"),
    (Edit("Samples=2", "Samples=17"), "Samples", "from 1 to 16"),
    (Edit("Samples=2", "Samples=0"), "Samples", "from 1 to 16"),
    (Edit("Samples=2", "MaxErrorPx=-1"), "MaxErrorPx", "from 0 to 1000"),
    (Edit("Samples=2", "BudgetMs=soon"), "BudgetMs", "a number"),
    (Edit("Polygons=0", "Polygons=3"), "Catoptra.HyperbolicMirror.Polygons", "at least 4"),
    (Edit("Polygons=0", "Polygons=17"), "Catoptra.HyperbolicMirror.Polygons", "such as 16"),
    (Edit("Polygons=0", "Polygons=1009"), "Catoptra.HyperbolicMirror.Polygons", "such as 1008"),
    (Edit("Polygons=0", "Rings=0\nSectors=8"), "Catoptra.HyperbolicMirror.Sectors", "at least 3"),
    (Edit("Interpolation=uv", "Interpolation=cubic"), "Interpolation", "one of uv, position"),
    (Edit('"OmniCamPillar_Link4"', '"Omni Cam"'), "Cameras.ItemName", "one word"),
]


@pytest.mark.parametrize(("edit", "key", "expected"), BROKEN, ids=[b[0].new for b in BROKEN])
def test_camera_when_broken_names_file_line_key_and_expectation(
    tmp_path: Path, edit: Edit, key: str, expected: str
) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, edit)
    with pytest.raises(ConfigError) as caught:
        read_robot(path)
    error = caught.value
    changed = edit.new.splitlines()[-1]
    assert (error.location.file, error.location.line) == (
        str(path),
        find_line_number(path, changed),
    )
    assert error.key == key
    assert expected in error.expected


def test_texture_client_when_not_of_90_degrees_is_rejected(tmp_path: Path) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit(CLIENT_W, CLIENT_W.replace("=90", "=100")))
    with pytest.raises(ConfigError, match=r"TextureClientW\.FOV='100': expected 90") as caught:
        read_robot(path)
    assert caught.value.location.line == find_line_number(path, "FOV=100")


@pytest.mark.parametrize(
    ("edit", "key"),
    [
        (Edit("C=2.321\n", ""), r"Catoptra\.HyperbolicMirror\.C"),
        (Edit("K=11.546                   ; the paper's Eq. 1\n", ""), r"\.K"),
    ],
)
def test_mirror_when_a_constant_is_missing_names_its_section(
    tmp_path: Path, edit: Edit, key: str
) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, edit)
    with pytest.raises(ConfigError, match=rf"{key}=''.*it is missing") as caught:
        read_robot(path)
    assert caught.value.location.line == find_line_number(path, "[Catoptra.HyperbolicMirror]")


def test_capture_camera_when_missing_names_its_parent(tmp_path: Path) -> None:
    lines = OMNI_ROBOT.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "robot.ini"
    path.write_text("\n".join(line for line in lines if not line.startswith("Cameras=")))
    with pytest.raises(ConfigError, match=r'Cameras=.*an item with Parent="OmniCam"'):
        read_robot(path)


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


def test_mirror_when_cut_into_too_many_polygons_is_rejected(tmp_path: Path) -> None:
    edit = Edit("Polygons=0 ", "Sectors=10000\nRings=51\n")
    with pytest.raises(ConfigError, match="at most 1000000 polygons"):
        read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, edit))


def test_viewpoint_when_far_from_the_robot_is_rejected(tmp_path: Path) -> None:
    edit = Edit("Position=(X=0,Y=0,Z=-0.4543)", "Position=(X=0,Y=1e6,Z=-0.4543)")
    with pytest.raises(ConfigError, match="within 100 m of its parent"):
        read_camera(write_edited_copy(OMNI_ROBOT, tmp_path, edit))


def test_camera_when_of_the_real_udk_line_has_its_class_s_numbers() -> None:
    (camera,) = read_robot(ROBOTS / "p3at_udk.ini")[0].perspective_cameras
    assert (camera.name, camera.mount.position_m) == ("Camera", (0.1005, 0.0, -0.42))
    assert (camera.fov_rad, camera.min_fov_rad, camera.max_fov_rad) == (1.3963, 0.3491, 2.0944)


def test_camera_when_of_the_p2at_sits_on_its_pan_tilt() -> None:
    (camera,) = read_robot(ROBOTS / "p2at.ini")[0].perspective_cameras
    assert camera.mount.parent == "CameraTilt"


def test_camera_when_part_of_the_omni_camera_is_no_perspective_one() -> None:
    assert read_robot(ROBOTS / "omni_p2dx.ini")[0].perspective_cameras == ()


def test_lens_when_larger_than_the_memory_limit_is_rejected_at_its_line(
    tmp_path: Path,
) -> None:
    path = tmp_path / "robot.ini"
    path.write_text(
        "[Configuration]\nBasedOn=p3at_udk.ini\n[USARSensor.USARCamera]\nResolutionX=8192\n"
        "ResolutionY=8192\n"
    )
    write_edited_copy(ROBOTS / "p3at_udk.ini", tmp_path)
    with pytest.raises(ConfigError, match=r"ResolutionX='8192 x 8192 px'.*fewer pixels.* MiB"):
        read_robots(path)
    robots, _ = read_robots(path, limit_bytes=2**34)
    assert robots[0].perspective_cameras[0].width_px == 8192


def read_effects(tmp_path: Path, *lines: str) -> EffectSettings:
    path = tmp_path / "robot.ini"
    head = ("[Configuration]", "BasedOn=p3at_udk.ini", "[USARSensor.USARCamera]")
    path.write_text("\n".join((*head, *lines)))
    write_edited_copy(ROBOTS / "p3at_udk.ini", tmp_path)
    robots, _ = read_robots(path)
    return robots[0].perspective_cameras[0].effects


def test_camera_whose_section_names_no_effect_has_none(tmp_path: Path) -> None:
    assert read_effects(tmp_path, "ResolutionX=64") == NO_EFFECT_SETTINGS


def test_camera_with_effects_has_them_by_the_keys_of_a_capture_camera(tmp_path: Path) -> None:
    found = read_effects(tmp_path, "Vignetting=auto", "ReadNoise=always", "EffectThreshold=2")
    assert [(one.effect.name, one.mode.value) for one in found.settings] == [
        ("Vignetting", "auto"),
        ("ReadNoise", "always"),
    ]
    assert found.threshold_grey_levels == 2.0


@pytest.mark.parametrize("kind", [kind.name for kind in EFFECT_TYPES if kind.needs_mirror])
def test_camera_with_an_effect_of_mirrors_is_rejected_at_its_line(
    tmp_path: Path, kind: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        read_effects(tmp_path, f"{kind}=auto")
    text = str(caught.value)
    for part in ("robot.ini:4", f"{kind}='auto'", "a lens, which has no mirror", "Vignetting"):
        assert part in text


def test_effects_of_mirrors_are_the_four_that_a_lens_cannot_have() -> None:
    names = {kind.name for kind in EFFECT_TYPES if kind.needs_mirror}
    assert names == {"MirrorDust", "MirrorReflectance", "Misalignment", "SelfView"}
