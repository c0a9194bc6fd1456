"""A part with constant replies to GETCONF and GETGEO: most sensors."""

from __future__ import annotations

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.reports import AnyConfiguration, GeometryItem
from catoptra_server.robot.mount import Mount


@dataclass(frozen=True, slots=True)
class MountedPart:
    """A named part on a mount."""

    type: str
    name: str
    mount: Mount
    configuration_report: AnyConfiguration

    def configuration(self) -> AnyConfiguration:
        """Reply to GETCONF."""
        return self.configuration_report

    def geometry(self) -> GeometryItem:
        """Reply to GETGEO: pose and parent of the mount."""
        # The pose in the frame of the parent, not of the robot, as USARSim reports parts.
        mount = self.mount
        return GeometryItem(self.name, mount.position_m, mount.rotation_rad, mount.parent)
