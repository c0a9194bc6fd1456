"""Ranges of all pixels as an effect receives them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import ImageEffect
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import Item, Material, Rectangle, World
from helpers.effect_measurement import CAMERA, make_effect
from helpers.worlds import make_plan

Ranges = npt.NDArray[np.float32]
VIEWPOINT_HEIGHT_M = 0.8
FLOOR = World("plain", (Item("floor", Rectangle((40, 40)), Pose.identity(), Material((1, 1, 1))),))
CAMERA_ABOVE_FLOOR = CameraState(Pose.from_rpy((0.0, 0.0, -VIEWPOINT_HEIGHT_M)))


class RangeRecorder:
    """An effect that changes nothing and records its ranges."""

    name = "RangeRecorder"
    needs_range = True

    def __init__(self, effect: ImageEffect) -> None:
        self._effect = effect
        self.range_m: Ranges | None = None

    def __getattr__(self, name: str) -> object:
        return getattr(self._effect, name)

    def apply(self, light: object, camera: object, capture: object) -> object:
        self.range_m = capture.range_m  # type: ignore[attr-defined]
        return light


def trace_ranges(world: World, camera_state: CameraState, mesh: SceneMesh | None = None) -> Ranges:
    renderer = TraceRenderer(mesh or build_scene(world), world, threads=2)
    recorder = RangeRecorder(make_effect("Vignetting"))
    renderer.prepare(CAMERA, make_plan(CAMERA)).render(camera_state, (recorder,))  # type: ignore[arg-type]
    renderer.close()
    assert recorder.range_m is not None
    return recorder.range_m
