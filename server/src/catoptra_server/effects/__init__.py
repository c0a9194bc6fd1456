"""Effects of scene, lens, mirror and sensor on a camera's image: the table, in optical order.

The order follows the light: the scene effects come first, since they change the objects, the
light, the air or the times that a renderer works on; the image effects follow, from the lens to the
sensor's white balance. Motion and defocus act before anything that lies on mirror and
lens, which neither moves nor blurs with the scene. `plan_effects` decides in this order, and both
renderers apply the enabled effects in this order.

To add an image effect:

1. `<folder>/<name>.py` with a frozen dataclass as in `ImageEffect`: formula, source, domain
   and criterion in the module's docstring; the folder is `medium` (air and lens), `mirror` or
   `sensor`. Mathematics that several effects need goes to `kernels`.
2. A stage of the kernel: `render/trace/kernel/image.py:STAGE_MAKERS`.
3. A line in EFFECT_TYPES, at the effect's position in optical order; its name is the one of the
   effect's EFFECT_TYPE.

To add a scene effect: `scene/<name>.py` as in `SceneEffect`, and the line.
Keys of the capture camera's section, both renderers, `explain` and the frame header follow from the
table. Effects that no robot file names cost nothing: no pass, no program, no buffer.

Effects are frozen parameters with a bound on the change that they can make. A scene effect changes
the camera state before a frame is rendered. An image effect changes the whole linear image
afterwards, so cube faces leave no seams. Images are (h, w, 3); radiance 1 fills a pixel's well, and
is a white facet at full scale in `world/shading`.

An effect bounds the largest change of any pixel of the finished picture in encoded grey levels,
since the sRGB curve is 13 times as steep in the dark as in linear counts. `auto` leaves out what
nobody misses: no pixel may change by more than `max_change`, and at most a share of the pixels by
more than VISIBLE_LEVELS. Light is linear and not clipped up to the sensor's well, which clips once,
behind the last mean. What follows an effect, exposure and gains above all, multiplies its change:
`gains` are the least and the largest such factor, known before the frame.
Noise counts with the largest number that its generator can give. A criterion reads a
`SceneSummary`, whose fields bound everything that a frame can show, and declares the ones that it
reads. One rule serves all effects. Half a pixel and half a grey level are a hundredfold apart:
a displacement counts with the contrast that the scene can show, so what displaces light is hardly
ever off by proof, and off by measurement where nothing but flat surfaces is in view.

Effects know no mirror but for five: they take any camera with an optical axis (`RadialCamera`), a
lens too. An effect that is left out has no pass, program or texture. Each one that runs is a stage
of its own, which the kernel calls for a cell of pixels: stages share passes, and know no other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from enum import Enum, StrEnum
from functools import lru_cache
from typing import Any, Protocol, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.lazy_table import LazyTable
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.objects import ZERO_SEED, CameraState, NoiseSeed
from catoptra_server.world.shading import OcclusionMap
from catoptra_server.world.world_description import AT_REST, Twist, Vector3

# float64 for references, float32 where a renderer applies an effect to its images.
Real = TypeVar("Real", np.float32, np.float64)

Gains = tuple[float, float]
"""Least and largest factor of light."""
AVERAGING: Gains = (0.0, 1.0)
"""Of all that mixes light with that of other pixels, or loses some."""
UNCHANGED: Gains = (1.0, 1.0)
ANY_GAINS: Gains = (0.0, math.inf)

Spill = tuple[float, float]
"""Largest factor of light up to a pixel's well, and the largest part of what is above the well that
reaches another pixel of the finished picture."""
NO_SPILL: Spill = (0.0, 0.0)
_BLOOMING = "Blooming"

# Rings of equal width from the image centre to a mirror's rim or a lens's corners. Distances differ
# by ring: the floor below the robot is near, the surroundings at the rim are far.
NUM_RINGS = 8

# Message of effects that a camera without a mirror cannot have: `EffectType.needs_mirror`.
NEEDS_MIRROR = "this effect needs a mirror"


class Effect(Protocol):
    """Frozen, hashable parameters in SI units, and a criterion: common to all effects."""

    def __hash__(self) -> int:
        """Hash of the parameters: decisions and maps are cached by effect."""

    @property
    def name(self) -> str:
        """Key of the effect's mode in robot files, and its stage in timings."""

    @property
    def changes_scene(self) -> bool:
        """True: a `SceneEffect`, applied before rendering. False: an `ImageEffect`."""

    @property
    def reads(self) -> frozenset[str]:
        """Fields of the summary, without `gains`, that `bound` reads: bounds are cached by them."""

    @property
    def gains(self) -> Gains:
        """Factors by which the effect may multiply a difference of light on its way."""

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change of any pixel, never too small.

        Args:
            summary: Summary of the light that reaches this effect, after the enabled effects
                before it.
            camera: Camera of the image.
        """

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the light that leaves the effect, for the criteria of later effects."""


class SceneEffect(Effect, Protocol):
    """Effect that changes the camera state before rendering. Folder: `effects/scene`."""

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Add the effect to a camera state.

        Args:
            camera_state: State of the exposure, with the scene effects before this one.
            displacement_px: Largest displacement of the effect's bound; 0 for none.
        """


class ImageEffect(Effect, Protocol):
    """Effect that changes the linear image. Folders: `effects/medium`, `mirror`, `sensor`.

    `apply` is the definition; the kernel's stage (`render/trace/kernel/image.py`) computes the
    same in float32, for both renderers.
    """

    @property
    def needs_range(self) -> bool:
        """Whether the effect reads the range of each pixel; renderers then compute ranges."""

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the changed image, a new array of the same type."""


SHADED_BY_BODIES = "bodies shade what is near; "
"""Begin of the reason of `BakedLight` where dynamic objects take a part of it, in trace alone."""
WORLD_EFFECTS = {"BakedLight": "has_baked_light", "SkyRadiance": "has_sky"}
"""Effects that a world's file asks for, with their field of a `CameraState`: drawn where nobody
names them."""


def name_effect(settings: EffectSettings, name: str) -> EffectSettings:
    """Settings that leave an effect to its criterion, unless they name it already."""
    if any(one.effect.name == name for one in settings.settings):
        return settings
    added = EffectSetting(EFFECT_TYPES[name].factory(), EffectMode.AUTO)
    order = [*EFFECT_TYPES]
    named = sorted((*settings.settings, added), key=lambda one: order.index(one.effect.name))
    return replace(settings, settings=tuple(named))


def is_scene_effect(effect: Effect) -> TypeGuard[SceneEffect]:
    """Whether an effect changes the scene, as a type guard."""
    return effect.changes_scene


def is_image_effect(effect: Effect) -> TypeGuard[ImageEffect]:
    """Whether an effect changes the image, as a type guard."""
    return not effect.changes_scene


@dataclass(frozen=True, slots=True)
class EffectBound:
    """Upper bound of the change that an effect makes in any pixel."""

    value: float
    """Encoded grey levels of 255."""
    reason: str
    """For logs, `explain` and the frame header."""
    displacement_px: float | None = None
    """Largest distance between the pixel where light belongs and the pixel that receives it; None
    for an effect that displaces no light."""


@dataclass(frozen=True, slots=True)
class LightSource:
    """Lamp or sun in a picture."""

    pixel: tuple[float, float]
    """Place (u, v)."""
    irradiance: tuple[float, float, float]
    """Of a surface at the viewpoint that faces the source, RGB."""


@dataclass(frozen=True, slots=True, eq=False)
class CaptureContext:
    """Noise seed, ranges and sources of one exposure."""

    noise_seed: NoiseSeed = ZERO_SEED
    range_m: npt.NDArray[np.float32] | None = None
    """Range at each pixel centre from the effective viewpoint, (h, w).

    inf where a pixel shows the background, and outside the mirror. None where no enabled effect
    needs ranges.
    """
    sources: tuple[LightSource, ...] = ()
    """Lights in view, where ranges tell which are: `kernels/light_sources`."""


@dataclass(frozen=True, slots=True)
class ShadowLoss:
    """Change of the surface whose encoded value changes most in shadow."""

    lost_radiance: float = 0.0
    """Radiance of the lights that can be occluded."""
    remaining_radiance: float = 0.0
    """Radiance of all other light."""


NO_SHADOW_LOSS = ShadowLoss()


# Defaults are the values of a scene without anything near, moving or casting shadows, so a summary
# of radiance alone is `SceneSummary(max_radiance)`.
@dataclass(frozen=True, slots=True)
class SceneSummary:
    """Bounds on everything a frame can show. Hashable: equal summaries give equal decisions.

    Every number is a bound, none an estimate. Criteria declare the fields that they read.
    """

    max_radiance: float
    """Largest radiance of any colour; 1 fills a pixel's well.

    The smallest is 0 without a field: outside the mirror every image is black.
    """
    min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    """Distance from the effective viewpoint to the nearest of scene and dynamic objects, by ring.

    Only of surfaces that move relative to the camera; see `attached_min_distances_m`.
    """
    max_distance_m: float = math.inf
    """Distance of the farthest surface."""
    background_radiance: tuple[Vector3, Vector3] | None = None
    """Least and largest linear RGB where there is no surface; None if unknown."""
    scene_twist: Twist = AT_REST
    """Motion of the scene relative to the camera, at the viewpoint, in axes whose z is the optical
    axis: the mirror frame."""
    max_object_rates_rad_s: tuple[float, ...] = (0.0,) * NUM_RINGS
    """Largest angular rate of dynamic objects about the viewpoint, by ring, beside the twist."""
    max_shadow_loss: ShadowLoss = NO_SHADOW_LOSS
    """Largest loss in the shadow of scene and dynamic objects, as light of the finished picture."""
    max_shadow_loss_with_ego_body: ShadowLoss = NO_SHADOW_LOSS
    """The same where the robot that carries the camera casts shadows, too."""
    light_bake: OcclusionMap | None = None
    """Map of baked light; None without."""
    open_irradiance: Vector3 = (0.0, 0.0, 0.0)
    """Irradiance of its factor 1."""
    has_bodies: bool = False
    """Whether dynamic objects may shade it."""
    max_fresnel: float = 0.0
    """Largest part of its light that a glossy surface mirrors; 0 without such surfaces."""
    camera_key: tuple[int, int] | None = None
    """Key of the camera's own patterns (`NoiseSeed.camera_key`); None if unknown."""
    ego_body_max_radiance: float = 0.0
    """Largest radiance of the ego body."""
    ego_body_max_angle_rad: float = 0.0
    """Largest angle between the optical axis and the ego body; 0 if it is out of view."""
    ego_body_min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    """Distance from the viewpoint to the nearest visible point of the ego body, by ring."""
    attached_min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    """Distance to the nearest surface that moves with the camera, by ring.

    Infinite until `SelfView` is enabled; such surfaces blur by defocus but not by motion.
    """
    included_effects: frozenset[tuple[str, str]] = frozenset()
    """Pairs of an effect and of the enabled effect that does its work as well, by name."""
    source_light_px: float = 0.0
    """Light that lamps and suns bring into the image, radiance times pixels, of any colour."""
    has_defocus: bool = True
    """Whether settings allow `Defocus`, which blurs where `DefocusByDepth` is off."""
    exposes_itself: bool = False
    """Whether settings allow `AutoExposure`, which takes back what all pixels share."""
    gains: Gains = UNCHANGED
    """Factors from the light at the effect to that of the finished picture, of what follows."""

    @property
    def picture_radiance(self) -> float:
        """Largest radiance of the finished picture, before the sensor clips it."""
        return self.gains[1] * self.max_radiance

    @property
    def visible_min_distances_m(self) -> tuple[float, ...]:
        """Distance to the nearest visible surface, by ring, however that surface moves."""
        return tuple(map(min, self.min_distances_m, self.attached_min_distances_m))


class EffectMode(Enum):
    """Whether an effect is enabled: by its criterion (AUTO), or fixed by a setting."""

    AUTO = "auto"
    ALWAYS = "always"
    NEVER = "never"


class DecisionBasis(StrEnum):
    """What a decision rests on."""

    PROVED = "proved"
    """A bound, before the frame: of an effect that is left out, nothing was computed."""
    MEASURED = "measured"
    """The frame's own pixels, with and without the effect: where a bound alone says "on"."""


VISIBLE_LEVELS = 0.5
"""A pixel that changes by at most half a level is the same after rounding, or its neighbour."""
COUNTED_LEVELS = 0.375
"""Change from which a pixel is counted: no mean of pixels that change by less changes by more than
VISIBLE_LEVELS. Proof: a level y is light G(y), and a mean with weights w changes by the sum of
w G'(y) / G'(mean) for each level of its parts. G' is a concave function of light but for its jump
by 1.0173 from the sRGB curve's straight part, where black and light of 4.4 times its end make the
largest such sum, 1.3215."""


@dataclass(frozen=True, slots=True)
class EffectChange:
    """Change that an effect makes in the finished picture; both numbers are upper bounds."""

    largest: float
    """Of any pixel, grey levels."""
    visible_share: float = 1.0
    """Share of the picture's pixels that change by more than VISIBLE_LEVELS."""
    is_partial: bool = False
    """Whether `largest` is that of a part of the picture, which decides: more may follow."""

    def __post_init__(self) -> None:
        if self.largest <= VISIBLE_LEVELS:
            object.__setattr__(self, "visible_share", 0.0)


@dataclass(frozen=True, slots=True)
class Threshold:
    """Change of the finished picture that nobody misses."""

    max_change: float
    """Of any pixel, grey levels; negative: the effect is drawn everywhere, and not measured."""
    gains: Gains = UNCHANGED
    """Factors from the light at the effect to that of the finished picture."""
    visible_share: float = 1.0
    """Share of the pixels that may change by more than VISIBLE_LEVELS."""
    spill: Spill = NO_SPILL
    """A difference far above white, which its own pixel does not show, reaches black neighbours."""
    has_mosaic: bool = False
    """Whether a mosaic follows, behind which a pixel's change shows in its neighbours."""
    may_end: bool = False
    """Whether a part of the picture that decides is enough: its change is told, none beyond."""

    @property
    def is_measured(self) -> bool:
        """Whether the frame decides on the effect."""
        return self.max_change >= 0.0

    @property
    def plain_change(self) -> float:
        """Change up to which a part of the picture may be drawn without the effect, uncounted."""
        if self.visible_share >= 1.0:
            return self.max_change
        return min(self.max_change, COUNTED_LEVELS)

    def covers(self, change: EffectChange) -> bool:
        """Whether nobody misses a change."""
        return change.largest <= self.max_change and change.visible_share <= self.visible_share

    def narrow(self, least: float, largest: float) -> Threshold:
        """The same with factors of the least and the largest gain."""
        gains = (least * self.gains[0], largest * self.gains[1])
        return replace(self, gains=gains, spill=(largest * self.spill[0], self.spill[1]))


@dataclass(frozen=True, slots=True)
class EffectSetting:
    """Effect that a robot file names."""

    effect: Effect
    mode: EffectMode


@dataclass(frozen=True, slots=True)
class EffectSettings:
    """Effects and thresholds of a robot file; most files name no effect."""

    settings: tuple[EffectSetting, ...] = ()
    """In optical order."""
    # Chosen by the figure in docs/EFFECTS.md.
    max_change: float = 1.0
    """`auto` leaves out effects that change no pixel of the finished picture by more, levels,"""
    visible_share: float = 1.0
    """and at most this share of its pixels by more than VISIBLE_LEVELS."""
    threshold_px: float | None = None
    """`auto` also leaves out effects that displace light by at most this; None: grey levels decide
    alone, since a tenth of a pixel changes an edge by 50 of them."""
    basis: DecisionBasis = DecisionBasis.MEASURED
    """PROVED: an effect whose bound is above the threshold is drawn everywhere and counts as
    enabled, whatever the frame shows."""
    _hash: int = field(init=False, repr=False, compare=False)
    _contrast: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        factors = (
            getattr(one.effect, "contrast", 1.0)
            for one in self.settings
            if one.mode is not EffectMode.NEVER
        )
        object.__setattr__(self, "_contrast", max(factors, default=1.0))
        rule = (self.max_change, self.visible_share, self.threshold_px, self.basis)
        object.__setattr__(self, "_hash", hash((self.settings, rule)))

    def __hash__(self) -> int:
        # Computed once: settings are part of the key of every cached decision, and the hash of 22
        # effects would take as long as all the rest of that lookup (9 microseconds).
        return self._hash

    @property
    def bytes_per_px(self) -> int:
        """Memory that these effects may take, a pixel of the image."""
        # In any mode: a client may ask for another one.
        effects = [setting.effect for setting in self.settings]
        of_scene = _SCENE_BYTES_PER_PX if effects else 0
        return _IMAGE_BYTES_PER_PX if any(map(is_image_effect, effects)) else of_scene

    @property
    def threshold(self) -> Threshold:
        """Change that nobody misses, in the finished picture.

        Smaller where a response curve shows changes larger than gains would.
        """
        if self._contrast == 1.0:
            return Threshold(self.max_change, visible_share=self.visible_share)
        # Pixels are counted by changes as of gains: none may change visibly then.
        largest = VISIBLE_LEVELS if self.visible_share < 1.0 else math.inf
        return Threshold(
            min(self.max_change, largest) / self._contrast, visible_share=self.visible_share
        )

    def is_negligible(self, bound: EffectBound) -> bool:
        """Whether `auto` leaves out an effect of a bound."""
        if self.threshold.covers(EffectChange(bound.value)):
            return True
        if self.threshold_px is None or bound.displacement_px is None:
            return False
        return bound.displacement_px <= self.threshold_px


NO_EFFECT_SETTINGS = EffectSettings()
# Peaks of memory in tests/measurements/memory_per_item.py: of all image effects of
# p2at_omni_real.ini with the view 412 in trace and 507 in raster, of the view alone 20 and 62; of
# all effects that change the scene 34 and 89.
_IMAGE_BYTES_PER_PX, _SCENE_BYTES_PER_PX = 500, 30


@lru_cache(maxsize=64)
def following_factors(settings: EffectSettings) -> tuple[tuple[Gains, Spill], ...]:
    """`chain_factors` before any decision."""
    return chain_factors(settings, [_possible_gains(one) for one in settings.settings])


def _possible_gains(setting: EffectSetting) -> Gains:
    if setting.mode is EffectMode.NEVER:
        return UNCHANGED
    least, largest = setting.effect.gains
    if setting.mode is EffectMode.ALWAYS:
        return least, largest
    return min(least, 1.0), max(largest, 1.0)


def chain_factors(
    settings: EffectSettings, gains: Sequence[Gains]
) -> tuple[tuple[Gains, Spill], ...]:
    """Factors of a pixel's own light by all effects after each one, and the spill of the light
    there, by the factors of each."""
    least, largest, spill, chained = 1.0, 1.0, NO_SPILL, []
    for setting, factors in zip(reversed(settings.settings), reversed(gains), strict=True):
        chained.append(((least, largest), spill))
        if setting.effect.name == _BLOOMING:  # whose factor is that of the spill
            spill = (1.0, (factors[1] - 1.0) * largest)
        else:
            least, largest = least * factors[0], largest * factors[1]
            spill = (spill[0] * factors[1], spill[1])
    return tuple(reversed(chained))


def gains_after(settings: EffectSettings, effect_name: str) -> Gains:
    """Factors from the light at an effect to that of the finished picture."""
    pairs = zip(settings.settings, following_factors(settings), strict=True)
    return next((gains for one, (gains, _) in pairs if one.effect.name == effect_name), UNCHANGED)


def widest_gains(all_settings: Iterable[EffectSettings]) -> Gains:
    """Factors from the scene's light to that of the finished picture, in whatever modes."""
    least, largest = UNCHANGED
    for settings in all_settings:
        gains = [one.effect.gains for one in settings.settings]
        least = min(least, math.prod(min(one, 1.0) for one, _ in gains))
        largest = max(largest, math.prod(max(one, 1.0) for _, one in gains))
    return least, largest


def summary_fields(settings: EffectSettings) -> frozenset[str]:
    """Fields of a summary that the criteria of all named effects read."""
    return frozenset[str]().union(*(setting.effect.reads for setting in settings.settings))


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """Number of an effect in a camera's section of a robot file."""

    key: str
    """Key in the robot file; several effects may share one."""
    field: str
    """Name of the argument of the effect type's factory."""
    default: float
    min_value: float
    max_value: float


@dataclass(frozen=True, slots=True)
class ParameterFault:
    """Why an effect with parameters that are all within their ranges cannot be drawn."""

    key: str
    """Parameter to be changed."""
    expected: str
    """An acceptable value, as a phrase."""


@dataclass(frozen=True, slots=True)
class EffectType:
    """Effect as it is configured: a line of the table in `effects/__init__`."""

    name: str
    """Key of the mode."""
    factory: Callable[..., Effect]
    """Makes the effect of its parameters, by keyword."""
    parameters: tuple[EffectParameter, ...] = ()
    needs_mirror: bool = False
    """Whether only a camera with a mirror can have the effect; others have all the rest."""
    needs_viewpoint: bool = False
    """Whether behind a mirror only one with a single viewpoint can have the effect."""
    find_fault: Callable[[Any], ParameterFault | None] | None = None
    """Finds what parameters ask for together that cannot be drawn; None: each alone is enough."""
    curve_key: str = ""
    """Key of a curve, the factory's argument `curve`: a name, or a file of light and grey."""
    curves: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    """Curves by name."""


EFFECT_TYPES: LazyTable[EffectType] = LazyTable(
    __name__,
    {
        "SelfView": "scene.self_view.EFFECT_TYPE",
        "Shadows": "scene.shadows.EFFECT_TYPE",
        "BakedLight": "scene.baked_light.EFFECT_TYPE",
        "SkyRadiance": "scene.sky_radiance.EFFECT_TYPE",
        "Gloss": "scene.gloss.EFFECT_TYPE",
        "Fog": "scene.fog.EFFECT_TYPE",
        "RollingShutter": "scene.rolling_shutter.EFFECT_TYPE",
        "MotionBlur": "scene.motion_blur.EFFECT_TYPE",
        # Supersedes Defocus where both are named, so this criterion decides first.
        "DefocusByDepth": "medium.defocus_by_depth.EFFECT_TYPE",
        "Defocus": "medium.defocus.EFFECT_TYPE",
        "Misalignment": "medium.misalignment.EFFECT_TYPE",
        "ChromaticAberration": "medium.chromatic_aberration.EFFECT_TYPE",
        "Diffraction": "medium.diffraction.EFFECT_TYPE",
        "MirrorHolder": "mirror.mirror_holder.EFFECT_TYPE",
        "MirrorDust": "mirror.mirror_dust.EFFECT_TYPE",
        "MirrorReflectance": "mirror.mirror_reflectance.EFFECT_TYPE",
        "Vignetting": "medium.vignetting.EFFECT_TYPE",
        # Of the light that reaches the image: after the lens's own shading.
        "VeilingGlare": "medium.veiling_glare.EFFECT_TYPE",
        # From here on radiance 1 fills a pixel's well.
        "Exposure": "sensor.exposure.EFFECT_TYPE",
        "AutoExposure": "sensor.auto_exposure.EFFECT_TYPE",
        "Blooming": "sensor.blooming.EFFECT_TYPE",
        "FixedPattern": "sensor.fixed_pattern.EFFECT_TYPE",
        "ShotNoise": "sensor.shot_noise.EFFECT_TYPE",
        "ReadNoise": "sensor.read_noise.EFFECT_TYPE",
        "Quantisation": "sensor.quantisation.EFFECT_TYPE",
        # Noise before the mosaic: the three colours of a pixel have independent noise, so the
        # mosaic keeps one measurement of each pixel.
        "Bayer": "sensor.bayer.EFFECT_TYPE",
        "WhiteBalance": "sensor.white_balance.EFFECT_TYPE",
        "Response": "sensor.response.EFFECT_TYPE",
    },
)
