"""Sweeps of the study: ways in which an image degrades, each from clean to hopeless.

One visible table. A level is a few lines of a robot file; the server rejects keys that it does not
know, so the table has only effects that exist. All sweeps begin with the same clean images: the
simulated robot's, without effects. A new sweep is an entry of SWEEPS.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_SIM_ROBOT = "p2at_omni_sim.ini"
REAL_ROBOT = "p2at_omni_real.ini"
_CAMERA_SECTION = "[Catoptra.OmniCaptureCamera]"
# One ray a pixel: half the time of the experiment's four, and 99 % of the beacons are still found.
_ONE_SAMPLE = "Samples=1"
# The odometry of the simulated robot, for robot files with another base: all levels must
# drive with the same errors.
_SIM_ODOMETRY = """\
[USARBot.OdometrySensor]
TurnScale=0.94
DriftPerMetre=0.0218
[USARBot.GroundTruth]
Decimals=4
"""


@dataclass(frozen=True, slots=True)
class DegradationSweep:
    """One way in which an image degrades."""

    name: str

    description: str
    """Cause of the degradation, as a clause without a full stop."""

    unit: str
    """Quantity and unit of the labels."""

    levels: Mapping[str, str]
    """Keys of the capture camera's section by label, with `|` between lines: levels from slight to
    hopeless, clean images before the first. A label is the strength in the sweep's unit."""

    ini_keys: str = ""
    """Keys that all levels share, with `|` between lines."""

    base_robot: str = _SIM_ROBOT
    """Robot file on which the levels are based."""

    @property
    def slug(self) -> str:
        """The name as part of a file name."""
        return self.name.lower().replace(" ", "_")


def degraded_robot_ini(sweep: DegradationSweep, level_keys: str, robot_folder: Path) -> str:
    """Robot file of one level.

    Args:
        sweep: Sweep of the level.
        level_keys: Keys of the level, as in the sweep.
        robot_folder: Folder of the robot files on which sweeps are based.
    """
    # Later keys win, so a level can override the sweep.
    keys = "|".join(part for part in (_ONE_SAMPLE, sweep.ini_keys, level_keys) if part)
    return _robot_ini(robot_folder / sweep.base_robot, keys)


def clean_robot_ini(robot_folder: Path) -> str:
    """Robot file of clean images."""
    return _robot_ini(robot_folder / _SIM_ROBOT, _ONE_SAMPLE)


def _robot_ini(base_robot: Path, ini_keys: str) -> str:
    lines = ini_keys.replace("|", "\n")
    based_on = f"[Configuration]\nBasedOn={base_robot.resolve()}\n"
    return f"{based_on}{_SIM_ODOMETRY}{_CAMERA_SECTION}\n{lines}\n"


def _vary(key: str, values: Mapping[str, float]) -> dict[str, str]:
    """Levels that set one key, from its values by label."""
    return {label: f"{key}={value}" for label, value in values.items()}


# A 1/3" sensor of 480 rows with the height divided into 360, the rows of the study's images.
_PIXEL_PITCH = "PixelPitch=9.87e-6"

# Each first level is hardly visible and each last one hopeless, so that the failing level lies
# between. Labels are text: some sweeps have no numbers.
SWEEPS: tuple[DegradationSweep, ...] = (
    DegradationSweep(
        # Without noise: encoded values fall as for a camera of fixed gain, and nothing else
        # changes.
        "Too dark",
        "an exposure shorter than white needs",
        "exposure, fraction of white's",
        ini_keys="Exposure=always|WhiteExposureTime=0.01",
        levels=_vary("ExposureTime", {"0.9": 0.009, "0.8": 0.008, "0.6": 0.006, "0.4": 0.004}),
    ),
    DegradationSweep(
        # With blooming, since a real sensor that clips also spills.
        "Too bright",
        "an exposure longer than white needs; full wells spill into their columns",
        "exposure, fraction of white's",
        ini_keys="Exposure=always|WhiteExposureTime=0.01|Blooming=always",
        levels=_vary("ExposureTime", {"1.25": 0.0125, "1.5": 0.015, "2.5": 0.025, "6": 0.06}),
    ),
    DegradationSweep(
        # BlueGain is the inverse of RedGain.
        "Colour cast",
        "light that the white balance is not set for: red raised, blue lowered by the same factor",
        "gain of red",
        ini_keys="WhiteBalance=always",
        levels={
            "1.1": "RedGain=1.1|BlueGain=0.909",
            "1.15": "RedGain=1.15|BlueGain=0.870",
            "1.2": "RedGain=1.2|BlueGain=0.833",
            "1.4": "RedGain=1.4|BlueGain=0.714",
        },
    ),
    DegradationSweep(
        # The well sets the shot noise: fewer electrons for the same white.
        "Noise",
        "few electrons a pixel: shot noise, and 13 electrons of read noise",
        "electrons of white",
        ini_keys="ShotNoise=always|ReadNoise=always|ReadNoiseElectrons=13",
        levels=_vary("FullWell", {"1800": 1800, "600": 600, "200": 200, "60": 60}),
    ),
    DegradationSweep(
        # 0 selects the best focus of the lens.
        "Defocus",
        "a lens at f/2 whose focus is not at the mirror's virtual image",
        "focused at, m",
        ini_keys=f"Defocus=always|FNumber=2|{_PIXEL_PITCH}",
        levels=_vary("FocusDistance", {"best": 0, "0.3": 0.3, "0.4": 0.4, "1": 1}),
    ),
    DegradationSweep(
        "Diffraction",
        "an aperture stopped down",
        "f-number",
        ini_keys=f"Diffraction=always|{_PIXEL_PITCH}",
        levels=_vary("FNumber", {"5.6": 5.6, "8": 8, "16": 16, "64": 64}),
    ),
    DegradationSweep(
        # 1 % at the rim, 180 px from the centre, is nearly two pixels.
        "Coloured fringes",
        "a lens that images red larger and blue smaller than green",
        "magnification of red",
        ini_keys="ChromaticAberration=always",
        levels={
            "1.002": "RedMagnification=1.002|BlueMagnification=0.998",
            "1.005": "RedMagnification=1.005|BlueMagnification=0.995",
            "1.01": "RedMagnification=1.01|BlueMagnification=0.99",
            "1.03": "RedMagnification=1.03|BlueMagnification=0.97",
        },
    ),
    DegradationSweep(
        # The client keeps the model of an aligned camera: bearings err, colours do not.
        "Misalignment",
        "a camera ahead of the mirror's focus, unknown to the client",
        "mm",
        ini_keys="Misalignment=always",
        levels=_vary("MisalignmentX", {"0.3": 0.0003, "1": 0.001, "3": 0.003, "8": 0.008}),
    ),
    DegradationSweep(
        # At 1/m a beacon at 2.5 m keeps 8 % of the contrast.
        "Fog",
        "grey air between the mirror and the scene",
        "extinction, 1/m",
        ini_keys="Fog=always",
        levels=_vary("FogDensity", {"0.005": 0.005, "0.01": 0.01, "0.03": 0.03, "1": 1}),
    ),
    DegradationSweep(
        # Up to 11 cm of travel in the longest exposure.
        "Motion blur",
        "a robot that drives, up to 0.56 m/s, and turns during the exposure",
        "exposure, ms",
        ini_keys="MotionBlur=always",
        levels=_vary("ExposureTime", {"20": 0.02, "50": 0.05, "100": 0.1, "200": 0.2}),
    ),
    DegradationSweep(
        # Coverage grows; the size of the particles and the scratches stay.
        "Mirror dust",
        "dust particles of 0.2 mm on the mirror, and two scratches",
        "fraction covered",
        ini_keys=f"MirrorDust=always|{_PIXEL_PITCH}",
        levels=_vary("DustCoverage", {"0.002": 0.002, "0.01": 0.01, "0.05": 0.05, "0.2": 0.2}),
    ),
    DegradationSweep(
        # Nothing to vary: each level is another effect that every real camera has.
        "Always present",
        "one effect each: robot in the mirror, shadows, cos^4 of a lens, mirrors, colour mosaic",
        "effect",
        levels={
            "robot": "SelfView=always",
            "shadows": "Shadows=always",
            "cos^4": "Vignetting=always",
            "steel": "MirrorReflectance=always|MirrorIndex=2.8|MirrorExtinction=3.4",
            "glass": "MirrorReflectance=always|MirrorIndex=1.5|MirrorExtinction=0",
            "mosaic": "Bayer=always",
        },
    ),
    DegradationSweep(
        # WhiteExposureTime is the exposure that white needs: longer means less light.
        "The real camera",
        "p2at_omni_real.ini at 360 px with all its effects; less and less light, the same exposure",
        "light, fraction of white's",
        base_robot=REAL_ROBOT,
        ini_keys=f"ResolutionX=360|ResolutionY=360|{_PIXEL_PITCH}",
        levels=_vary(
            "WhiteExposureTime",
            {"1": 0.0166667, "0.9": 0.0185185, "0.8": 0.0208333, "0.5": 0.0333333, "0.1": 0.166667},
        ),
    ),
)
