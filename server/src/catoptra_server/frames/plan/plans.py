"""A camera's plan: by explicit numbers, or the one of many candidates that meets a target.

Explicit numbers, of the robot's file with defaults for the rest, are followed as they are, by the
chosen renderer if able to show the image; nothing is weighed. For an accuracy target every
candidate has an error bound, `ErrorBound.outline_error_px`, and a predicted time. A perspective
image needs neither faces nor mirror: the plan is a number of samples. Sizes of views in memory
follow from a plan's numbers alone.

* Candidates that another one beats in both error and time are dropped; the others form a Pareto
  front, from the cheapest to the most accurate. A choice is a point of the front and names both
  neighbours: a client sees the price of a little more accuracy, and the gain of a little less.
* A tolerance takes the cheapest plan within, a budget the most accurate. In conflict the budget
  wins. The scene's part of the bounds is that of the start poses. Each frame has the bound of its
  own place, and meets the tolerance or not; another plan would have to be prepared.
* A long exposure is limited in rays, not in milliseconds, so that a frame depends on camera state
  and plan alone. An object costs the rays that may meet it, and the placing of the triangles.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import CENTRAL_ERROR_PX, max_miss_m, near_limit_m
from catoptra_protocol.optics.cube_map import visible_faces
from catoptra_protocol.optics.elementary import arctan, cos, hypot, tan
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import SHADED_BY_BODIES
from catoptra_server.effects.effect_plan import NOT_MEASURED, EffectDecision
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.error_bound import (
    ErrorBound,
    SceneDisplacement,
    add_scene,
    error_bound,
    scene_error,
)
from catoptra_server.frames.plan.faces import face_regions, max_face_size_px
from catoptra_server.render.renderer import (
    AccuracyTarget,
    MirrorSurface,
    RenderPlan,
    RenderSettings,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import ViewSize
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState, DynamicObject

log = logging.getLogger(__name__)


# 2 x 2 removes most of the aliasing and still leaves a frame of 640 px within a tenth of a second
# on two cores.
DEFAULT_SAMPLES = 2
# More samples take three times as long on software OpenGL and remove a sixth of the error:
# measured in tests/measurements/raster_faces.py.
DEFAULT_FACE_SAMPLES = 1
# Finer faces cost in proportion and gain little, measured likewise.
_DEFAULT_TEXELS_PER_PX = 1.0


def requested_samples(settings: RenderSettings) -> int:
    """Samples along a pixel's side: the configured number, or the default for 0."""
    return settings.samples or DEFAULT_SAMPLES


def plan_from_settings(
    settings: RenderSettings, camera: OmniCamera, *, kind: RendererKind, reason: str
) -> RenderPlan:
    """Plan a camera's frames by explicit numbers.

    Args:
        settings: Configured numbers; 0 takes the default. The accuracy target is not read.
        reason: Reason for the choice of the renderer; the plan's reason.
    """
    limit_rad = max_incidence_rad(camera, settings.surface)
    regions = face_regions(
        camera,
        limit_rad,
        size_px=settings.face_size_px,
        texels_per_px=settings.texels_per_px or _DEFAULT_TEXELS_PER_PX,
    )
    return RenderPlan(
        renderer=kind,
        surface=settings.surface,
        samples=requested_samples(settings),
        face_size_px=max_face_size_px(regions),
        face_samples=settings.face_samples or DEFAULT_FACE_SAMPLES,
        faces=visible_faces(limit_rad),
        face_regions=regions,
        reason=reason,
    )


def max_incidence_rad(camera: OmniCamera, surface: MirrorSurface) -> float:
    """Largest incidence angle that a frame looks up, radians.

    Above the horizon a polygon looks higher than the corners. Corners up to the rim's elevation e
    and 2 pi / S apart in azimuth span directions up to atan(tan e / cos(pi / S)).
    """
    elevation = camera.rim_rad - 0.5 * math.pi
    # Below the horizon the chord between two corners sags towards the axis: the rim is the limit.
    if not isinstance(surface, Tessellation) or elevation <= 0.0:
        return camera.rim_rad
    highest = arctan(tan(elevation) / cos(math.pi / surface.sectors))
    return 0.5 * math.pi + highest


def needs_exact_rays(camera: OmniCamera, kind: RendererKind) -> bool:
    """Whether a renderer's faces have a viewpoint that the camera's rays miss."""
    return kind.uses_faces and not camera.is_central


def plan_view_size(
    camera: OmniCamera, plan: RenderPlan, *, effect_bytes_per_px: int = 0
) -> ViewSize:
    """Size of the view of a plan; faces count where the plan's renderer has them."""
    num_texels = math.ceil(sum(region.num_texels for region in plan.face_regions))
    return ViewSize(
        num_pixels=camera.width_px * camera.height_px,
        samples_per_pixel=plan.samples**2,
        num_texels=num_texels if plan.renderer.uses_faces else 0,
        samples_per_texel=plan.face_samples,
        effect_bytes_per_px=effect_bytes_per_px,
        has_origins=not camera.is_central,
    )


def omni_view_size(
    camera: OmniCamera, settings: RenderSettings, *, effect_bytes_per_px: int
) -> ViewSize:
    """Size of the view that explicit settings describe, whichever renderer is chosen."""
    # With faces a view holds more than rays.
    kind = next(kind for kind in RendererKind if kind.uses_faces)
    plan = plan_from_settings(settings, camera, kind=kind, reason="size")
    return plan_view_size(camera, plan, effect_bytes_per_px=effect_bytes_per_px)


def perspective_view_size(camera: PerspectiveCamera, *, effect_bytes_per_px: int = 0) -> ViewSize:
    """Size of the view of a perspective camera."""
    # In raster the samples are the texels of a single face, which has no lookup map: 14 bytes a
    # sample, fewer than trace's rays.
    num_pixels = camera.width_px * camera.height_px
    return ViewSize(num_pixels, DEFAULT_SAMPLES**2, effect_bytes_per_px=effect_bytes_per_px)


@dataclass(frozen=True, slots=True)
class PerspectivePlan:
    """Plan of one perspective camera."""

    renderer: RendererKind
    samples: int
    """Samples along a pixel's side; a pixel has samples^2."""
    reason: str
    """Reason of the renderer's choice, for the log."""

    def __post_init__(self) -> None:
        # The same limits as of RenderPlan.
        if not 1 <= self.samples <= 16:
            raise DomainError(f"samples must be 1 to 16 along a pixel's side, not {self.samples}")

    @property
    def has_exact_rays(self) -> bool:
        """Whether each pixel has the ray of the camera model: always."""
        return True

    def __str__(self) -> str:
        return f"{self.renderer.value}, {self.samples}^2 samples: {self.reason}"


SceneDisplacements = Mapping[RendererKind, SceneDisplacement]
"""Largest displacement at a place by each renderer."""


@dataclass(frozen=True, slots=True)
class PlanOption:
    """Candidate plan with error bound and predicted cost."""

    plan: RenderPlan
    plan_bound_px: float
    """Largest displacement of an outline but for the scene's part."""
    predicted_ms: float
    scene_px: float = 0.0
    """The scene's part at a place."""

    @property
    def error_bound_px(self) -> float:
        """Largest displacement of an outline."""
        return self.plan_bound_px + self.scene_px

    def place(self, camera: OmniCamera, scene: SceneDisplacements) -> PlanOption:
        """Same option at a place."""
        kind = self.plan.renderer
        return replace(self, scene_px=scene_error(camera, kind, scene[kind]).max_px)

    def __str__(self) -> str:
        numbers = f"{self.error_bound_px:.3g} px in {self.predicted_ms:.1f} ms"
        return f"{self.plan.description}: {numbers}"


@dataclass(frozen=True, slots=True)
class PlanChoice:
    """Plan of a camera, with bound and neighbours on the Pareto front."""

    plan: RenderPlan
    bound: ErrorBound | None
    """None for a plan whose error has no bound: a mesh under an orthographic camera."""
    predicted_ms: float | None = None
    """None without an accuracy target: no cost is measured then."""
    target: AccuracyTarget = AccuracyTarget()
    fits_budget: bool = True
    """Whether a plan fits into the target's budget, and has a bound for its tolerance."""
    more_accurate: PlanOption | None = None
    """Next more accurate option."""
    faster: PlanOption | None = None
    """Next cheaper option."""

    @property
    def target_met(self) -> bool:
        """Whether the plan meets the accuracy target."""
        return self.fits_budget and not self.excess

    @property
    def excess(self) -> str:
        """What keeps the bound above the tolerance, in words; empty for a bound within."""
        tolerance_px, bound = self.target.max_error_px, self.bound
        if bound is None or not 0.0 < tolerance_px < bound.outline_error_px:
            return ""
        return f"{tolerance_px:g} px is not met: {bound.explain_size()}"

    @property
    def text(self) -> str:
        """Plan in words, with what keeps it from its target."""
        reasons = (self.excess, self.plan.reason) if self.excess else (self.plan.reason,)
        return str(replace(self.plan, reason="; ".join(reasons)))

    def place(self, camera: OmniCamera, scene: SceneDisplacements) -> PlanChoice:
        """Same choice with the bounds of frames at a place; from one with those of plans alone.

        A neighbour that the scene makes no longer one is left out.
        """
        if self.bound is None:
            return self
        kind = self.plan.renderer
        bound = add_scene(self.bound, scene_error(camera, kind, scene[kind]))
        neighbours = self.more_accurate, self.faster
        better, faster = (one and one.place(camera, scene) for one in neighbours)
        own_px = bound.outline_error_px
        return replace(
            self,
            bound=bound,
            more_accurate=better if better and better.error_bound_px < own_px else None,
            faster=faster if faster and faster.error_bound_px > own_px else None,
        )

    def __str__(self) -> str:
        cost = "" if self.predicted_ms is None else f"; about {self.predicted_ms:.1f} ms a frame"
        better = f"; next better {self.more_accurate}" if self.more_accurate else ""
        cheaper = f"; next cheaper {self.faster}" if self.faster else ""
        return f"{self.text}{cost}{better}{cheaper}"


def pareto_front(options: Iterable[PlanOption]) -> tuple[PlanOption, ...]:
    """Options that no other beats in both error and cost, from the cheapest on."""
    front: list[PlanOption] = []
    # In order of cost, an option belongs to the front exactly if more accurate than all before.
    for option in sorted(options, key=lambda one: (one.predicted_ms, one.error_bound_px)):
        if not front or option.error_bound_px < front[-1].error_bound_px:
            front.append(option)
    return tuple(front)


def choose_plan(
    camera: OmniCamera, options: tuple[PlanOption, ...], target: AccuracyTarget
) -> PlanChoice:
    """Choose the option that meets a target, or the nearest to it, with the bound of its plan.

    Args:
        options: A Pareto front, not empty.
    """
    index, fits_budget, reason = _choose_option(options, target)
    option = options[index]
    return PlanChoice(
        plan=replace(option.plan, reason=reason),
        bound=error_bound(camera, option.plan),
        predicted_ms=option.predicted_ms,
        target=target,
        fits_budget=fits_budget,
        more_accurate=options[index + 1] if index + 1 < len(options) else None,
        faster=options[index - 1] if index else None,
    )


def _choose_option(
    options: tuple[PlanOption, ...], target: AccuracyTarget
) -> tuple[int, bool, str]:
    """Index of an option, whether it fits into the budget, and the reason of the choice.

    No reason has a bound: that of a frame is its place's.
    """
    tolerance_px, budget_ms = target.max_error_px, target.budget_ms
    # The first within the tolerance is the cheapest: costs grow along the front.
    in_tolerance = next(
        (i for i, option in enumerate(options) if option.error_bound_px <= tolerance_px), None
    )
    if not budget_ms and in_tolerance is None:
        return len(options) - 1, True, "chosen as the most accurate"
    in_time = f", in {budget_ms:g} ms" if budget_ms else ""
    in_budget = [i for i, one in enumerate(options) if one.predicted_ms <= (budget_ms or math.inf)]
    # In conflict the budget wins over the tolerance, as AccuracyTarget documents.
    if in_tolerance is not None and in_tolerance in in_budget:
        return in_tolerance, True, f"chosen as the cheapest within {tolerance_px:g} px{in_time}"
    if not in_budget:
        cheapest = f"the cheapest takes about {options[0].predicted_ms:.1f} ms"
        return 0, False, f"no plan fits into {budget_ms:g} ms: {cheapest}"
    return in_budget[-1], True, f"chosen as the most accurate within {budget_ms:g} ms"


# Displacement over the image's radius: an image that is off by a twentieth shows other things. In a
# tiny image half a texel is as much, and all is well.
_MAX_FACES_FRACTION = 0.05
_FINE_FACES_PX = 1.2


def choose_by_settings(
    camera: OmniCameraSpec, kind: RendererKind, reason: str, *, usable: Collection[RendererKind]
) -> PlanChoice:
    """Plan of a camera without an accuracy target, with a bound where the error has one.

    Args:
        kind: The chosen renderer.
        reason: Reason of that choice.
        usable: Renderers that may draw the camera if that one cannot.

    Raises:
        DomainError: The renderer cannot show the image, and no other may replace it.
    """
    choice = _bound_plan(camera, kind, reason)
    what = _find_fault(camera, kind, choice.bound)
    if not what:
        return choice
    without_faces = [one for one in RendererKind if not one.uses_faces]
    other = next((one for one in without_faces if one in usable), None)
    if other is None or camera.render_settings.renderer:
        names = " or ".join(one.value for one in without_faces)
        raise DomainError(f"{what}: choose the renderer {names}, {_other_remedy(camera)}")
    return _bound_plan(camera, other, what)


def _find_fault(camera: OmniCameraSpec, kind: RendererKind, bound: ErrorBound | None) -> str:
    """Why a renderer cannot show a camera's image; empty if it can."""
    if needs_exact_rays(camera.camera, kind):
        miss_mm = 1e3 * max_miss_m(camera.camera)
        error_px = camera.render_settings.central_error_px or CENTRAL_ERROR_PX
        return (
            f"rays of this mirror miss one viewpoint by up to {miss_mm:.2g} mm, and faces of "
            f"{kind.value} have one: what is nearer than "
            f"{near_limit_m(camera.camera, error_px):.3g} m would be displaced by more than "
            f"{error_px:g} px"
        )
    faces_px = _unusable_faces_px(camera, bound)
    if not faces_px:
        return ""
    return (
        f"the faces of {kind.value} would displace this camera's image by {faces_px:.0f} of "
        f"{camera.camera.width_px} px"
    )


def _other_remedy(camera: OmniCameraSpec) -> str:
    if not camera.camera.has_mirror:
        return "or a smaller FieldOfView"
    if camera.camera.is_central:
        return "or a mirror with K farther from 2"
    return "or state Central=always for the mirror"


def _bound_plan(camera: OmniCameraSpec, kind: RendererKind, reason: str) -> PlanChoice:
    plan = plan_from_settings(camera.render_settings, camera.camera, kind=kind, reason=reason)
    return PlanChoice(plan, _find_error_bound(camera.camera, plan))


def _unusable_faces_px(camera: OmniCameraSpec, bound: ErrorBound | None) -> float:
    """Displacement by faces that cannot be made fine enough to show the image; 0 for others.

    The largest faces have too few texels for a mirror next to k = 2, whose image is all of a tiny
    part of the sphere. Faces of a configured size are as coarse as the owner wants.
    """
    if bound is None or camera.render_settings.face_size_px:
        return 0.0
    faces_px = bound.numbers_by_name().get("faces_px", 0.0)
    allowed_px = max(_FINE_FACES_PX, _MAX_FACES_FRACTION * bound.rim_radius_px)
    return faces_px if faces_px > allowed_px else 0.0


def _find_error_bound(camera: OmniCamera, plan: RenderPlan) -> ErrorBound | None:
    try:
        return error_bound(camera, plan)
    except DomainError as error:
        log.info("this plan has no error bound: %s", error)
        return None


# 20 time samples of 640 x 640 px at 2 x 2 samples, 10 with one robot in all directions: half a
# second to a second on two cores. Robots at work need 2 to 4.
MAX_EXPOSURE_RAYS = 2**25
# An object of 704 triangles takes half a millisecond a time sample, whatever it covers; a ray takes
# 16 ns.
_RAYS_PER_TRIANGLE = 40


_GLOSS = "Gloss"
# Effects whose time samples are limited.
_SHUTTER_EFFECTS = frozenset(("MotionBlur", "RollingShutter"))


def limit_time_samples(
    camera_state: CameraState, camera: RadialCamera, plan: RenderPlan | PerspectivePlan
) -> CameraState:
    """Camera state with a shutter whose exposure stays within the budget of rays."""
    shutter = camera_state.shutter
    assert shutter is not None, "an exposure without a shutter has no time samples"
    viewpoint, objects = camera_state.world_from_mirror.translation, camera_state.objects
    pixel_rays = camera.width_px * camera.height_px * plan.samples**2
    object_rays = sum(
        _covered_fraction(one, viewpoint) * pixel_rays + _RAYS_PER_TRIANGLE * len(one.mesh)
        for one in objects
    )
    limit = min(int(MAX_EXPOSURE_RAYS / (pixel_rays + object_rays)), shutter.max_time_samples)
    return replace(camera_state, shutter=replace(shutter, max_time_samples=limit))


def _covered_fraction(dynamic_object: DynamicObject, viewpoint: Floats) -> float:
    """Fraction of all directions from a (3,) point that an object's bounding sphere covers."""
    distance_m = hypot(*(dynamic_object.centre - viewpoint))
    radius_m = dynamic_object.mesh.radius_m
    if distance_m <= radius_m:
        return 1.0
    ratio = radius_m / distance_m
    return 0.5 * (1.0 - math.sqrt(1.0 - ratio * ratio))


def explain_raster(
    decisions: tuple[EffectDecision, ...], plan: RenderPlan | PerspectivePlan
) -> tuple[EffectDecision, ...]:
    """Decisions that are off where raster draws no mirrored light, whose bound they keep; that of
    baked light says that bodies shade none of it there."""
    if not plan.renderer.uses_faces:
        return decisions
    note = "raster does not draw it, up to the bound; "

    def explain(one: EffectDecision) -> EffectDecision:
        if one.effect == _GLOSS and one.enabled:
            return replace(one, enabled=False, reason=note + one.reason.removeprefix(NOT_MEASURED))
        reason = one.reason.replace(SHADED_BY_BODIES, "raster draws no shade of bodies; ")
        return one if reason == one.reason else replace(one, reason=reason)

    return tuple(map(explain, decisions))


def explain_limit(
    decisions: tuple[EffectDecision, ...], wanted: CameraState, limited: CameraState
) -> tuple[EffectDecision, ...]:
    """Decisions that say so where an exposure has fewer time samples than the effects want."""
    if wanted.shutter is None or limited.shutter is None:
        return decisions
    wanted_samples, samples = wanted.shutter.num_time_samples, limited.shutter.num_time_samples
    if wanted_samples == samples:
        return decisions
    note = f"{samples} of {wanted_samples} time samples, limited by the budget of a frame"
    return tuple(
        replace(one, reason=f"{one.reason}; {note}")
        if one.enabled and one.effect in _SHUTTER_EFFECTS
        else one
        for one in decisions
    )
