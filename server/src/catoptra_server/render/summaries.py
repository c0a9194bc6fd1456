"""What the exposures of one scene can show at most: what never changes is found only once.

Who asks for light alone pays for no distances. Distances, speeds and rates are rounded outward, so
that frames of a robot that drives have the same summary for a while (`coarse`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.render import coarse
from catoptra_server.render.bodies_around import BodiesAround
from catoptra_server.render.brightness import largest_radiance
from catoptra_server.render.extent import Extent
from catoptra_server.render.own_reach import own_reach
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.rings import rings_of
from catoptra_server.render.shadow_bounds import ShadowBounds
from catoptra_server.render.staging import scene_motion
from catoptra_server.render.surroundings import Surroundings, axis_of, turn_to
from catoptra_server.scene.bodies import Body
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh


class SceneSummaries:
    """The summaries of one world; every renderer has one."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._world = world
        self._surroundings = Surroundings(scene)
        self._extent = Extent(scene)
        self._bodies = BodiesAround()
        self._shadows = ShadowBounds(scene, world)

    @cached_property
    def largest_radiance(self) -> float:
        """Return the brightest light that the scene can show; found when it is first asked for."""
        return largest_radiance(self._scene, self._world)

    def of_light(self) -> SceneSummary:
        """Return what every exposure can show at most, as far as light goes."""
        return SceneSummary(self.largest_radiance)

    def of(self, exposure: Exposure, camera: OmniCamera) -> SceneSummary:
        """Return what an exposure can show at most.

        Its farthest distance is infinite: that no picture shows the background could be told of
        closed rooms alone, and the shipped ones are made of walls that only touch.
        """
        own = own_reach(exposure, camera)
        summary = SceneSummary(
            self.largest_radiance,
            self._surroundings.nearest_m(exposure.world_from_mirror, camera),
            farthest_m=self._extent.farthest_m(
                exposure.world_from_mirror.translation, _with_own(exposure)
            ),
            background=self._world.background,
            motion=coarse.twist(scene_motion(exposure)),
            own_body_rad=own.angle_rad,
            own_body_m=own.nearest_m,
            largest_shadow=self._shadows.of(exposure.bodies),
            own_shadow=self._shadows.of(_with_own(exposure)),
        )
        return self._with_bodies(summary, exposure, camera) if exposure.bodies else summary

    def _with_bodies(
        self, summary: SceneSummary, exposure: Exposure, camera: OmniCamera
    ) -> SceneSummary:
        pose = exposure.world_from_mirror
        turn, rings = turn_to(axis_of(pose)), rings_of(camera)
        around = self._bodies.of(exposure.bodies, pose.translation, turn, rings)
        nearest = map(min, summary.nearest_m, coarse.down(around.nearest_m.tolist()))
        passing = coarse.up(around.passing_rad_s.tolist())
        return replace(summary, nearest_m=tuple(nearest), passing_rad_s=passing)


def _with_own(exposure: Exposure) -> tuple[Body, ...]:
    own = () if exposure.own_body is None else (exposure.own_body,)
    return (*exposure.bodies, *own)
