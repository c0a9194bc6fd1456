"""The renderer protocol: a view is prepared once for a camera and a plan, then rendered per frame.

To add a renderer, implement Renderer and View in a folder of its own and add a line to
`planning/renderer_choice.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from types import MappingProxyType
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.world.camera_state import CameraState

Image = npt.NDArray[np.uint8]  # (h, w, 3) sRGB, row 0 at the top
LinearImage = npt.NDArray[np.float32]  # (h, w, 3) linear light, 1 = white, row 0 at the top


NO_THRESHOLDS: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class RenderedImage:
    """A finished image."""

    rgb: Image
    """(h, w, 3) uint8 sRGB, read-only."""
    stage_ms: dict[str, float]
    """Milliseconds by stage."""
    changes: Mapping[str, float] = field(default_factory=dict)
    """Largest change of any pixel by effect, encoded grey levels, as this very frame has it: of
    the effects with a threshold that the renderer measures. Of an exposure that motion blurs, that
    of its sharp frame in the middle; where shadows change that by at most their threshold, their
    change at any instant that the blur draws."""


@dataclass(frozen=True, slots=True)
class FaceCamera:
    """One virtual camera of the cube: a square image of 90 degrees."""

    face: int
    """Index into Face."""
    size_px: int
    """Pixels along the image's side."""

    @property
    def perspective_camera(self) -> PerspectiveCamera:
        """Camera of the same image in a frame of its own."""
        # A face spans 90 degrees, so that six of them close around the viewpoint.
        return PerspectiveCamera(self.size_px, self.size_px, 0.5 * math.pi)

    @property
    def mirror_from_camera(self) -> Floats:
        """(3, 3) rotation of the camera's frame in the mirror frame."""
        axes: Floats = MIRROR_FROM_FACE_ROTATIONS[self.face]
        return axes


class View(Protocol):
    """A camera that is ready to be rendered: all constants of the view are precomputed.

    Image effects change the image in linear light, before it is encoded. Their resources are built
    at their first use; without effects the image is encoded directly.
    """

    @property
    def memory_bytes(self) -> int:
        """Size of the view's arrays, in memory and on the device; grows as effects are used."""

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects in their order.

        Args:
            camera_state: State of the exposure.
            effects: Image effects.
            thresholds: Change in encoded grey levels, by name of a scene or image effect, that
                nobody sees: cells of the image that the effect changes by at most as much may be
                drawn without it. Effects without a threshold are drawn everywhere.
        """

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""

    def close(self) -> None:
        """Free the view's resources."""


class Renderer(Protocol):
    """A scene on a device that prepares views."""

    def describe(self) -> str:
        """One-line description for logs: library, device, threads."""

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> View:
        """Prepare a view of an omnidirectional camera."""

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> View:
        """Prepare a view of a perspective camera; samples: along a side of each pixel."""

    def prepare_face(self, camera: FaceCamera, samples: int) -> View:
        """Prepare a view of one virtual camera of the cube; samples: along a side of each pixel."""

    def close(self) -> None:
        """Free the device."""
