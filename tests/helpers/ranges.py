"""How far away is what each pixel sees, as an effect is told it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.frames import Pose
from catoptra_server.effects.effect import Effect
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.scene.description import Item, Material, Rectangle, World
from catoptra_server.scene.meshes import build_scene
from helpers.effects import CAMERA, effect_of
from helpers.worlds import raster_plan

Ranges = npt.NDArray[np.float32]
EYE_M = 0.8
FLOOR = World("plain", (Item("floor", Rectangle((40, 40)), Pose.identity(), Material((1, 1, 1))),))
ABOVE = Exposure(Pose.from_rpy((0.0, 0.0, -EYE_M)))


class Asking:
    """An effect that changes nothing and keeps the ranges that it is told."""

    uses_range = True

    def __init__(self, effect: Effect) -> None:
        self._effect = effect
        self.seen: Ranges | None = None

    def __getattr__(self, name: str) -> object:
        return getattr(self._effect, name)

    def apply(self, light: object, camera: object, capture: object) -> object:
        self.seen = capture.range_m  # type: ignore[attr-defined]
        return light


def traced(world: World, exposure: Exposure) -> Ranges:
    renderer = TraceRenderer(build_scene(world), world, threads=2)
    asking = Asking(effect_of("Vignetting"))
    renderer.prepare(CAMERA, raster_plan(CAMERA)).draw(exposure, (asking,))  # type: ignore[arg-type]
    renderer.close()
    assert asking.seen is not None
    return asking.seen
