"""Time that effects add to a frame: rates by engine, fitted once on one machine.

Part of the rule that chooses a renderer (`renderer_rule`): the rates know nothing of the machine
that runs them. Effects count that a camera's settings name and that its scenes may need; those that
a bound proves needless even in a near, bright and fast scene, such as fog in clear air or the row
times of a global shutter, cost nothing.

Rates: tests/measurements/effect_rates.py, the shipped real camera in three worlds, driving.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from functools import lru_cache

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import EffectSettings
from catoptra_server.effects.effect_plan import plan_effects
from catoptra_server.effects.scene_summary import NUM_RINGS, SceneSummary, ShadowLoss
from catoptra_server.scene.twist import Twist


class RenderEngine(Enum):
    """Code that draws frames; each has rates of its own."""

    KERNEL = "kernel"
    """Native kernel of the trace renderer."""
    REFERENCE = "reference"
    """NumPy reference of the trace renderer."""
    SOFTWARE_OPENGL = "software OpenGL"
    """Raster renderer without a graphics processor."""


_PER_MILLION = 1e-6

# A robot that drives and turns in a bright room, half a metre from a wall: as demanding as what a
# camera meets at work, so that an effect which is needless here is needless almost anywhere.
_BUSY_SCENE = SceneSummary(
    1.0,
    min_distances_m=(0.5,) * NUM_RINGS,
    max_distance_m=20.0,
    background_radiance=(0.6, 0.6, 0.6),
    scene_twist=Twist((0.5, 0.0, 0.0), (0.0, 0.0, 0.5)),
    max_shadow_loss=ShadowLoss(0.5, 0.3),
    max_shadow_loss_with_ego_body=ShadowLoss(0.5, 0.3),
    ego_body_max_angle_rad=0.8,
    ego_body_min_distances_m=(0.3,) * NUM_RINGS,
)

# Part of what is traced or rasterized: milliseconds per million samples of the image.
_SAMPLE_RATES: Mapping[RenderEngine, Mapping[str, float]] = {
    RenderEngine.KERNEL: {
        "SelfView": 0.49,
        "Shadows": 3.7,
        "RollingShutter": 8.9,
        "MotionBlur": 20,
        "Fog": 3.4,
    },
    RenderEngine.REFERENCE: {
        "SelfView": 274.0,
        "Shadows": 1000.0,
        "RollingShutter": 1570.0,
        "MotionBlur": 433.0,
        "Fog": 964.0,
    },
    RenderEngine.SOFTWARE_OPENGL: {
        "SelfView": 0.78,
        "Shadows": 18.0,
        "RollingShutter": 814.0,
        "MotionBlur": 172.0,
        "Fog": 1.0,
    },
}
# The kernel's image stages, which change the images of software OpenGL as well: milliseconds per
# million pixels.
_NATIVE_PIXEL_RATES: Mapping[str, float] = {
    "DefocusByDepth": 22,
    "Defocus": 10,
    "Misalignment": 4.4,
    "ChromaticAberration": 2.9,
    "Diffraction": 2.9,
    "MirrorDust": 2.2,
    "MirrorReflectance": 1.7,
    "Vignetting": 2.6,
    "Exposure": 1.6,
    "AutoExposure": 2.3,
    "Blooming": 0.37,
    "FixedPattern": 4.8,
    "ShotNoise": 3.5,
    "ReadNoise": 2.1,
    "Quantisation": 1.9,
    "Bayer": 2,
    "WhiteBalance": 1.5,
}
# Passes over the finished image: milliseconds per million pixels. The reference encodes the image
# before and after each effect to measure the change, which takes longer than most effects.
_PIXEL_RATES: Mapping[RenderEngine, Mapping[str, float]] = {
    RenderEngine.KERNEL: _NATIVE_PIXEL_RATES,
    RenderEngine.REFERENCE: {
        "DefocusByDepth": 920.0,
        "Defocus": 60.0,
        "Misalignment": 40.0,
        "ChromaticAberration": 40.0,
        "Diffraction": 40.0,
        "MirrorDust": 40.0,
        "MirrorReflectance": 40.0,
        "Vignetting": 40.0,
        "Exposure": 40.0,
        "AutoExposure": 40.0,
        "Blooming": 60.0,
        "FixedPattern": 60.0,
        "ShotNoise": 70.0,
        "ReadNoise": 40.0,
        "Quantisation": 40.0,
        "Bayer": 45.0,
        "WhiteBalance": 40.0,
    },
    # Ranges are rastered anew, where trace has them of its own rays. Without the kernel NumPy takes
    # longer, but then trace has its reference alone, which is far slower still.
    RenderEngine.SOFTWARE_OPENGL: {**_NATIVE_PIXEL_RATES, "DefocusByDepth": 64.0},
}


@lru_cache(maxsize=64)
def find_possible_effects(settings: EffectSettings, camera: OmniCamera) -> frozenset[str]:
    """Names of the effects that a camera may draw: named, not never, and not proved needless."""
    plan = plan_effects(settings, _BUSY_SCENE, camera)
    return frozenset(effect.name for effect in plan.enabled_effects)


def predict_effects_ms(
    engine: RenderEngine, effects: frozenset[str], *, num_pixels: int, num_samples: int
) -> float:
    """Milliseconds that effects add to a frame on the rule's machine.

    Args:
        effects: Names of the effects; one without a rate costs nothing.
        num_pixels: Pixels of the image.
        num_samples: Samples of the image.
    """
    pixels, samples = _PER_MILLION * num_pixels, _PER_MILLION * num_samples
    sample_rates, pixel_rates = _SAMPLE_RATES[engine], _PIXEL_RATES[engine]
    # Sorted, so that the sum has the same last bit in every process.
    return sum(
        samples * sample_rates.get(name, 0.0) + pixels * pixel_rates.get(name, 0.0)
        for name in sorted(effects)
    )
