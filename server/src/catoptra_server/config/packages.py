"""The mission packages of a robot's section: `MisPkgs=(PkgName=..,Location=..,PkgClass=..)`.

A class with a section of its own lists its joints there, a file's own extension:
`Links=(Name="CameraPan",Parent=-1,Position=..,Direction=..,MaxSpeed=..,MaxTorque=..,MinRange=..,
MaxRange=..)`. Without one it is the pan-tilt head of UT2004's robots.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.settings import Settings
from catoptra_server.robot.mission_package import (
    KNOWN_PACKAGES,
    LinkDescription,
    MissionPackageDescription,
)

log = logging.getLogger(__name__)


def read_packages(file: IniFile, robot: Settings) -> tuple[MissionPackageDescription, ...]:
    """Return the packages of a robot's section that have joints."""
    found = (_package(file, struct) for struct in robot.structs("MisPkgs"))
    return tuple(package for package in found if package is not None)


def _package(file: IniFile, struct: Settings) -> MissionPackageDescription | None:
    name, class_ = struct.word("PkgName"), struct.text("PkgClass")
    section = file.section(class_)
    if section.has("Links"):
        links = tuple(_link(link) for link in section.structs("Links"))
    else:
        known = KNOWN_PACKAGES.get(class_.rpartition(".")[2].lower())
        if known is None:
            # The omni camera's pillar is one: it has no joints.
            log.info("%s: package %s of class %s has no joints", struct.where, name, class_)
            return None
        links = known.links
    location = struct.vector("Location", links[0].position_m)
    return MissionPackageDescription(name, (replace(links[0], position_m=location), *links[1:]))


def _link(link: Settings) -> LinkDescription:
    return LinkDescription(
        name=link.word("Name"),
        parent=int(link.number("Parent", -1.0, at_least=-1.0, at_most=64.0)),
        position_m=link.vector("Position", (0.0, 0.0, 0.0)),
        rotation_rad=link.vector("Direction", (0.0, 0.0, 0.0)),
        max_speed_rad_s=link.number("MaxSpeed", 0.17, at_least=0.0, at_most=100.0),
        max_torque=link.number("MaxTorque", 20.0, at_least=0.0),
        min_rad=link.number("MinRange", 1.0),
        max_rad=link.number("MaxRange", 0.0),
    )
