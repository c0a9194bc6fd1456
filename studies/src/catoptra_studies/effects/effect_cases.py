"""Cases of the effect pages: for each effect a scene that needs it, and a negligible one.

A new case is a line of EFFECT_CASES, in the order of the light's path.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_server.effects import Effect
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.kernels.mirror_surface import Contaminants
from catoptra_server.effects.medium.chromatic_aberration import ChromaticAberration
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.effects.medium.diffraction import Diffraction
from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.effects.medium.veiling_glare import VeilingGlare
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.mirror.mirror_dust import MirrorDust
from catoptra_server.effects.mirror.mirror_holder import MirrorHolder
from catoptra_server.effects.mirror.mirror_reflectance import MirrorReflectance
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.effects.scene.shadows import Shadows
from catoptra_server.effects.sensor.auto_exposure import AutoExposure
from catoptra_server.effects.sensor.bayer import Bayer
from catoptra_server.effects.sensor.blooming import Blooming
from catoptra_server.effects.sensor.exposure import Exposure as ShutterTime
from catoptra_server.effects.sensor.fixed_pattern import FixedPattern
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.effects.sensor.read_noise import ReadNoise
from catoptra_server.effects.sensor.response import Response
from catoptra_server.effects.sensor.shot_noise import ShotNoise
from catoptra_server.effects.sensor.white_balance import WhiteBalance
from catoptra_server.world.world_description import AT_REST, Twist

# Shared by several cases: a fifth and three times the exposure that white needs, a lens at F/4
# with pixels of 7.4 um, and a robot that drives and turns.
_SHORT_EXPOSURE = ShutterTime(0.004, 0.02)
_LONG_EXPOSURE = ShutterTime(0.06, 0.02)
_APERTURE = Aperture(4.0, 7.4e-6, 0.0)
_FAST_TWIST = Twist((0.5, 0.0, 0.0), (0.0, 0.0, 2.1))


@dataclass(frozen=True, slots=True)
class _NegligibleCase:
    """A scene in which an effect is negligible."""

    description: str
    """The difference from the other scene, as a phrase."""

    effect: Effect
    """The effect with parameters for this scene."""

    max_radiance: float = 1.0
    """Largest radiance in the scene, in units of white."""

    rim_deg: float = 120.0
    """Incidence angle of the mirror's rim."""

    downstream_effects: tuple[Effect, ...] = ()
    """Effects that may do the rest of the work."""


@dataclass(frozen=True, slots=True)
class EffectCase:
    """One page: an effect in a scene that calls for the effect."""

    effect: Effect
    negligible_case: _NegligibleCase

    description: str
    """The scene or the parameters, as a phrase."""

    upstream_effects: tuple[Effect, ...] = ()
    """Effects applied before, in both images."""

    zoom: int = 1
    """Enlargement of the detail that is shown; 1 shows the whole image."""

    twist: Twist = AT_REST
    """Motion of the robot, in the robot's axes."""

    board_distance_m: float = math.inf
    """Distance of a striped board ahead of the mirror; inf for none."""


EFFECT_CASES = (
    EffectCase(
        SelfView(),
        _NegligibleCase("a camera that no robot carries", SelfView()),
        "the P2AT in the mirror above it",
    ),
    EffectCase(
        # With the robot's body below, since a body has to be in the scene to cast a shadow.
        Shadows(),
        _NegligibleCase("a floor alone", Shadows()),
        "lamps behind on the left",
        upstream_effects=(SelfView(),),
    ),
    EffectCase(
        Fog(0.35, 0.5, 0.5, 0.5),
        _NegligibleCase("clear air", Fog(0.0, 0.5, 0.5, 0.5)),
        "fog with a visibility of 9 m",
    ),
    EffectCase(
        # The same motion for shutter and blur: the pages can be compared.
        RollingShutter(1.0 / 30.0),
        _NegligibleCase("a robot that stands", RollingShutter(1.0 / 30.0)),
        "0.5 m/s and 120 degrees/s, rows read in 33 ms",
        twist=_FAST_TWIST,
    ),
    EffectCase(
        MotionBlur(1.0 / 30.0),
        _NegligibleCase("a robot that stands", MotionBlur(1.0 / 30.0)),
        "0.5 m/s and 120 degrees/s, 33 ms",
        twist=_FAST_TWIST,
    ),
    EffectCase(
        # Nearer than half a metre, where one disc for each image radius is no longer exact.
        DefocusByDepth(Aperture(1.4, 7.4e-6, 0.0)),
        _NegligibleCase(
            "nothing near",
            DefocusByDepth(Aperture(1.4, 7.4e-6, 0.0)),
            downstream_effects=(Defocus(Aperture(1.4, 7.4e-6, 0.0)),),
        ),
        "a board 12 cm ahead",
        board_distance_m=0.12,
    ),
    EffectCase(
        Defocus(Aperture(2.0, 7.4e-6, 0.0)),
        _NegligibleCase("the same lens by moonlight", Defocus(Aperture(2.0, 7.4e-6, 0.0)), 1e-5),
        "F/2, 4 times enlarged",
        zoom=4,
    ),
    EffectCase(
        Misalignment(x_m=1e-3),
        _NegligibleCase("a camera at the mirror's focus", Misalignment()),
        "a camera 1 mm ahead of the mirror's focus",
    ),
    EffectCase(
        ChromaticAberration(1.02, 0.985),
        _NegligibleCase("a lens of one size for all colours", ChromaticAberration(1.0, 1.0)),
        "red 2 % larger than green, blue 1.5 % smaller, enlarged",
        zoom=4,
    ),
    EffectCase(
        Diffraction(16.0, 7.4e-6),
        _NegligibleCase("the same lens by moonlight", Diffraction(16.0, 7.4e-6), 1e-5),
        "F/16 on pixels of 7.4 um, 10 times enlarged",
        zoom=10,
    ),
    EffectCase(
        MirrorHolder(0, 0.05, 1.49, 0.0, 0.0, 0.0, _APERTURE),
        _NegligibleCase(
            "a tube that is nearly air", MirrorHolder(0, 0.05, 1.001, 0.0, 0.0, 0.0, _APERTURE)
        ),
        "a tube of acrylic glass, 5 cm from the axis",
    ),
    EffectCase(
        MirrorDust(Contaminants(0.01, 4e-4, 20, 0.03, 1e-4), 0.3, _APERTURE),
        _NegligibleCase(
            "a clean mirror", MirrorDust(Contaminants(0.0, 4e-4, 0, 0.03, 1e-4), 0.3, _APERTURE)
        ),
        "1 % dust of 0.4 mm, 20 scratches, at F/4",
    ),
    EffectCase(
        # Near the axis the reflectance of steel hardly varies; the paper's rim at 120 degrees makes
        # the difference.
        MirrorReflectance(2.8, 3.4),
        _NegligibleCase(
            "the same steel with its rim at 40 degrees", MirrorReflectance(2.8, 3.4), rim_deg=40.0
        ),
        "a mirror of steel, n = 2.8, k = 3.4",
    ),
    EffectCase(
        # cos^4 of the field angle: the narrower the mirror's image, the nearer to one.
        Vignetting(),
        _NegligibleCase("a mirror with its rim at 25 degrees", Vignetting(), rim_deg=25.0),
        "the paper's mirror by day",
    ),
    EffectCase(
        VeilingGlare(0.05, 0.5, 5e-5, 7.4e-6),
        _NegligibleCase(
            "a lens that scatters a hundred-thousandth", VeilingGlare(1e-5, 0.5, 5e-5, 7.4e-6)
        ),
        "a lens that scatters 5 % of its light",
    ),
    EffectCase(
        _LONG_EXPOSURE,
        _NegligibleCase("an exposure as long as white needs", ShutterTime(0.02, 0.02)),
        "60 ms where white needs 20 ms",
    ),
    EffectCase(
        # Behind a short exposure, which the gain then has to make up for.
        AutoExposure(0.18, 0.1, 10.0),
        _NegligibleCase("a camera with fixed gain", AutoExposure(0.18, 1.0, 1.0)),
        "an image exposed for 4 ms instead of 20",
        upstream_effects=(_SHORT_EXPOSURE,),
    ),
    EffectCase(
        # Full wells alone spill, so the exposure decides and the parameters stay.
        Blooming(0.3, 40.0),
        _NegligibleCase("the same at the exposure that white needs", Blooming(0.3, 40.0)),
        "60 ms where white needs 20 ms: full wells spill",
        upstream_effects=(_LONG_EXPOSURE,),
    ),
    EffectCase(
        FixedPattern(0.02, 20.0, 18000.0),
        _NegligibleCase("a sensor even to a ten-thousandth", FixedPattern(1e-4, 0.1, 18000.0)),
        "2 % of gain and 20 electrons, 10 times enlarged",
        zoom=10,
    ),
    EffectCase(
        # A tenth of a usual well, so that the noise is visible on a page.
        ShotNoise(1800.0),
        _NegligibleCase("wells of a hundred million electrons", ShotNoise(1e8)),
        "wells of 1800 electrons, 10 times enlarged",
        zoom=10,
    ),
    EffectCase(
        ReadNoise(13.0, 1800.0),
        _NegligibleCase("three hundredths of an electron", ReadNoise(0.03, 1800.0)),
        "13 electrons beside 1800 of white, 10 times enlarged",
        zoom=10,
    ),
    EffectCase(
        Quantisation(5),
        _NegligibleCase("a converter of 12 bits", Quantisation(12)),
        "a converter of 5 bits",
    ),
    EffectCase(
        # At night the mosaic's error is far below half a grey level.
        Bayer(),
        _NegligibleCase("a night, a ten-thousandth of white", Bayer(), max_radiance=1e-4),
        "the field by day, 10 times enlarged",
        zoom=10,
    ),
    EffectCase(
        WhiteBalance(1.4, 0.75),
        _NegligibleCase("gains of one", WhiteBalance(1.0, 1.0)),
        "red times 1.4, blue times 0.75",
    ),
    EffectCase(
        Response(0.3, 3.0),
        _NegligibleCase("dusk, a third of white", Response(0.3, 3.0), max_radiance=0.3),
        "a curve that bends at 0.3 and is white at 3",
    ),
)
