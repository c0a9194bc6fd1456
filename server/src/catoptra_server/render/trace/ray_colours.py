"""From rays to the colours of pixels: the part that all of trace's views share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.trace.embree_scene import EmbreeScene, Places
from catoptra_server.render.trace.moving_bodies import BodyScenes, PlacedBody, body_hits
from catoptra_server.render.trace.packed_light import Colours, Float32s, Packed, Scale

SeenHits = tuple[npt.NDArray[np.intp], Packed]
_NO_HITS: SeenHits = (np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.uint64))


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """An exposure as rays need it: turned directions are `mirror @ rotation`, from `origin`."""

    rotation: Float32s
    origin: Float32s
    bodies: tuple[PlacedBody, ...]


class Colouring(Protocol):
    """What the rays of a scene bring back.

    channel, pixel: what a colour and a whole pixel are stored as.
    """

    scene: EmbreeScene
    channel: np.dtype[np.uint8] | np.dtype[np.float32]
    pixel: np.dtype[np.void]

    def placed(self, exposure: Exposure) -> Placement:
        """Return what does not change within an exposure."""

    def varies(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """Return (n,) whether light varies over triangles; -1 is the background."""

    def of_rays(
        self, directions: Float32s, placement: Placement, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples, 3) rays; those beside are black."""

    def of_places(
        self, triangle: npt.NDArray[np.int32], places: Places, placement: Placement
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples,) known places on triangles."""

    def of_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """Return the (n, 3) colours of pixels that triangles, or the background (-1), fill."""


class RayColours:
    """A scene's light on a scale: finished greys, or linear light.

    channel, pixel: what a colour and a whole pixel are stored as.
    """

    def __init__(self, scene: EmbreeScene, bodies: BodyScenes, scale: Scale) -> None:
        self.scene = scene
        self._bodies = bodies
        self._scale = scale
        self.channel = scale.channel
        # A pixel's bytes as one element: twice as fast as rows of three to look up and to scatter.
        self.pixel = np.dtype(f"V{3 * scale.channel.itemsize}")
        self._table = scene.light_table(self._scale)
        # Of a scene without textures and point lights, one sample a pixel is one look-up.
        self._is_looked_up = scale.samples == 1 and not scene.light_varies
        self._colour_of_triangle = self._scale.colours(self._table).view(self.pixel).reshape(-1)

    def placed(self, exposure: Exposure) -> Placement:
        """Return what does not change within an exposure."""
        pose = exposure.world_from_mirror
        return Placement(
            pose.rotation.T.astype(np.float32),
            (pose.translation - self.scene.origin).astype(np.float32),
            self._bodies.placed(exposure.bodies, pose.translation, self._scale),
        )

    def of_rays(
        self, directions: Float32s, placement: Placement, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples, 3) rays; those beside are black."""
        directions = directions @ placement.rotation
        rays, of_bodies = self._seen_bodies(directions, placement)
        if self._is_looked_up and not len(rays) and not len(off_mirror):
            origins = np.broadcast_to(placement.origin, directions.shape)
            triangle = self.scene.met(origins, directions)
            whole = self._colour_of_triangle.take(triangle, mode="wrap")
            known: Colours = whole.view(self.channel).reshape(-1, 3)
            return known
        light = self._scene_light(directions, placement, besides=rays)
        light[rays] = of_bodies
        light[off_mirror] = 0
        return self._encoded(light)

    def varies(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """Return (n,) whether light varies over triangles; -1 is the background."""
        return self.scene.varies(triangle)

    def of_places(
        self, triangle: npt.NDArray[np.int32], places: Places, placement: Placement
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples,) known places on triangles."""
        light = self.scene.place_light(triangle, places, table=self._table, scale=self._scale)
        return self._encoded(light)

    def of_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """Return the (n, 3) colours of pixels that triangles, or the background (-1), fill."""
        light = self._table.take(triangle, mode="wrap") * np.uint64(self._scale.samples)
        return self._scale.colours(light)

    def _encoded(self, light: Packed) -> Colours:
        return self._scale.colours(self._scale.pixel_sums(light))

    def _seen_bodies(self, directions: Float32s, placement: Placement) -> SeenHits:
        """Return the rays that meet a body which the scene does not hide, and its light."""
        if not placement.bodies:
            return _NO_HITS
        met = body_hits(placement.bodies, directions, self._scale)
        return seen_hits(met, directions, scene=self.scene, origin=placement.origin)

    def _scene_light(
        self, directions: Float32s, placement: Placement, *, besides: npt.NDArray[np.intp]
    ) -> Packed:
        """Return the (n,) light that the scene has along rays; some need not be asked."""
        look_up = partial(self.scene.hit_light, table=self._table, scale=self._scale)
        if not len(besides):
            return look_up(np.broadcast_to(placement.origin, directions.shape), directions)
        is_asked = np.ones(len(directions), dtype=bool)
        is_asked[besides] = False
        light: Packed = np.zeros(len(directions), dtype=np.uint64)
        along = directions[is_asked]
        light[is_asked] = look_up(np.broadcast_to(placement.origin, along.shape), along)
        return light


def seen_hits(
    met: tuple[npt.NDArray[np.intp], Float32s, Packed],
    directions: Float32s,
    *,
    scene: EmbreeScene,
    origin: Float32s,
) -> SeenHits:
    """Return those of the rays that met a body which the scene does not hide, and their light."""
    rays, distance, of_bodies = met
    if not len(rays):
        return _NO_HITS
    along = directions[rays]
    hidden = scene.hidden(np.broadcast_to(origin, along.shape), along, distance)
    return rays[~hidden], of_bodies[~hidden]


def replace_hits(
    light: Packed,
    met: tuple[npt.NDArray[np.intp], Float32s, Packed],
    directions: Float32s,
    *,
    scene: EmbreeScene,
    origin: Float32s,
) -> None:
    """Replace the light of rays that met a body which the scene does not hide."""
    rays, of_bodies = seen_hits(met, directions, scene=scene, origin=origin)
    light[rays] = of_bodies
