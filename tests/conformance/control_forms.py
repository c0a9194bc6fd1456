"""Forms of the lines of a control server, in both dialects, as patterns that can be read.

A form is a line with placeholders for values: `n` a plain decimal, `v` three of them, `l` any
number of them, `b` True or False, `w` one word. `[...]` is an optional block, `...` behind a block
repeats it. Further blocks may follow: clients skip them. Source: SPEC.md 5, 8; captures of USARSim.
"""

from __future__ import annotations

import re
from functools import cache

_NUMBER = r"-?\d+(?:\.\d+)?"
_PLACEHOLDERS = {
    "n": _NUMBER,
    "v": rf"{_NUMBER},{_NUMBER},{_NUMBER}",
    "l": rf"{_NUMBER}(?:,{_NUMBER})*",
    "b": "(?:True|False)",
    "w": r"[^ {}]+",
}
_BLOCK = re.compile(r"(?P<optional>\[?)\{(?P<words>[^{}]*)\}\]?(?P<repeated>(?:\.\.\.)?)")

_POSE = "{Name w} {Location v} {Orientation v}"
_SCAN = "SEN {Time n} {Type RangeScanner} {Name w} {Resolution n} {FOV n} {Range l}"
_COMMON_READINGS = {
    "rangescanner": _SCAN,
    "ins": f"SEN [{{Time n}}] {{Type INS}} {_POSE}",
    "odometry": "SEN [{Time n}] {Type Odometry} {Name w} {Pose v}",
    "groundtruth": f"SEN {{Time n}} {{Type GroundTruth}} {_POSE}",
    "rfid": "SEN {Time n} {Type RFID} {Name w}",
    "victsensor": "SEN [{Time n}] {Type VictSensor} {Name w}",
    "gps": "SEN [{Time n}] {Type GPS} {Name w}",
}
# By dialect and type in lower case. UT2004 lists the sensors of some types in one line.
READING_FORMS = {
    "ut2004": {
        **_COMMON_READINGS,
        "sonar": "SEN {Time n} {Type Sonar} {Name w Range n}...",
        "encoder": "SEN [{Time n}] {Type Encoder} {Name w Tick n}...",
        "touch": "SEN [{Time n}] {Type Touch} {Name w Touch b}...",
    },
    "udk": {
        **_COMMON_READINGS,
        "sonar": "SEN {Time n} {Type Sonar} {Name w} {Range n}",
        "encoder": "SEN [{Time n}] {Type Encoder} {Name w} {Tick n}",
        "touch": "SEN [{Time n}] {Type Touch} {Name w} {Touch b}",
    },
}
LISTED_TYPES = {"ut2004": ("sonar", "encoder", "touch"), "udk": ()}
"""Types of which one line lists all sensors."""

_STEERING = (
    "{SteeringType w} {Mass n} {MaxSpeed n} {MaxTorque n} {MaxFrontSteer n} {MaxRearSteer n}"
)
_RANGES = "{Name w} {MaxRange n} {MinRange n}"
_COMMON_CONFIGURATIONS = {
    "encoder": "CONF {Type Encoder} {Name w} {Resolution n}",
    "odometry": "CONF {Type Odometry} {Name w} {ScanInterval n} {EncoderResolution n}",
    "groundtruth": "CONF {Type GroundTruth} {Name w} {ScanInterval n}",
    "ins": "CONF {Type INS} {Name w} {ScanInterval n}",
}
CONFIGURATION_FORMS = {
    "ut2004": {
        **_COMMON_CONFIGURATIONS,
        "robot": f"CONF {{Type w}} {{Name w}} {_STEERING}",
        "rangescanner": f"CONF {{Type RangeScanner}} {_RANGES} "
        "{Resolution n} {Fov n} {Paning b} {Tilting b}",
        "sonar": f"CONF {{Type Sonar}} {_RANGES} {{BeamAngle n}}",
    },
    "udk": {
        **_COMMON_CONFIGURATIONS,
        "robot": f"CONF {{Name w}} {{Type w}} {_STEERING}",
        "rangescanner": f"CONF {{Type RangeScanner}} {_RANGES} "
        "{Resolution n} {Fov n} {Panning b} {Tilting b}",
        "sonar": f"CONF {{Type Sonar}} {_RANGES} {{ScanInterval n}} {{beamAngle n}}",
    },
}
ROBOT_GEOMETRY_FORM = (
    "GEO {Type w} {Name w} {Dimensions v} {COG v} {WheelRadius n} {WheelSeparation n} {WheelBase n}"
)
PART_GEOMETRY_FORMS = {
    "ut2004": "GEO {Type w} {Name w Location v Orientation v Mount w}...",
    "udk": "GEO {Type w} {Name w} {Location v} {Orientation v} {Mount w}",
}


def matches_form(text: str, form: str, dialect: str) -> bool:
    """Whether a line without its end has a form; the types of sensors in any case."""
    return _compile(form, dialect).fullmatch(text) is not None


@cache
def _compile(form: str, dialect: str) -> re.Pattern[str]:
    word, _, _ = form.partition(" ")
    # UDK leaves out the space before some blocks.
    space = " ?" if dialect == "udk" else " "
    blocks = "".join(_compile_block(found, space) for found in _BLOCK.finditer(form))
    return re.compile(rf"{word}{blocks}(?:{space}\{{[^{{}}]*\}})*")


def _compile_block(found: re.Match[str], space: str) -> str:
    key, *values = found["words"].split(" ")
    words = [_PLACEHOLDERS.get(value, f"(?i:{re.escape(value)})") for value in values]
    # In a list of UT2004 every second word is a key.
    block = rf"(?:{space}\{{{' '.join((key, *words))}\}})"
    return block + ("?" if found["optional"] else "+" if found["repeated"] else "")
