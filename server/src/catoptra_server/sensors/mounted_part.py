"""A part whose answers never change: what most sensors are to GETCONF and GETGEO."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_protocol.usarsim.reports import AnyConfiguration, GeometryItem
from catoptra_server.robot.mount import Mount


@dataclass(frozen=True, slots=True)
class MountedPart:
    """A named part at a place, and what GETCONF is told of it."""

    type: str
    name: str
    mount: Mount
    configuration_report: AnyConfiguration

    def configuration(self) -> AnyConfiguration:
        """Return what is told."""
        return self.configuration_report

    def geometry(self) -> GeometryItem:
        """Return where it is mounted, and on what."""
        mount = self.mount
        return GeometryItem(self.name, mount.position_m, mount.rotation_rad, mount.parent)
