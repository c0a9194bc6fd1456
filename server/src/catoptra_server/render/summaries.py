"""What the exposures of one scene can show at most: what never changes is found only once."""

from __future__ import annotations

from functools import cached_property

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.render.brightness import largest_radiance
from catoptra_server.render.own_reach import own_reach
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.staging import captured
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh


class SceneSummaries:
    """The summaries of one world; every renderer has one."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._world = world

    @cached_property
    def largest_radiance(self) -> float:
        """Return the brightest light that the scene can show; found when it is first asked for."""
        return largest_radiance(self._scene, self._world)

    def of(self, exposure: Exposure, camera: OmniCamera) -> SceneSummary:
        """Return what an exposure can show at most."""
        own = own_reach(exposure, camera)
        return SceneSummary(
            self.largest_radiance,
            motion=captured(exposure).motion[0],
            own_body_rad=own.angle_rad,
            own_body_m=own.nearest_m,
        )
