"""Cameras to render: camera models with settings, their variants, and the choice of a viewpoint.

A variant changes nothing of the camera that it belongs to: a viewer may try what accuracy and
effects cost while the robot's own client goes on with other frames.

A mirror without a viewpoint has a ray for each sample. Rays miss the best viewpoint by millimetres,
an angle that falls with the distance of the thing in view: from afar both are one. `Central=auto`
leaves the choice to each frame, by the nearest thing of the scene. From the near limit on, the
image errs by at most the allowed pixels.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from functools import lru_cache
from typing import TypeVar

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import CENTRAL_ERROR_PX, max_miss_m, near_limit_m
from catoptra_protocol.optics.elementary import arccos, arcsin, arctan, dot, matmul
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.requests import FrameVariant, Transform
from catoptra_server.effects import NO_EFFECT_SETTINGS, EffectMode, EffectSettings
from catoptra_server.render.renderer import (
    AccuracyTarget,
    MirrorSurface,
    PerPixel,
    RenderSettings,
    require_mesh_viewpoint,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.world.objects import CameraState


@dataclass(frozen=True, slots=True)
class OmniCameraSpec:
    """An omnidirectional camera with the settings under which frames are rendered."""

    camera: OmniCamera
    render_settings: RenderSettings
    effect_settings: EffectSettings = NO_EFFECT_SETTINGS


@dataclass(frozen=True, slots=True)
class PerspectiveCameraSpec:
    """A perspective camera with the effects of the frames."""

    camera: PerspectiveCamera
    effect_settings: EffectSettings = NO_EFFECT_SETTINGS


# Compared by value: robots of one class share a plan and a prepared view.
CameraSpec = OmniCameraSpec | PerspectiveCameraSpec


POLYGON_COUNTS = (16, 64, 256, 1024, 4096)
"""Mirror meshes of a variant, as in the paper. Finer ones take seconds to prepare."""
# 4 x 4 samples are the finest level of the study of accuracy and cost.
MAX_SAMPLES = 4
_MAX_EFFECTS = 64
# Rotations of peers: products of them deviate by some 1e-15, texts of 6 digits by 1e-6.
_ROTATION = 1e-5
_MAX_COORDINATE_M = 1e6

_EnumT = TypeVar("_EnumT", bound=Enum)


class ReferenceKind(Enum):
    """Frame that the frame of a variant is compared with."""

    EXACT = "exact"
    """The exact model in 4 x 4 samples a pixel, with the effects of the variant."""
    CAMERA = "camera"
    """The camera's own settings."""


# Faces have texels of their own: rays alone show the model in every sample.
_EXACT_RENDERER = next(kind for kind in RendererKind if not kind.uses_faces)
_EXACT = RenderSettings(samples=MAX_SAMPLES, renderer=_EXACT_RENDERER.value)


@dataclass(frozen=True, slots=True)
class CameraVariant:
    """Changes of a camera's settings; None leaves a value unchanged."""

    max_error_px: float | None = None
    """Tolerance; 0 for none."""
    budget_ms: float | None = None
    """Time budget of a frame; 0 for none."""
    polygons: int | None = None
    """One of POLYGON_COUNTS; 0 for the exact model in every sample."""
    samples: int | None = None
    """Samples along a pixel's side."""
    renderer: RendererKind | None = None
    effects: tuple[tuple[str, EffectMode], ...] = ()
    """Modes of effects by name."""
    reference: ReferenceKind | None = None
    picture: Picture | None = None
    """Hand of the image: the finished picture is turned round, with any effects."""
    world_from_robot: Transform | None = None
    """Pose of the robot in the image."""
    channels: tuple[str, ...] = ()
    """Channels of labels beside the picture, by name."""

    def __post_init__(self) -> None:
        AccuracyTarget().with_changes(max_error_px=self.max_error_px, budget_ms=self.budget_ms)
        if self.polygons not in (None, 0, *POLYGON_COUNTS):
            known = ", ".join(map(str, (0, *POLYGON_COUNTS)))
            raise DomainError(f"a mirror of {self.polygons} polygons: expected one of {known}")
        if self.samples is not None and not 1 <= self.samples <= MAX_SAMPLES:
            raise DomainError(f"samples are 1 to {MAX_SAMPLES} along a side, not {self.samples}")
        if len(self.effects) > _MAX_EFFECTS:
            raise DomainError(f"modes of {len(self.effects)} effects: at most {_MAX_EFFECTS}")
        if self.world_from_robot is not None:
            rows = np.reshape(self.world_from_robot.rotation, (3, 3))
            with np.errstate(over="ignore", invalid="ignore"):
                is_rotation = np.allclose(matmul(rows, rows.T), np.eye(3), rtol=0.0, atol=_ROTATION)
            if not is_rotation or dot(np.cross(rows[0], rows[1]), rows[2]) < 0.0:
                raise DomainError("the pose of the image has no rotation")
            if max(map(abs, self.world_from_robot.position_m)) > _MAX_COORDINATE_M:
                raise DomainError(f"the pose of the image is beyond {_MAX_COORDINATE_M:g} m")

    @classmethod
    def from_request(cls, request: FrameVariant) -> CameraVariant:
        """Variant that a client requests, modes of effects in the order of their names.

        Raises:
            DomainError: A name is unknown, or a number out of range.
        """
        return cls(
            max_error_px=request.max_error_px,
            budget_ms=request.budget_ms,
            polygons=request.polygons,
            samples=request.samples,
            effects=tuple(
                (name, _parse(EffectMode, mode, "mode"))
                for name, mode in sorted((request.effects or {}).items())
            ),
            renderer=None
            if request.renderer is None
            else _parse(RendererKind, request.renderer, "renderer"),
            reference=None
            if request.reference is None
            else _parse(ReferenceKind, request.reference, "reference"),
            picture=None
            if request.picture is None
            else _parse(Picture, request.picture, "picture"),
            world_from_robot=request.world_from_robot,
        )

    @property
    def changes_settings(self) -> bool:
        """Whether the picture may differ from the camera's own at its pose."""
        return replace(self, channels=(), world_from_robot=None) != CameraVariant()

    def apply_to(self, camera: OmniCameraSpec) -> OmniCameraSpec:
        """Camera with the changes.

        Raises:
            DomainError: The camera has no effect of a name, or no viewpoint for a mesh.
        """
        if self.polygons:
            require_mesh_viewpoint(camera.camera)
        return replace(
            camera,
            render_settings=self._change_settings(camera.render_settings),
            effect_settings=self._change_effects(camera.effect_settings),
        )

    def make_reference(self, camera: OmniCameraSpec) -> OmniCameraSpec | None:
        """Camera of the frame to compare with; None for none.

        Args:
            camera: The camera without the changes.
        """
        match self.reference:
            case None:
                return None
            case ReferenceKind.EXACT:
                return replace(self.apply_to(camera), render_settings=_EXACT)
            case ReferenceKind.CAMERA:
                return camera

    def _change_settings(self, settings: RenderSettings) -> RenderSettings:
        is_explicit = self.polygons is not None or self.samples is not None
        # Numbers replace a target, which would overrule them.
        target = AccuracyTarget() if is_explicit else settings.accuracy_target
        return replace(
            settings,
            surface=self._choose_surface(settings.surface),
            samples=settings.samples if self.samples is None else self.samples,
            accuracy_target=target.with_changes(
                max_error_px=self.max_error_px, budget_ms=self.budget_ms
            ),
            renderer=settings.renderer if self.renderer is None else self.renderer.value,
        )

    def _choose_surface(self, surface: MirrorSurface) -> MirrorSurface:
        if self.polygons is None:
            return surface
        return tessellation_from_polygon_count(self.polygons) if self.polygons else PerPixel()

    def _change_effects(self, settings: EffectSettings) -> EffectSettings:
        modes = dict(self.effects)
        known = [one.effect.name for one in settings.settings]
        unknown = modes.keys() - set(known)
        if unknown:
            raise DomainError(
                f"this camera has no effect {min(unknown)[:80]!r}: it has "
                f"{', '.join(known) or 'none'}"
            )
        changed = (
            replace(one, mode=modes.get(one.effect.name, one.mode)) for one in settings.settings
        )
        return replace(settings, settings=tuple(changed)) if modes else settings


def _parse(enum: type[_EnumT], name: str, noun: str) -> _EnumT:
    """Member of an enumeration, by the name that a client requests."""
    try:
        return enum(name)
    except ValueError:
        known = ", ".join(str(one.value) for one in enum)
        raise DomainError(f"no {noun} {name[:80]!r}: expected one of {known}") from None


_SELF_VIEW = "SelfView"


def choose_viewpoint(spec: OmniCameraSpec, nearest_m: float) -> OmniCameraSpec:
    """Camera to draw: from one viewpoint where nothing is nearer than the near limit.

    Args:
        spec: A camera that leaves the choice to each frame.
        nearest_m: Distance of the nearest thing in view, or less.
    """
    if nearest_m < _find_near_limit_m(spec.camera, spec.render_settings.central_error_px):
        return spec
    return replace(spec, camera=replace(spec.camera, is_approximated=True))


def shows_ego_body(spec: OmniCameraSpec) -> bool:
    """Whether a camera's frames may show the own robot."""
    return any(setting.effect.name == _SELF_VIEW for setting in spec.effect_settings.settings)


def describe_viewpoint(spec: OmniCameraSpec) -> str:
    """How a plan treats rays without a viewpoint; empty for a mirror or a lens with one."""
    camera, settings = spec.camera, spec.render_settings
    if not camera.has_mirror or camera.mirror.is_central:
        return ""
    limit = f"{_find_near_limit_m(camera, settings.central_error_px or CENTRAL_ERROR_PX):.3g} m"
    if not settings.central_error_px or settings.accuracy_target.max_error_px:
        rays = "one viewpoint for all rays" if camera.is_approximated else "exact rays"
        return f"{rays}, central from {limit}"
    if camera.is_approximated:
        return f"one viewpoint for all rays: nothing is nearer than {limit}"
    return f"exact rays while anything is nearer than {limit}"


def explain_viewpoint(spec: OmniCameraSpec, nearest_m: float) -> str:
    """Miss, near limit and clearance of a mirror without a viewpoint; empty for others.

    Args:
        nearest_m: Lower bound of the distance of everything in view.
    """
    camera = spec.camera
    if not camera.has_mirror or camera.mirror.is_central:
        return ""
    error_px = spec.render_settings.central_error_px or CENTRAL_ERROR_PX
    return (
        f"no single viewpoint: rays miss the best one by up to {1e3 * max_miss_m(camera):.2g} mm; "
        f"central to {error_px:g} px from {_find_near_limit_m(camera, error_px):.3g} m; nothing "
        f"is nearer than {nearest_m:.3g} m here"
    )


@lru_cache(maxsize=256)
def _find_near_limit_m(camera: OmniCamera, error_px: float) -> float:
    """Near limit, which every frame compares with: 257 rings take a millisecond."""
    return near_limit_m(camera, error_px)


# Of float32, in which rays are traced: a thousandth of a degree.
_CONE_MARGIN_RAD = 2e-5
# To draw fewer takes less time than to look where they are.
_MIN_OBJECTS = 4


def hide_unseen(state: CameraState, camera: PerspectiveCamera) -> CameraState:
    """State without the objects beside the image, which is the same picture.

    Domain: where objects throw shadows, and in an exposure in time, all objects stay.
    """
    objects = state.objects
    if len(objects) < _MIN_OBJECTS or state.has_shadows or state.shutter is not None:
        return state
    pose, corner_px = state.world_from_mirror, np.array(camera.rim_radius_px)
    cone_rad = 2.0 * arctan(float(camera.t_from_radius_px(corner_px))) + _CONE_MARGIN_RAD
    # Spheres about the objects' origins: their centres would take longer than all the rest.
    offsets = np.array([one.world_from_object.translation for one in objects]) - pose.translation
    radii_m = np.linalg.norm(np.array([one.mesh.centre for one in objects]), axis=-1)
    radii_m += [one.mesh.radius_m for one in objects]
    distances_m = np.linalg.norm(offsets, axis=-1)
    # From within its sphere an object may be seen in any direction.
    shares = radii_m / np.maximum(distances_m, radii_m)
    along_m = matmul(offsets, pose.rotate_directions(np.array(camera.optical_axis)))
    angles = arccos(np.clip(along_m / np.maximum(distances_m, radii_m), -1.0, 1.0))
    is_beside = (shares < 1.0) & (angles - arcsin(shares) > cone_rad)
    if not is_beside.any():
        return state
    seen = tuple(one for one, is_unseen in zip(objects, is_beside, strict=True) if not is_unseen)
    return replace(state, objects=seen)
