"""What a renderer is: prepared once for a camera and a plan, then drawn for every exposure.

To add one, implement these two protocols in a folder of its own and add a line to `choice.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.render.render_plan import RenderPlan

Image = npt.NDArray[np.uint8]  # (h, w, 3) sRGB, row 0 at the top
LinearImage = npt.NDArray[np.float32]  # (h, w, 3) linear light, 1 = white, row 0 at the top


@dataclass(frozen=True, slots=True, eq=False)
class RenderedImage:
    """A finished picture: (h, w, 3) uint8 RGB, read-only, and the milliseconds of each stage.

    effects: what was decided about each that the robot's file names, by who had it drawn.
    """

    rgb: Image
    stage_ms: dict[str, float]
    effects: tuple[EffectDecision, ...] = ()


@dataclass(frozen=True, slots=True)
class FaceCamera:
    """One virtual camera on its own: a square picture of 90 degrees; `face` indexes `Face`."""

    face: int
    size_px: int

    @property
    def perspective_camera(self) -> PerspectiveCamera:
        """Return the camera that it is, were its frame not turned."""
        return PerspectiveCamera(self.size_px, self.size_px, 0.5 * math.pi)

    @property
    def mirror_from_camera(self) -> Floats:
        """Return the (3, 3) rotation of its frame in the mirror frame."""
        axes: Floats = MIRROR_FROM_FACE_ROTATIONS[self.face]
        return axes


class View(Protocol):
    """A camera that is ready to be drawn. Everything that does not change was computed before."""

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Return the picture of an exposure."""

    def close(self) -> None:
        """Free what the view holds."""


class OmniView(View, Protocol):
    """A view whose picture can be changed by effects, in linear light, before it is encoded.

    What they need is built when they are first asked for; without any it is what it always is.
    """

    def render(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> RenderedImage:
        """Return the picture of an exposure as effects change it, one after the other."""

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Return the picture of an exposure behind all effects, before it is encoded."""


class Renderer(Protocol):
    """A scene on a device, able to prepare views of it."""

    def describe(self) -> str:
        """Return what draws, for logs: library, device, threads."""

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> OmniView:
        """Return a view of the scene by an omnidirectional camera."""

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> View:
        """Return a view of the scene by an ordinary camera, samples^2 a pixel."""

    def prepare_face(self, camera: FaceCamera, samples: int) -> View:
        """Return a view of the scene by one of the cube's virtual cameras."""

    def close(self) -> None:
        """Free the device."""
