"""Mission packages of a robot's section: `MisPkgs=(PkgName=..,Location=..,PkgClass=..)`.

The class's section lists the joints, an extension of USARSim's form:
`Links=(Name="CameraPan",Parent=-1,Position=..,Direction=..,MaxSpeed=..,MaxTorque=..,MinRange=..,
MaxRange=..)`. USARSim has them in the class's source, so that STANDARD_PACKAGES describes the
pan-tilt head of UT2004's robots.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import require_on_robot
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.simulation.joint_chain import (
    STANDARD_PACKAGES,
    LinkDescription,
    MissionPackageDescription,
)

log = logging.getLogger(__name__)


def read_mission_packages(
    file: IniFile, robot: SectionReader
) -> tuple[MissionPackageDescription, ...]:
    """Packages with joints of a robot's section, in order; packages without joints are logged."""
    packages = (_read_package(file, struct) for struct in robot.get_structs("MisPkgs"))
    return tuple(package for package in packages if package is not None)


def _read_package(file: IniFile, struct: SectionReader) -> MissionPackageDescription | None:
    name, class_ = struct.get_wire_name("PkgName"), struct.get_str("PkgClass")
    section = file.get_section(class_)
    if section.has_key("Links"):
        links = tuple(_read_package_link(link) for link in section.get_structs("Links"))
    else:
        standard = STANDARD_PACKAGES.get(class_.rpartition(".")[2].lower())
        if standard is None:
            # No warning: the omnidirectional camera's pillar, for one, is a package without joints.
            log.info("%s: package %s of class %s has no joints", struct.where, name, class_)
            return None
        links = standard.links
    # Location mounts the package as a whole, by the joint of its first link.
    location = struct.get_vector("Location", links[0].position_m)
    require_on_robot(struct, "Location", location)
    return MissionPackageDescription(name, (replace(links[0], position_m=location), *links[1:]))


def _read_package_link(link: SectionReader) -> LinkDescription:
    position = link.get_vector("Position", (0.0, 0.0, 0.0))
    require_on_robot(link, "Position", position)
    return LinkDescription(
        name=link.get_wire_name("Name"),
        # -1 is the chassis; links are numbered from 1.
        parent=int(link.get_float("Parent", -1.0, min_value=-1.0, max_value=64.0)),
        position_m=position,
        rotation_rad=link.get_vector("Direction", (0.0, 0.0, 0.0)),
        max_speed_rad_s=link.get_float("MaxSpeed", 0.17, min_value=0.0, max_value=100.0),
        max_torque=link.get_float("MaxTorque", 20.0, min_value=0.0),
        # A minimum above the maximum means no limits, as USARSim's CONF lines print it.
        min_rad=link.get_float("MinRange", 1.0),
        max_rad=link.get_float("MaxRange", 0.0),
    )
