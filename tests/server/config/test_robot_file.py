"""Robot files: the bundled one as described, and the errors of broken ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_file import find_unserved_robots, read_robot, read_robots
from catoptra_server.simulation.robot_bodies import build_carrier_mesh
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors.ground_truth import GroundTruthDescription
from catoptra_server.simulation.sensors.odometry import OdometryDescription
from helpers.configs import OMNI_ROBOT, ROBOTS
from helpers.mesh_file_samples import export_mesh, make_textured_square

BARE = """\
[USARBot.P2AT]
SteeringType=SkidSteered
Dimensions=(X=0.5,Y=0.4,Z=0.3)
WheelRadius=0.13
WheelSeparation=0.47
WheelBase=0.29
RideHeight=0.15
Mass=14
MaxSpeed=5.385
"""


def write_file(folder: Path, text: str) -> Path:
    path = folder / "robot.ini"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("path", sorted(ROBOTS.glob("*.ini")), ids=lambda path: path.name)
def test_bundled_robot_when_read_has_no_unknown_key(path: Path) -> None:
    robot, file = read_robot(path)
    is_omni = any(word in path.name for word in ("omni", "fisheye", "sphere", "tripod"))
    assert (robot.omni_camera is not None) == is_omni
    assert file.unknown_names() == []


def test_p2at_when_read_has_the_reference_base() -> None:
    robot, _ = read_robot(OMNI_ROBOT)
    drive = robot.drive
    assert (robot.class_name, robot.model_name) == ("USARBot.OmniP2AT", "OmniP2AT")
    # As a real UT2004 server reported its P2AT.
    assert (drive.wheel_radius_m, drive.wheel_separation_m) == (0.13, 0.4712)
    assert (drive.wheel_base_m, drive.dimensions_m) == (0.2884, (0.5238, 0.4968, 0.2913))
    assert (drive.mass_kg, drive.max_speed_rad_s, drive.max_torque) == (14.0, 5.385, 60.0)
    assert (robot.status_interval_s, robot.battery_s) == (0.2, 1200.0)
    assert robot.max_viewpoint_height_m == pytest.approx(0.6, abs=1e-12)


def test_p2at_when_read_has_its_sensors_in_order() -> None:
    robot, _ = read_robot(OMNI_ROBOT)
    odometry, truth = robot.sensors
    assert isinstance(odometry, OdometryDescription)
    assert (odometry.name, odometry.interval_s, odometry.turn_scale) == ("Odometry", 0.2, 0.97)
    assert truth == GroundTruthDescription("GroundTruth", 0.2, 2)


def test_robot_when_it_has_no_omni_camera_stands_on_its_own(tmp_path: Path) -> None:
    robot, _ = read_robot(write_file(tmp_path, BARE))
    assert (robot.omni_camera, robot.sensors, robot.max_viewpoint_height_m) == (None, (), 0.0)


@pytest.mark.parametrize("is_smooth", [False, True])
def test_robot_when_its_shading_is_smooth_has_normals_at_its_wheels(
    tmp_path: Path, is_smooth: bool
) -> None:
    text = BARE + "Body=plain\n" + "SmoothShading=true\n" * is_smooth
    robot, _ = read_robot(write_file(tmp_path, text))
    mesh = build_carrier_mesh(robot)
    # Of 24 triangles of two boxes, and four wheels' 40 of walls and 40 of ends.
    assert (0 if mesh.bent is None else mesh.bent.sum()) == 160 * is_smooth
    assert (mesh.corner_normals is not None) == is_smooth


def test_robot_when_its_file_has_shapes_is_shown_by_these_with_their_textures(
    tmp_path: Path,
) -> None:
    export_mesh(make_textured_square(pbr=True), tmp_path / "deck.glb")
    body = (
        "Boxes=(Size=(X=0.4,Y=0.3,Z=0.1),Texture=catoptra:brick,Repeat=0.2)\n"
        "Meshes=(File=deck.glb,Scale=0.1,Position=(X=0,Y=0,Z=-0.2))\n"
    )
    robot, file = read_robot(write_file(tmp_path, BARE + body))
    assert not [name for name in file.unknown_names() if "Boxes" in str(name)]
    mesh = build_carrier_mesh(robot)
    assert [texture.shape[0] for texture in mesh.textures] == [512, 2]
    assert mesh.texture_index.tolist() == 12 * [0] + 2 * [1]
    # A tile of 0.2 m twice along a side of 0.4 m.
    assert np.ptp(mesh.uv[:12], axis=(0, 1)).max() == pytest.approx(2.0)
    with pytest.raises(ConfigError, match=r"robot\.ini:11.*none\.glb"):
        read_robot(write_file(tmp_path, BARE + body.replace("deck", "none")))
    for key in ("Emission=2", "Gloss=(F0=0.1)"):
        with pytest.raises(ConfigError, match=r"robot\.ini.*what moves is matt"):
            read_robot(write_file(tmp_path, BARE + f"Boxes=(Size=(X=1,Y=1,Z=1),{key})\n"))


def test_robot_when_several_sections_are_there_is_the_first_that_steers(tmp_path: Path) -> None:
    text = "[USARBot.USARBot]\nmsgTimer=1\n" + BARE + BARE.replace("P2AT", "P2DX")
    assert read_robot(write_file(tmp_path, text))[0].class_name == "USARBot.P2AT"


def test_robot_when_written_over_two_sections_is_one(tmp_path: Path) -> None:
    text = BARE.replace("Mass=14\n", "[Other]\n[usarbot.p2at]\nMass=14\n")
    assert read_robot(write_file(tmp_path, text))[0].drive.mass_kg == 14.0


def test_struct_when_followed_by_the_pseudo_comment_of_a_real_file_is_read(tmp_path: Path) -> None:
    text = BARE.replace("Z=0.3)", "Z=0.3)'was y=-1.2")
    assert read_robot(write_file(tmp_path, text))[0].drive.dimensions_m == (0.5, 0.4, 0.3)


def test_file_when_it_holds_several_robots_gives_all_its_own_first(tmp_path: Path) -> None:
    robots, _ = read_robots(
        write_file(tmp_path, BARE + "[USARBot.P2DX]\n[Other.P3AT]\nmsgTimer=1\n")
    )
    assert [robot.class_name for robot in robots] == ["USARBot.P2AT", "USARBot.P2DX"]
    robots, _ = read_robots(ROBOTS / "omni_p2dx.ini")
    assert [robot.class_name for robot in robots] == ["USARBot.OmniP2DX", "USARBot.P2DX"]


@pytest.mark.parametrize(
    ("text", "wheel_m", "separation_m", "mass_kg", "speed_rad_s", "body_m"),
    # As in real replies.
    [
        ("[USARBot.P2AT]\nMass=15", 0.13, 0.4712, 15.0, 5.385, (0.5238, 0.4968, 0.2913)),
        ("[usarbot.p3at]\nmsgTimer=.1", 0.098, 0.36, 11.9, 1.3, (0.508, 0.497, 0.277)),
    ],
)
def test_base_when_the_section_has_no_keys_is_that_of_the_class(
    tmp_path: Path,
    text: str,
    wheel_m: float,
    separation_m: float,
    mass_kg: float,
    speed_rad_s: float,
    body_m: tuple[float, float, float],
) -> None:
    drive = read_robot(write_file(tmp_path, text))[0].drive
    assert (drive.wheel_radius_m, drive.wheel_separation_m) == (wheel_m, separation_m)
    assert (drive.mass_kg, drive.max_speed_rad_s, drive.collision_size_m) == (
        mass_kg,
        speed_rad_s,
        body_m,
    )


def test_p3at_when_read_has_the_dimensions_of_udk(tmp_path: Path) -> None:
    drive = read_robot(ROBOTS / "p3at_udk.ini")[0].drive
    assert drive.dimensions_m == (0.248, 0.36, 0.0)


def test_classes_when_unknown_are_reported_and_the_rest_is_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    item = "Sensors=(ItemClass=class'USARBot.Sniffer',ItemName=\"CO2\")\n"
    robot, _ = read_robot(write_file(tmp_path, BARE + item))
    assert robot.sensors == ()
    assert [record.message.partition(": ")[2] for record in caplog.records] == [
        "class USARBot.Sniffer is unknown: item CO2 has no effect"
    ]


@pytest.mark.parametrize("key", ["Sensors", "AddParts", "Cameras", "MisPkgs", "JointParts"])
def test_list_of_too_many_items_is_rejected_at_the_next_line(tmp_path: Path, key: str) -> None:
    lines = [f'{key}=(ItemName="a{n}")' for n in range(257)]
    path = write_file(tmp_path, BARE + "\n".join(lines))
    with pytest.raises(ConfigError, match=rf"robot\.ini:{9 + 257}: .*at most 256 items"):
        read_robot(path)


def test_file_of_too_many_robots_is_rejected_at_the_next(tmp_path: Path) -> None:
    robots = [BARE.replace("P2AT", f"A{n}") for n in range(257)]
    path = write_file(tmp_path, "".join(robots))
    with pytest.raises(ConfigError, match=rf"robot\.ini:{9 * 256 + 2}: .*at most 256"):
        read_robots(path)


_NUMBERS = st.sampled_from(
    ["0", "-1", "0.5", "1e5", "1e9", "-1e9", "1e10", "1e308", "-1e308", "nan", "1e-300", "x", ""]
)
_LINES = st.one_of(
    st.tuples(
        st.sampled_from(["Mass", "MaxSpeed", "batteryLife", "MaxTorque", "TurnSlip", "RideHeight"]),
        _NUMBERS,
    ),
    st.tuples(
        st.sampled_from(["Sensors", "AddParts", "MisPkgs", "JointParts", "Dimensions"]),
        st.builds(
            "(ItemName=a,ItemClass=class'USARBot.{}',Position=(X={},Z={}),Direction=(Y={}),"
            "PkgName=p,PkgClass=class'USARMisPkg.CameraPanTilt',Location=(Y={}),"
            "PartName=b,JointClass=class'KDHinge',ParentPos=(X={}),MaxRange={})".format,
            st.sampled_from(["Sonar", "RangeScanner", "Encoder", "RobotCamera", "Odometry"]),
            *6 * [_NUMBERS],
        ),
    ),
)


def robot_or_error(path: Path) -> tuple[RobotDescription | None, ConfigError | None]:
    try:
        return read_robot(path)[0], None
    except ConfigError as error:
        return None, error


@settings(derandomize=True, max_examples=150, deadline=None)
@given(st.lists(_LINES, max_size=4))
def test_robot_when_arbitrary_is_read_near_itself_or_rejected(
    tmp_path_factory: pytest.TempPathFactory, lines: list[tuple[str, str]]
) -> None:
    text = BARE + "".join(f"{key}={value}\n" for key, value in lines)
    path = write_file(tmp_path_factory.getbasetemp(), text)
    robot, error = robot_or_error(path)
    assert error is None or str(path) in str(error)
    if robot is not None:
        cameras = [camera.mount.position_m for camera in robot.perspective_cameras]
        links = [link.position_m for p in robot.mission_packages for link in p.links]
        positions = np.array([*cameras, *links, robot.drive.dimensions_m])
        assert np.abs(positions).max() <= 100.0


def test_robots_that_are_not_served_are_found(tmp_path: Path) -> None:
    path = tmp_path / "robots.ini"
    path.write_text(
        OMNI_ROBOT.read_text(encoding="utf-8")
        + "[USARBot.Talon]\nSensors=(ItemClass=class'USARBot.Sonar',ItemName=\"S\")\n"
        + "[USARBot.P2DX]\nbatteryLife=100\n[USARBot.Sonar]\nMaxRange=5\n"
    )
    robots, file = read_robots(path)
    assert [robot.class_name for robot in robots] == ["USARBot.OmniP2AT", "USARBot.P2DX"]
    assert find_unserved_robots(file) == ["USARBot.Talon"]


def test_robot_may_be_based_on_a_bundled_name(tmp_path: Path) -> None:
    path = tmp_path / "mine.ini"
    path.write_text("[Configuration]\nBasedOn=p2at_omni\n[USARBot.OmniP2AT]\nMass=20\n")
    robot, _ = read_robot(path)
    assert (robot.class_name, robot.drive.mass_kg) == ("USARBot.OmniP2AT", 20.0)
    path.write_text("[Configuration]\nBasedOn=p2at_omnii\n")
    with pytest.raises(ConfigError, match="bundled robots: kenaf, legacy"):
        read_robot(path)
