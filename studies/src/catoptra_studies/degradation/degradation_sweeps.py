"""The ladders of the study: ways in which a picture gets worse, each from clean to hopeless.

One visible table. A rung is what a robot's file says; effects whose keys are not known to the
server make it refuse the file, so the table has only what exists. All ladders begin at the same
clean pictures: the demo's robot, no effects.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

SIM_ROBOT = "p2at_omni_sim.ini"
REAL_ROBOT = "p2at_omni_real.ini"
_CAMERA_SECTION = "[Catoptra.OmniCaptureCamera]"
# One ray a pixel: half the time of the demo's four, and 99 % of the beacons are found all the same.
_ONE_SAMPLE = "Samples=1"
# The sim robot's odometry, for a robot file that is not based on it.
_SIM_ODOMETRY = """\
[USARBot.OdometrySensor]
TurnScale=0.94
DriftPerMetre=0.0218
[USARBot.GroundTruth]
Decimals=4
"""


@dataclass(frozen=True, slots=True)
class DegradationLevel:
    """How bad it is, in the ladder's unit, and what the capture camera's section says for it."""

    label: str
    ini_keys: str


@dataclass(frozen=True, slots=True)
class DegradationSweep:
    """A way in which pictures get worse. words: what happens, for people.

    base: the robot file that the rungs change. rungs: from slight to hopeless; clean pictures come
    before the first. keys: what all rungs share. Keys are as in an ini, `|` between lines.
    """

    name: str
    description: str
    unit: str
    levels: tuple[DegradationLevel, ...]
    ini_keys: str = ""
    base_robot: str = SIM_ROBOT

    @property
    def slug(self) -> str:
        """Return the name as part of a file's name."""
        return self.name.lower().replace(" ", "_")


def degraded_robot_ini(sweep: DegradationSweep, level: DegradationLevel, robot_folder: Path) -> str:
    """Return the robot file of a rung; `robots` is the folder of those that it is based on."""
    keys = "|".join(part for part in (_ONE_SAMPLE, sweep.ini_keys, level.ini_keys) if part)
    return _robot_ini(robot_folder / sweep.base_robot, keys)


def clean_robot_ini(robot_folder: Path) -> str:
    """Return the robot file of clean pictures."""
    return _robot_ini(robot_folder / SIM_ROBOT, _ONE_SAMPLE)


def _robot_ini(base_robot: Path, ini_keys: str) -> str:
    lines = ini_keys.replace("|", "\n")
    return f"[Configuration]\nBasedOn={base_robot.resolve()}\n{_SIM_ODOMETRY}{_CAMERA_SECTION}\n{lines}\n"


# The pitch of a 1/3" sensor of 480 rows, were its rows 360.
_PIXEL_PITCH = "PixelPitch=9.87e-6"

SWEEPS: tuple[DegradationSweep, ...] = (
    DegradationSweep(
        "Too dark",
        "the shutter is open for less than white needs",
        "exposure, share of white's",
        ini_keys="Exposure=always|WhiteExposureTime=0.01",
        levels=(
            DegradationLevel("0.9", "ExposureTime=0.009"),
            DegradationLevel("0.8", "ExposureTime=0.008"),
            DegradationLevel("0.6", "ExposureTime=0.006"),
            DegradationLevel("0.4", "ExposureTime=0.004"),
        ),
    ),
    DegradationSweep(
        "Too bright",
        "the shutter is open for longer than white needs; wells run over into their columns",
        "exposure, share of white's",
        ini_keys="Exposure=always|WhiteExposureTime=0.01|Blooming=always",
        levels=(
            DegradationLevel("1.25", "ExposureTime=0.0125"),
            DegradationLevel("1.5", "ExposureTime=0.015"),
            DegradationLevel("2.5", "ExposureTime=0.025"),
            DegradationLevel("6", "ExposureTime=0.06"),
        ),
    ),
    DegradationSweep(
        "Colour cast",
        "other lamps than the white balance is for: red up, blue down by as much",
        "gain of red",
        ini_keys="WhiteBalance=always",
        levels=(
            DegradationLevel("1.1", "RedGain=1.1|BlueGain=0.909"),
            DegradationLevel("1.15", "RedGain=1.15|BlueGain=0.870"),
            DegradationLevel("1.2", "RedGain=1.2|BlueGain=0.833"),
            DegradationLevel("1.4", "RedGain=1.4|BlueGain=0.714"),
        ),
    ),
    DegradationSweep(
        "Noise",
        "few electrons a pixel: shot noise, and 13 electrons of read noise",
        "electrons of white",
        ini_keys="ShotNoise=always|ReadNoise=always|ReadNoiseElectrons=13",
        levels=(
            DegradationLevel("1800", "FullWell=1800"),
            DegradationLevel("600", "FullWell=600"),
            DegradationLevel("200", "FullWell=200"),
            DegradationLevel("60", "FullWell=60"),
        ),
    ),
    DegradationSweep(
        "Defocus",
        "a lens at f/2 whose focus is not where the mirror's picture lies",
        "focused at, m",
        ini_keys=f"Defocus=always|FNumber=2|{_PIXEL_PITCH}",
        levels=(
            DegradationLevel("best", "FocusDistance=0"),
            DegradationLevel("0.3", "FocusDistance=0.3"),
            DegradationLevel("0.4", "FocusDistance=0.4"),
            DegradationLevel("1", "FocusDistance=1"),
        ),
    ),
    DegradationSweep(
        "Diffraction",
        "an aperture stopped down",
        "f-number",
        ini_keys=f"Diffraction=always|{_PIXEL_PITCH}",
        levels=(
            DegradationLevel("5.6", "FNumber=5.6"),
            DegradationLevel("8", "FNumber=8"),
            DegradationLevel("16", "FNumber=16"),
            DegradationLevel("64", "FNumber=64"),
        ),
    ),
    DegradationSweep(
        "Coloured fringes",
        "a lens that images red larger and blue smaller than green",
        "magnification of red",
        ini_keys="ChromaticAberration=always",
        levels=(
            DegradationLevel("1.002", "RedMagnification=1.002|BlueMagnification=0.998"),
            DegradationLevel("1.005", "RedMagnification=1.005|BlueMagnification=0.995"),
            DegradationLevel("1.01", "RedMagnification=1.01|BlueMagnification=0.99"),
            DegradationLevel("1.03", "RedMagnification=1.03|BlueMagnification=0.97"),
        ),
    ),
    DegradationSweep(
        "Misalignment",
        "a camera ahead of the mirror's focus, which the client does not know",
        "mm",
        ini_keys="Misalignment=always",
        levels=(
            DegradationLevel("0.3", "MisalignmentX=0.0003"),
            DegradationLevel("1", "MisalignmentX=0.001"),
            DegradationLevel("3", "MisalignmentX=0.003"),
            DegradationLevel("8", "MisalignmentX=0.008"),
        ),
    ),
    DegradationSweep(
        "Fog",
        "grey air between the mirror and all else",
        "extinction, 1/m",
        ini_keys="Fog=always",
        levels=(
            DegradationLevel("0.005", "FogDensity=0.005"),
            DegradationLevel("0.01", "FogDensity=0.01"),
            DegradationLevel("0.03", "FogDensity=0.03"),
            DegradationLevel("1", "FogDensity=1"),
        ),
    ),
    DegradationSweep(
        "Motion blur",
        "a robot that drives, up to 0.56 m/s, and turns while the shutter is open",
        "exposure, ms",
        ini_keys="MotionBlur=always",
        levels=(
            DegradationLevel("20", "ExposureTime=0.02"),
            DegradationLevel("50", "ExposureTime=0.05"),
            DegradationLevel("100", "ExposureTime=0.1"),
            DegradationLevel("200", "ExposureTime=0.2"),
        ),
    ),
    DegradationSweep(
        "Mirror dust",
        "grains of 0.2 mm on the mirror, and two scratches",
        "share covered",
        ini_keys=f"MirrorDust=always|{_PIXEL_PITCH}",
        levels=(
            DegradationLevel("0.002", "DustCoverage=0.002"),
            DegradationLevel("0.01", "DustCoverage=0.01"),
            DegradationLevel("0.05", "DustCoverage=0.05"),
            DegradationLevel("0.2", "DustCoverage=0.2"),
        ),
    ),
    DegradationSweep(
        "What always is",
        "the robot in its mirror, shadows, a lens with cos^4, mirrors, a colour mosaic; one each",
        "effect",
        levels=(
            DegradationLevel("robot", "SelfView=always"),
            DegradationLevel("shadows", "Shadows=always"),
            DegradationLevel("cos^4", "Vignetting=always"),
            DegradationLevel(
                "steel", "MirrorReflectance=always|MirrorIndex=2.8|MirrorExtinction=3.4"
            ),
            DegradationLevel(
                "glass", "MirrorReflectance=always|MirrorIndex=1.5|MirrorExtinction=0"
            ),
            DegradationLevel("mosaic", "Bayer=always"),
        ),
    ),
    DegradationSweep(
        "The real camera",
        "p2at_omni_real.ini at 360 px, all of its effects; ever less light, the same shutter",
        "light, share of white's",
        base_robot=REAL_ROBOT,
        ini_keys=f"ResolutionX=360|ResolutionY=360|{_PIXEL_PITCH}",
        levels=(
            DegradationLevel("1", "WhiteExposureTime=0.0166667"),
            DegradationLevel("0.9", "WhiteExposureTime=0.0185185"),
            DegradationLevel("0.8", "WhiteExposureTime=0.0208333"),
            DegradationLevel("0.5", "WhiteExposureTime=0.0333333"),
            DegradationLevel("0.1", "WhiteExposureTime=0.166667"),
        ),
    ),
)
