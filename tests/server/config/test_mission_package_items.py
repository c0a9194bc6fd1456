"""Mission packages of robot files."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_file import read_robot
from catoptra_server.simulation.joint_chain import MissionPackageDescription

HEAD = (
    'MisPkgs=(PkgName="CameraPanTilt",Location=(Y=0.0,X=0.1,Z=-0.3),'
    "PkgClass=class'USARMisPkg.{}')\n"
)


def read(folder: Path, text: str) -> tuple[MissionPackageDescription, ...]:
    path = folder / "robot.ini"
    path.write_text("[USARBot.P2AT]\n" + text, encoding="utf-8")
    return read_robot(path)[0].mission_packages


def test_package_when_known_has_the_joints_of_ut2004_at_its_location(tmp_path: Path) -> None:
    (package,) = read(tmp_path, HEAD.format("CameraPanTilt"))
    assert [link.name for link in package.links] == ["CameraPan", "CameraTilt"]
    assert package.links[0].position_m == (0.1, 0.0, -0.3)


def test_package_when_its_section_lists_links_has_those(tmp_path: Path) -> None:
    links = '[USARMisPkg.Arm]\nLinks=(Name="Elbow",Parent=-1,MaxSpeed=2,MinRange=-1,MaxRange=1)\n'
    (package,) = read(tmp_path, HEAD.format("Arm") + links)
    (link,) = package.links
    assert (link.name, link.max_speed_rad_s, link.clamp(9.0)) == ("Elbow", 2.0, 1.0)


def test_package_when_without_joints_is_left_out(tmp_path: Path) -> None:
    assert read(tmp_path, HEAD.format("OmniCamPillar")) == ()


@pytest.mark.parametrize("key", ["Location", "Position"])
def test_package_when_far_from_the_robot_is_rejected(tmp_path: Path, key: str) -> None:
    link = 'Links=(Name="Elbow",Parent=-1,Position=(X=0))'
    text = f"{HEAD.format('Arm')}[USARMisPkg.Arm]\n{link}\n"
    near = {"Location": "X=0.1,", "Position": "X=0)"}[key]
    text = text.replace(near, f"X=5000{near[-1]}")
    with pytest.raises(ConfigError, match=f"{key}=.*within 100 m"):
        read(tmp_path, text)
