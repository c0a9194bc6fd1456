"""A scene on the device whose lights cast shadows: another look of its corners, and maps.

Facets carry the light of the sky alone; each fragment adds what reaches it of the other lights.
"""

from __future__ import annotations

import moderngl

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render import shading
from catoptra_server.render.chunks import Chunks
from catoptra_server.render.raster.frame_uniforms import FrameUniforms
from catoptra_server.render.raster.moving_bodies import MovingBodies
from catoptra_server.render.raster.programs import Programs
from catoptra_server.render.raster.scene_look import Attribute, FacetLight, SceneLook
from catoptra_server.render.raster.shadow_maps import ShadowMaps
from catoptra_server.scene.bodies import Body
from catoptra_server.scene.description import Light
from catoptra_server.scene.meshes import SceneMesh


class ShadowedScene:
    """The look, the bodies and the maps of a world with shadows. Arguments as of `SceneBuffers`."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        scene: SceneMesh,
        lights: tuple[Light, ...],
        *,
        chunks: Chunks,
        position: Attribute,
        origin: Floats,
    ) -> None:
        self._origin = origin
        self._maps = ShadowMaps(
            context, programs, scene, shading.hideable_lights(lights), origin=origin
        )
        light = FacetLight(shading.sky_lights(lights), self._maps.define)
        self.bodies = MovingBodies(context, programs, light, origin)
        self._look = SceneLook(context, programs, scene, chunks, position=position, light=light)

    def cast(self, bodies: tuple[Body, ...]) -> None:
        """Draw the maps of an exposure's bodies; what stands was drawn once."""
        self._maps.draw_bodies(bodies)

    def place(self, viewpoint: Floats, depth: tuple[float, float]) -> None:
        """Set the uniforms of a frame: a (3,) viewpoint in the scene's frame, and z = a w + b."""
        frame = FrameUniforms.of(viewpoint, depth, lights=(), origin=self._origin)
        for program in self._look.programs | self.bodies.programs:
            frame.set_on(program)
            self._maps.set_on(program, viewpoint)
        self._maps.use()

    def draw(self, clip_from_scene: Floats, visible: Bools) -> int:
        """Draw the visible chunks through a (3, 3) map to clip x, y, w; return the draw calls."""
        return self._look.draw(clip_from_scene, visible)

    def close(self) -> None:
        """Free all of it; the corners belong to the scene."""
        self.bodies.close()
        self._look.close()
        self._maps.close()
