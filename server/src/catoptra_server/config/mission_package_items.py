"""The mission packages of a robot's section: `MisPkgs=(PkgName=..,Location=..,PkgClass=..)`.

A class with a section of its own lists its joints there, a file's own extension:
`Links=(Name="CameraPan",Parent=-1,Position=..,Direction=..,MaxSpeed=..,MaxTorque=..,MinRange=..,
MaxRange=..)`. Without one it is the pan-tilt head of UT2004's robots.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.robot.joint_chain import (
    STANDARD_PACKAGES,
    LinkDescription,
    MissionPackageDescription,
)

log = logging.getLogger(__name__)


def read_mission_packages(
    file: IniFile, robot: SectionReader
) -> tuple[MissionPackageDescription, ...]:
    """Return the packages of a robot's section that have joints."""
    found = (_read_package(file, struct) for struct in robot.get_structs("MisPkgs"))
    return tuple(package for package in found if package is not None)


def _read_package(file: IniFile, struct: SectionReader) -> MissionPackageDescription | None:
    name, class_ = struct.get_wire_name("PkgName"), struct.get_str("PkgClass")
    section = file.get_section(class_)
    if section.has_key("Links"):
        links = tuple(_read_link(link) for link in section.get_structs("Links"))
    else:
        known = STANDARD_PACKAGES.get(class_.rpartition(".")[2].lower())
        if known is None:
            # The omni camera's pillar is one: it has no joints.
            log.info("%s: package %s of class %s has no joints", struct.where, name, class_)
            return None
        links = known.links
    location = struct.get_vector("Location", links[0].position_m)
    return MissionPackageDescription(name, (replace(links[0], position_m=location), *links[1:]))


def _read_link(link: SectionReader) -> LinkDescription:
    return LinkDescription(
        name=link.get_wire_name("Name"),
        parent=int(link.get_float("Parent", -1.0, min_value=-1.0, max_value=64.0)),
        position_m=link.get_vector("Position", (0.0, 0.0, 0.0)),
        rotation_rad=link.get_vector("Direction", (0.0, 0.0, 0.0)),
        max_speed_rad_s=link.get_float("MaxSpeed", 0.17, min_value=0.0, max_value=100.0),
        max_torque=link.get_float("MaxTorque", 20.0, min_value=0.0),
        min_rad=link.get_float("MinRange", 1.0),
        max_rad=link.get_float("MaxRange", 0.0),
    )
