"""Effects of scene, lens, mirror and sensor on a camera's image: the table, in optical order.

The order follows the light: the scene effects come first, since they change the objects, the
light, the air or the times that a renderer works on; the image effects follow, from the lens to the
sensor's white balance. Motion and defocus act before anything that lies on mirror and
lens, which neither moves nor blurs with the scene. `plan_effects` decides in this order, and both
renderers apply the enabled effects in this order.

To add an image effect:

1. `<folder>/<name>.py` with a frozen dataclass as in `effect.ImageEffect`: formula, source, domain
   and criterion in the module's docstring; the folder is `medium` (air and lens), `mirror` or
   `sensor`. Mathematics that several effects need goes to `kernels`.
2. A stage of the kernel: `render/trace/kernel/image.py:STAGE_MAKERS`.
3. A line in EFFECT_TYPES, at the effect's position in optical order; its name is the one of the
   effect's EFFECT_TYPE.

To add a scene effect: `scene/<name>.py` as in `effect.SceneEffect`, and the line.
Keys of the capture camera's section, both renderers, `explain` and the frame header follow from the
table. Effects that no robot file names cost nothing: no pass, no program, no buffer.
"""

from __future__ import annotations

from catoptra_protocol.lazy_table import LazyTable
from catoptra_server.effects.effect import EffectType

EFFECT_TYPES: LazyTable[EffectType] = LazyTable(
    __name__,
    {
        "SelfView": "scene.self_view.EFFECT_TYPE",
        "Shadows": "scene.shadows.EFFECT_TYPE",
        "Fog": "scene.fog.EFFECT_TYPE",
        "RollingShutter": "scene.rolling_shutter.EFFECT_TYPE",
        "MotionBlur": "scene.motion_blur.EFFECT_TYPE",
        # Supersedes Defocus where both are named, so this criterion decides first.
        "DefocusByDepth": "medium.defocus_by_depth.EFFECT_TYPE",
        "Defocus": "medium.defocus.EFFECT_TYPE",
        "Misalignment": "medium.misalignment.EFFECT_TYPE",
        "ChromaticAberration": "medium.chromatic_aberration.EFFECT_TYPE",
        "Diffraction": "medium.diffraction.EFFECT_TYPE",
        "MirrorDust": "mirror.mirror_dust.EFFECT_TYPE",
        "MirrorReflectance": "mirror.mirror_reflectance.EFFECT_TYPE",
        "Vignetting": "medium.vignetting.EFFECT_TYPE",
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
    },
)

__all__ = ["EFFECT_TYPES"]
