"""What an effect is: frozen parameters, a bound on what it can change, its float64 reference.

An effect changes the linear picture of an omnidirectional camera after it is whole: no seams. Light
is (h, w, 3), 1 = what fills a pixel's well, as in `scene/shading` 1 = a white facet at full scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.scene_summary import SceneSummary

# float64 for the reference; float32 where a renderer applies it to its pictures.
Real = TypeVar("Real", np.float32, np.float64)
# What has three dimensions is a map of (rows, columns, 1 to 4) float32: in a shader a texture, read
# unfiltered. It is uploaded once, as long as the same array is returned.
Uniforms = Mapping[str, npt.NDArray[np.float32] | npt.NDArray[np.uint32]]

# Units of bounds: how far a grey changes, or how far off what a pixel shows comes from.
GREY_LEVELS = "grey levels"
PIXELS = "px"


class EffectMode(Enum):
    """Who decides whether an effect runs: its criterion, or the robot's file."""

    AUTO = "auto"
    ALWAYS = "always"
    NEVER = "never"


@dataclass(frozen=True, slots=True)
class EffectBound:
    """The most that an effect can change any pixel, in its unit, and why, in words."""

    value: float
    reason: str


class Effect(Protocol):
    """What every effect has: frozen parameters in physical units, hashable, and its criterion.

    What has no more than this changes what there is to be seen, before anything is drawn:
    `render/scene_effects` knows how.
    """

    def __hash__(self) -> int:
        """Return the hash of its parameters: decisions are kept by it."""

    @property
    def name(self) -> str:
        """Return its name: the key of its mode, and its stage in timings."""

    @property
    def unit(self) -> str:
        """Return the unit of its bound: GREY_LEVELS or PIXELS."""

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the most that it can change any pixel of what reaches it."""

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return what the summary is behind it."""


@runtime_checkable
class ImageEffect(Effect, Protocol):
    """What changes the picture. Most modules of this folder hold one.

    Its shader is `glsl/effect_<name>.frag`, with the texture `picture`, `range_m` if it uses
    that, and the uniforms named here.
    """

    @property
    def needs_range(self) -> bool:
        """Return whether it asks what each pixel sees: then renderers find that out."""

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the changed picture, a new array of the same type."""

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return what its shader is told for a frame; `mean_light` measures what reaches it."""


@lru_cache(maxsize=256)
def needs_scene_geometry(effect: Effect) -> bool:
    """Return whether a criterion may look at distances, motions or shadows in a summary.

    May: what is staged, what looks at what each pixel sees, and what moves or spreads light, by as
    much as the scene is near. The others change the light of a pixel, whatever it shows.
    """
    return not isinstance(effect, ImageEffect) or effect.needs_range or effect.unit == PIXELS


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A number of an effect: its key in the capture camera's section, its field, its range."""

    key: str
    field: str
    default: float
    min_value: float
    max_value: float


@dataclass(frozen=True, slots=True)
class EffectType:
    """An effect as it is configured: the key of its mode, and its numbers."""

    name: str
    factory: Callable[..., Effect]
    parameters: tuple[EffectParameter, ...] = ()


@dataclass(frozen=True, slots=True)
class EffectSetting:
    """An effect that a robot's file names, and who decides about it."""

    effect: Effect
    mode: EffectMode


@dataclass(frozen=True, slots=True)
class EffectSettings:
    """What a robot's file says of effects, in optical order; most files say nothing.

    threshold_grey_levels, threshold_px: what may be left out changes no pixel by more.
    """

    settings: tuple[EffectSetting, ...] = ()
    threshold_grey_levels: float = 0.5
    threshold_px: float = 0.5
    _hash: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        whole = (self.settings, self.threshold_grey_levels, self.threshold_px)
        object.__setattr__(self, "_hash", hash(whole))

    def __hash__(self) -> int:
        """Return what was found once: views and decisions are looked up by it in every frame."""
        return self._hash

    def threshold(self, unit: str) -> float:
        """Return the threshold of bounds in a unit."""
        return self.threshold_px if unit == PIXELS else self.threshold_grey_levels


NO_EFFECT_SETTINGS = EffectSettings()


@lru_cache(maxsize=64)
def needs_radiance_only(settings: EffectSettings) -> bool:
    """Return whether no effect that is named asks for more of a scene than its light."""
    return not any(needs_scene_geometry(wish.effect) for wish in settings.settings)


def float32_array(*values: float) -> npt.NDArray[np.float32]:
    """Return a uniform's numbers."""
    return np.array(values, dtype=np.float32)
