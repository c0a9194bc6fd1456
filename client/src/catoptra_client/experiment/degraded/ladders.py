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
_CAMERA = "[Catoptra.OmniCaptureCamera]"
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
class Rung:
    """How bad it is, in the ladder's unit, and what the capture camera's section says for it."""

    label: str
    keys: str


@dataclass(frozen=True, slots=True)
class Ladder:
    """A way in which pictures get worse. words: what happens, for people.

    base: the robot file that the rungs change. rungs: from slight to hopeless; clean pictures come
    before the first. keys: what all rungs share. Keys are as in an ini, `|` between lines.
    """

    name: str
    words: str
    unit: str
    rungs: tuple[Rung, ...]
    keys: str = ""
    base: str = SIM_ROBOT

    @property
    def slug(self) -> str:
        """Return the name as part of a file's name."""
        return self.name.lower().replace(" ", "_")


def robot_text(ladder: Ladder, rung: Rung, robots: Path) -> str:
    """Return the robot file of a rung; `robots` is the folder of those that it is based on."""
    keys = "|".join(part for part in (_ONE_SAMPLE, ladder.keys, rung.keys) if part)
    return _text(robots / ladder.base, keys)


def clean_text(robots: Path) -> str:
    """Return the robot file of clean pictures."""
    return _text(robots / SIM_ROBOT, _ONE_SAMPLE)


def _text(base: Path, keys: str) -> str:
    lines = keys.replace("|", "\n")
    return f"[Configuration]\nBasedOn={base.resolve()}\n{_SIM_ODOMETRY}{_CAMERA}\n{lines}\n"


# The pitch of a 1/3" sensor of 480 rows, were its rows 360.
_PITCH = "PixelPitch=9.87e-6"

LADDERS: tuple[Ladder, ...] = (
    Ladder(
        "Too dark",
        "the shutter is open for less than white needs",
        "exposure, share of white's",
        keys="Exposure=always|WhiteExposureTime=0.01",
        rungs=(
            Rung("0.9", "ExposureTime=0.009"),
            Rung("0.8", "ExposureTime=0.008"),
            Rung("0.6", "ExposureTime=0.006"),
            Rung("0.4", "ExposureTime=0.004"),
        ),
    ),
    Ladder(
        "Too bright",
        "the shutter is open for longer than white needs; wells run over into their columns",
        "exposure, share of white's",
        keys="Exposure=always|WhiteExposureTime=0.01|Bloom=always",
        rungs=(
            Rung("1.25", "ExposureTime=0.0125"),
            Rung("1.5", "ExposureTime=0.015"),
            Rung("2.5", "ExposureTime=0.025"),
            Rung("6", "ExposureTime=0.06"),
        ),
    ),
    Ladder(
        "Colour cast",
        "other lamps than the white balance is for: red up, blue down by as much",
        "gain of red",
        keys="WhiteBalance=always",
        rungs=(
            Rung("1.1", "RedGain=1.1|BlueGain=0.909"),
            Rung("1.15", "RedGain=1.15|BlueGain=0.870"),
            Rung("1.2", "RedGain=1.2|BlueGain=0.833"),
            Rung("1.4", "RedGain=1.4|BlueGain=0.714"),
        ),
    ),
    Ladder(
        "Noise",
        "few electrons a pixel: shot noise, and 13 electrons of read noise",
        "electrons of white",
        keys="ShotNoise=always|ReadNoise=always|ReadNoiseElectrons=13",
        rungs=(
            Rung("1800", "FullWell=1800"),
            Rung("600", "FullWell=600"),
            Rung("200", "FullWell=200"),
            Rung("60", "FullWell=60"),
        ),
    ),
    Ladder(
        "Defocus",
        "a lens at f/2 whose focus is not where the mirror's picture lies",
        "focused at, m",
        keys=f"Defocus=always|FNumber=2|{_PITCH}",
        rungs=(
            Rung("best", "FocusDistance=0"),
            Rung("0.3", "FocusDistance=0.3"),
            Rung("0.4", "FocusDistance=0.4"),
            Rung("1", "FocusDistance=1"),
        ),
    ),
    Ladder(
        "Diffraction",
        "an aperture stopped down",
        "f-number",
        keys=f"Diffraction=always|{_PITCH}",
        rungs=(
            Rung("5.6", "FNumber=5.6"),
            Rung("8", "FNumber=8"),
            Rung("16", "FNumber=16"),
            Rung("64", "FNumber=64"),
        ),
    ),
    Ladder(
        "Coloured fringes",
        "a lens that images red larger and blue smaller than green",
        "magnification of red",
        keys="ChromaticAberration=always",
        rungs=(
            Rung("1.002", "RedMagnification=1.002|BlueMagnification=0.998"),
            Rung("1.005", "RedMagnification=1.005|BlueMagnification=0.995"),
            Rung("1.01", "RedMagnification=1.01|BlueMagnification=0.99"),
            Rung("1.03", "RedMagnification=1.03|BlueMagnification=0.97"),
        ),
    ),
    Ladder(
        "Misalignment",
        "a camera ahead of the mirror's focus, which the client does not know",
        "mm",
        keys="Misalignment=always",
        rungs=(
            Rung("0.3", "MisalignmentX=0.0003"),
            Rung("1", "MisalignmentX=0.001"),
            Rung("3", "MisalignmentX=0.003"),
            Rung("8", "MisalignmentX=0.008"),
        ),
    ),
    Ladder(
        "Fog",
        "grey air between the mirror and all else",
        "extinction, 1/m",
        keys="Fog=always",
        rungs=(
            Rung("0.005", "FogDensity=0.005"),
            Rung("0.01", "FogDensity=0.01"),
            Rung("0.03", "FogDensity=0.03"),
            Rung("1", "FogDensity=1"),
        ),
    ),
    Ladder(
        "Motion blur",
        "a robot that drives, up to 0.56 m/s, and turns while the shutter is open",
        "exposure, ms",
        keys="MotionBlur=always",
        rungs=(
            Rung("20", "ExposureTime=0.02"),
            Rung("50", "ExposureTime=0.05"),
            Rung("100", "ExposureTime=0.1"),
            Rung("200", "ExposureTime=0.2"),
        ),
    ),
    Ladder(
        "Mirror dust",
        "grains of 0.2 mm on the mirror, and two scratches",
        "share covered",
        keys=f"MirrorDust=always|{_PITCH}",
        rungs=(
            Rung("0.002", "DustCover=0.002"),
            Rung("0.01", "DustCover=0.01"),
            Rung("0.05", "DustCover=0.05"),
            Rung("0.2", "DustCover=0.2"),
        ),
    ),
    Ladder(
        "What always is",
        "the robot in its mirror, shadows, a lens with cos^4, mirrors, a colour mosaic; one each",
        "effect",
        rungs=(
            Rung("robot", "OwnBody=always"),
            Rung("shadows", "Shadows=always"),
            Rung("cos^4", "Vignetting=always"),
            Rung("steel", "MirrorReflectance=always|MirrorIndex=2.8|MirrorExtinction=3.4"),
            Rung("glass", "MirrorReflectance=always|MirrorIndex=1.5|MirrorExtinction=0"),
            Rung("mosaic", "Bayer=always"),
        ),
    ),
    Ladder(
        "The real camera",
        "p2at_omni_real.ini at 360 px, all of its effects; ever less light, the same shutter",
        "light, share of white's",
        base=REAL_ROBOT,
        keys=f"ResolutionX=360|ResolutionY=360|{_PITCH}",
        rungs=(
            Rung("1", "WhiteExposureTime=0.0166667"),
            Rung("0.9", "WhiteExposureTime=0.0185185"),
            Rung("0.8", "WhiteExposureTime=0.0208333"),
            Rung("0.5", "WhiteExposureTime=0.0333333"),
            Rung("0.1", "WhiteExposureTime=0.166667"),
        ),
    ),
)
