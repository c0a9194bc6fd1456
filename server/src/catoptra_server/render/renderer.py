"""The renderer protocol, and the data that every renderer works with.

A renderer holds a scene; a view is prepared once for a camera and a plan, then rendered per frame.
Here are the plan, the image, and what both renderers share about time: the milliseconds of stages,
and the sharp camera states of a long exposure. Plans are made in `frames/plan`.

To add a renderer, implement `Renderer` and `View` in a folder of its own and add a line to
`frames/renderers.py`.

The two renderers blur motion differently. Raster and the float64 reference take the weighted mean,
row by row, of sharp images at times a pixel of motion apart (`sample_shutter`). The kernel takes
the poses of the whole exposure (`trace_engine.camera_states`) and chooses the instants of each part
of the image. To spread one image along each pixel's displacement took 330 to 720 ms and was off by
1.3 to 2.3 grey levels rms; time samples leave 0.1 to 0.7
(`tests/server/render/test_motion_agreement.py`).

Render settings are what a robot's file requests of its camera; `frames/plan` makes a plan of these
numbers, or for the accuracy target.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from types import MappingProxyType
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import EffectChange, ImageEffect, Threshold
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState, DynamicObject, RowWeights
from catoptra_server.world.world_description import integrate_poses


@dataclass(frozen=True, slots=True)
class PerPixel:
    """Exact camera model in every sample, without a mirror mesh."""


MirrorSurface = PerPixel | Tessellation


def has_mesh_viewpoint(camera: OmniCamera) -> bool:
    """Whether a camera has a mirror with one viewpoint, for which a mesh can stand."""
    return camera.has_mirror and camera.mirror.is_central


def require_mesh_viewpoint(camera: OmniCamera) -> None:
    """Raise DomainError for a camera that no mirror mesh can stand for, of a file or a variant.

    Whether rays are approximated as central does not count: the mirror's surface is not the one
    whose mesh would be drawn.
    """
    if has_mesh_viewpoint(camera):
        return
    if not camera.has_mirror:
        raise DomainError("0 polygons: a mesh stands for a mirror, which this camera has not")
    raise DomainError(
        "0 polygons: a mesh looks up directions at one viewpoint, which this mirror has not"
    )


@dataclass(frozen=True, slots=True)
class AccuracyTarget:
    """Tolerance and time budget that a plan has to meet, in place of explicit settings.

    With both, the plan is the fastest within the tolerance; where no plan fits the budget, the
    most accurate within the budget.
    """

    max_error_px: float = 0.0
    """Largest displacement of any outline; 0 for no tolerance."""
    budget_ms: float = 0.0
    """Longest time of a frame; 0 for no budget."""

    def __post_init__(self) -> None:
        for name in ("max_error_px", "budget_ms"):
            value = getattr(self, name)
            # Clients set both by SET and by the stream: NaN would compare false with every cost.
            if not (math.isfinite(value) and value >= 0.0):
                raise DomainError(f"{name} must be 0 (no target) or more, not {value}")

    def with_changes(
        self, *, max_error_px: float | None, budget_ms: float | None
    ) -> AccuracyTarget:
        """Target with other values; None leaves a value unchanged.

        Raises:
            DomainError: A value is negative or not finite.
        """
        return AccuracyTarget(
            self.max_error_px if max_error_px is None else max_error_px,
            self.budget_ms if budget_ms is None else budget_ms,
        )

    @property
    def is_set(self) -> bool:
        """Whether a tolerance or a budget is set."""
        return self.max_error_px > 0.0 or self.budget_ms > 0.0


@dataclass(frozen=True, slots=True)
class RenderSettings:
    """Requested numbers of a plan; 0 leaves a number to the planner."""

    # 0 throughout for a number left to the planner: the ini file's form of an absent key.
    surface: MirrorSurface = PerPixel()
    samples: int = 0
    """Samples along a pixel's side; a pixel has samples^2 rays."""
    face_size_px: int = 0
    """Side of each face of the cube map around the viewpoint."""
    face_samples: int = 0
    """Samples along a texel's side of a face."""
    texels_per_px: float = 0.0
    """Density of the faces in their densest pixel, where no face size is set."""
    renderer: str = ""
    """`trace` or `raster`; empty for the server's choice."""
    central_error_px: float = 0.0
    """Error up to which rays of a mirror without a viewpoint are taken to meet in one, in frames
    without anything nearer; 0 for exact rays in all frames."""
    accuracy_target: AccuracyTarget = AccuracyTarget()
    """Where set, the planner chooses all numbers, whatever is requested above."""


Image = npt.NDArray[np.uint8]  # (h, w, 3) sRGB, row 0 at the top
LinearImage = npt.NDArray[np.float32]  # (h, w, 3) linear light, 1 = white, row 0 at the top
NO_THRESHOLDS: Mapping[str, Threshold] = MappingProxyType({})


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


class View(Protocol):
    """A camera that is ready to be rendered: all constants of the view are precomputed.

    Image effects change the image in linear light, before the encoding. Resources are built
    at their first use; without effects the image is encoded directly.
    """

    @property
    def memory_bytes(self) -> int:
        """Size of the view's arrays, in memory and on the device; grows as effects are used."""

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, Threshold] = NO_THRESHOLDS,
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects in their order.

        Args:
            camera_state: State of the exposure.
            effects: Image effects.
            thresholds: Change of the finished picture, by name of a scene or image effect, that
                nobody misses: cells of the image that the effect changes by at most its
                `plain_change` may be drawn without it. Effects without a threshold, or with a
                negative one, are drawn everywhere; the gains say how exactly.
        """

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""

    def close(self) -> None:
        """Free the view's resources."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedImage:
    """A finished image."""

    rgb: Image
    """(h, w, 3) uint8 sRGB, read-only."""
    stage_ms: dict[str, float]
    """Milliseconds by stage."""
    changes: Mapping[str, EffectChange] = field(default_factory=dict)
    """Change by effect, as this very frame has it: of the effects with a threshold that the
    renderer measures, inf of one that it only sees. Of an exposure that motion blurs, that of its
    sharp frame in the middle; where shadows change that by at most their threshold, their change
    at any instant that the blur draws."""


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


@dataclass(frozen=True, slots=True)
class RenderPlan:
    """Plan of one camera's frames."""

    renderer: RendererKind
    surface: MirrorSurface
    samples: int
    """Samples along a pixel's side; a pixel has samples^2."""
    face_size_px: int
    """Side of a whole face in the texels of the finest region; faces only."""
    face_samples: int
    """Samples of a face's texel; faces only."""
    faces: tuple[Face, ...]
    """Faces that the mirror sees."""
    face_regions: tuple[FaceRegion, ...]
    """Visible regions of the faces, with their texel densities."""
    reason: str
    """Reason for this plan, for the log."""

    def __post_init__(self) -> None:
        if not 1 <= self.samples <= 16:
            raise DomainError(f"samples must be 1 to 16 along a pixel's side, not {self.samples}")

    def __str__(self) -> str:
        return f"{self.description}: {self.reason}"

    @property
    def has_exact_rays(self) -> bool:
        """Whether each pixel has the ray of the camera model, not of a mirror mesh."""
        return isinstance(self.surface, PerPixel)

    @property
    def description(self) -> str:
        """All numbers of the plan in words, without the reason."""
        match self.surface:
            case PerPixel():
                surface = "per pixel"
            case Tessellation(sectors, rings, interpolation):
                surface = f"{sectors} x {rings} polygons ({interpolation.value})"
        details = ""
        if self.renderer.uses_faces:
            names = "".join(face.name for face in self.faces)
            details = f", faces {names} of {self.face_size_px} px"
            details += f" with {self.face_samples} samples each" if self.face_samples > 1 else ""
        return f"{self.renderer.value}, {surface}, {self.samples}^2 samples{details}"


@dataclass(frozen=True, slots=True)
class FaceRegion:
    """Window of a face, with the texel density in both directions."""

    face: Face
    window: FaceWindow
    columns_per_unit: float
    """Texel columns for one unit of s."""
    rows_per_unit: float
    """Texel rows for one unit of t."""

    @property
    def size_texels(self) -> tuple[float, float]:
        """Width and height in texels, not rounded."""
        window = self.window
        width = (window.right - window.left) * self.columns_per_unit
        return width, (window.bottom - window.top) * self.rows_per_unit

    @property
    def num_texels(self) -> float:
        """Number of texels, not rounded."""
        width, height = self.size_texels
        return width * height


@dataclass(frozen=True, slots=True)
class FaceWindow:
    """Rectangle on a face's plane: s from `left` to `right`, t from `top` to `bottom`."""

    left: float = -1.0
    top: float = -1.0
    right: float = 1.0
    bottom: float = 1.0

    @property
    def is_empty(self) -> bool:
        """Whether the window has no area."""
        return self.left >= self.right or self.top >= self.bottom


class StageClock:
    """Milliseconds by stage of one frame, each from the end of the stage before.

    `wait_for_device` blocks until the device has finished all queued work: without this call OpenGL
    only queues, and the whole frame would be charged to the readback. Waiting costs as much as the
    stages could have overlapped: nothing measurable on llvmpipe, which finishes one target after
    the other (tests/measurements/raster_faces.py).
    """

    def __init__(self, wait_for_device: Callable[[], None]) -> None:
        self._finish = wait_for_device
        self._last = time.perf_counter()
        self.stage_ms: dict[str, float] = {}

    def end_stage(self, stage: str) -> None:
        """Charge the time since the last stage's end to a stage."""
        self._finish()
        # perf_counter: monotonic, and its resolution is far below a stage of a tenth of a
        # millisecond.
        now = time.perf_counter()
        self.stage_ms[stage] = 1e3 * (now - self._last)
        self._last = now


def sample_shutter(
    camera_state: CameraState, num_rows: int
) -> list[tuple[CameraState, RowWeights]]:
    """Sharp camera states of an exposure, and the weight of each by row.

    Samples that weigh nothing in every row are left out. Without a shutter the only sample is the
    camera state itself.

    Args:
        camera_state: Camera state with its shutter.
        num_rows: Rows of the image.

    Returns:
        Pairs of a camera state without a shutter and (num_rows,) weights.
    """
    shutter = camera_state.shutter
    if shutter is None:
        return [(camera_state, np.ones(num_rows, dtype=np.float32))]
    weights = shutter.row_weights(num_rows)
    samples = zip(shutter.times_s, weights, strict=True)
    return [
        (advance(camera_state, time_s), row_weights)
        for time_s, row_weights in samples
        if row_weights.any()
    ]


def advance(camera_state: CameraState, time_s: float) -> CameraState:
    """Camera state at a later time, with camera and objects carried on by their own twists."""
    objects = camera_state.objects
    motions = [(one.world_from_object, one.twist) for one in objects]
    pose, *poses = integrate_poses(
        [(camera_state.world_from_mirror, camera_state.twist), *motions], time_s
    )
    # The noise seed stays: all samples belong to one exposure, which draws its noise once at the
    # end.
    return replace(
        camera_state,
        world_from_mirror=pose,
        objects=tuple(map(DynamicObject.with_pose, objects, poses)),
        shutter=None,
    )
