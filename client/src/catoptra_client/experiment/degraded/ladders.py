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


LADDERS: tuple[Ladder, ...] = (
    Ladder(
        "Too dark",
        "the shutter is open for less than white needs",
        "exposure, share of white's",
        keys="Exposure=always|WhiteExposureTime=0.016",
        rungs=(
            Rung("0.8", "ExposureTime=0.0128"),
            Rung("0.6", "ExposureTime=0.0096"),
            Rung("0.4", "ExposureTime=0.0064"),
            Rung("0.1", "ExposureTime=0.0016"),
        ),
    ),
    Ladder(
        "Too bright",
        "the shutter is open for longer than white needs; wells run over",
        "exposure, share of white's",
        keys="Exposure=always|WhiteExposureTime=0.016",
        rungs=(
            Rung("1.25", "ExposureTime=0.02"),
            Rung("1.5", "ExposureTime=0.024"),
            Rung("2.5", "ExposureTime=0.04"),
            Rung("6", "ExposureTime=0.096"),
        ),
    ),
    Ladder(
        "Noise",
        "few electrons a pixel: shot noise, and 13 electrons of read noise",
        "electrons of white",
        keys="ShotNoise=always|ReadNoise=always|ReadNoiseElectrons=13",
        rungs=(
            Rung("18000", "FullWell=18000"),
            Rung("1800", "FullWell=1800"),
            Rung("600", "FullWell=600"),
            Rung("200", "FullWell=200"),
            Rung("60", "FullWell=60"),
        ),
    ),
    Ladder(
        "Colour cast",
        "white balance of other lamps: red up, blue down by as much",
        "gain of red",
        keys="WhiteBalance=always",
        rungs=(
            Rung("1.1", "RedGain=1.1|BlueGain=0.909"),
            Rung("1.2", "RedGain=1.2|BlueGain=0.833"),
            Rung("1.4", "RedGain=1.4|BlueGain=0.714"),
            Rung("2", "RedGain=2|BlueGain=0.5"),
        ),
    ),
    Ladder(
        "Steel mirror",
        "a mirror of worse reflectance, from aluminium to bare carbon",
        "n, k",
        keys="MirrorReflectance=always",
        rungs=(
            Rung("0.96, 6.7", "MirrorIndex=0.96|MirrorExtinction=6.7"),
            Rung("2.8, 3.4", "MirrorIndex=2.8|MirrorExtinction=3.4"),
            Rung("2.4, 1.0", "MirrorIndex=2.4|MirrorExtinction=1.0"),
            Rung("1.5, 0", "MirrorIndex=1.5|MirrorExtinction=0"),
        ),
    ),
    Ladder(
        "Sensor",
        "what every colour sensor does: lens, mosaic, and their sum with noise",
        "effects",
        rungs=(
            Rung("cos^4", "Vignetting=always"),
            Rung("mosaic", "Bayer=always"),
            Rung("both", "Vignetting=always|Bayer=always"),
            Rung(
                "and noise",
                "Vignetting=always|Bayer=always|ShotNoise=always|ReadNoise=always|FullWell=1800",
            ),
        ),
    ),
    Ladder(
        "Bloom",
        "wells run over into their columns: a shutter too long by the factor, half is left",
        "exposure, share of white's",
        keys="Exposure=always|WhiteExposureTime=0.016|Bloom=always|BloomShare=0.5|BloomLength=40",
        rungs=(
            Rung("1", "ExposureTime=0.016"),
            Rung("1.25", "ExposureTime=0.02"),
            Rung("2.5", "ExposureTime=0.04"),
            Rung("6", "ExposureTime=0.096"),
        ),
    ),
    Ladder(
        "The real camera",
        "p2at_omni_real.ini at 360 px: all of its effects, ever less light, the same shutter",
        "light",
        base=REAL_ROBOT,
        keys="ResolutionX=360|ResolutionY=360",
        rungs=(
            Rung("full", "WhiteExposureTime=0.0166667"),
            Rung("0.8", "WhiteExposureTime=0.0208333"),
            Rung("0.5", "WhiteExposureTime=0.0333333"),
            Rung("0.25", "WhiteExposureTime=0.0666667"),
            Rung("0.05", "WhiteExposureTime=0.333333"),
        ),
    ),
)  # fmt: skip
