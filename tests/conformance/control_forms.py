"""Forms of the lines of a control server, in both dialects, as patterns that can be read.

A form is a line with placeholders for values: `n` a plain decimal, `v` three of them, `l` any
number of them, `i` an integer, `b` True or False, `w` one word. `[...]` is an optional block, `...`
behind a block repeats it. Further blocks may follow: clients skip them. Source: SPEC.md 5, 8;
captures of USARSim.
"""

from __future__ import annotations

import re
from functools import cache

from catoptra_protocol.usarsim.grammar import Message

_NUMBER = r"-?\d+(?:\.\d+)?"
_PLACEHOLDERS = {
    "n": _NUMBER,
    "v": rf"{_NUMBER},{_NUMBER},{_NUMBER}",
    "l": rf"{_NUMBER}(?:,{_NUMBER})*",
    "i": r"-?\d+",
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
    "tachometer": "SEN {Time n} {Type Tachometer} {Name w} {Vel l} {Pos l}",
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
    "tachometer": "CONF {Type Tachometer} {Name w} {ScanInterval n}",
    "gps": "CONF {Type GPS} {Name w} {ScanInterval n}",
    "touch": "CONF {Type Touch} {Name w} {Diameter n}",
    "rfid": "CONF {Type RFID} {Name w} {MaxRange n}",
    "victsensor": "CONF {Type VictSensor} {Name w} {MaxRange n} {Fov n}",
    "camera": "CONF {Type Camera} {Name w} [{TextureOffsetX n}] [{TextureOffsetY n}] "
    "[{TextureResolutionX n}] [{TextureResolutionY n}] "
    "{CameraDefFov n} {CameraMinFov n} {CameraMaxFov n} {CameraFov n}",
    "mispkg": "CONF {Type MisPkg} {Name w} {Link n} {JointType w} {MaxSpeed n} {MaxTorque n} "
    "{MinRange n} {MaxRange n}",
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
        # Integers, as in captures of UDK.
        "robot": f"CONF {{Name w}} {{Type w}} {_STEERING.replace('Steer n', 'Steer i')}",
        "rangescanner": f"CONF {{Type RangeScanner}} {_RANGES} "
        "{Resolution n} {Fov n} {Panning b} {Tilting b}",
        "sonar": f"CONF {{Type Sonar}} {_RANGES} {{ScanInterval n}} {{beamAngle n}} "
        "{maxAngleOfIncidence n} {tracesPerCone n} {numberOfCones n}",
    },
}
ROBOT_GEOMETRY_FORM = (
    "GEO {Type w} {Name w} {Dimensions v} {COG v} {WheelRadius n} {WheelSeparation n} {WheelBase n}"
)
PART_GEOMETRY_FORMS = {
    "ut2004": "GEO {Type w} {Name w Location v Orientation v Mount w}...",
    "udk": "GEO {Type w} {Name w} {Location v} {Orientation v} {Mount w}",
}


_PACKAGE_GEOMETRY_FORM = (
    "GEO {Type MisPkg} {Name w} {Link n} {ParentLink n} {Location v} {Orientation v}"
)
# Of the other words, their first blocks.
_OTHER_FORMS = {
    "ut2004": {
        # Joints before the light; integers for the Java client.
        "STA": "STA {Type w} {Time n} {FrontSteer n} {RearSteer n} [{w n}]... {LightToggle b} "
        "{LightIntensity i} {Battery i} {View i}",
        "MISSTA": "MISSTA {Time n} {Name w} {Link n} {Value n} {Torque n}",
        "RES": "RES {Time n} {Type w}",
    },
    "udk": {
        "STA": "STA {Time n} {Battery i} {Type w} {LightToggle b} {LightIntensity i} "
        "{FrontSteer i} {RearSteer i}",
        "ASTA": "ASTA {Time n} {Name w} {Link n} {Value n}",
    },
}
_NO_FORM = "no line"


def find_form(message: Message, dialect: str) -> str | None:
    """Form of a line by its word and type; None for a kind without one.

    No line has that of a camera's readings in UT2004.
    """
    type_ = (message.get("Type") or "").lower()
    if message.word == "SEN":
        if type_ == "camera" and dialect == "ut2004":
            return _NO_FORM
        return READING_FORMS[dialect].get(type_, "SEN [{Time n}] {Type w}")
    if message.word == "CONF":
        key = "robot" if message.get("SteeringType") is not None else type_
        return CONFIGURATION_FORMS[dialect].get(key)
    if message.word == "GEO":
        if message.get("Dimensions") is not None:
            return ROBOT_GEOMETRY_FORM
        return _PACKAGE_GEOMETRY_FORM if type_ == "mispkg" else PART_GEOMETRY_FORMS[dialect]
    if message.get("Gametype") is not None:
        return "NFO {Gametype w} {Level w} {TimeLimit n}"
    return _OTHER_FORMS[dialect].get(message.word)


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
    # In a list of UT2004 every second word is a key; a `w` in its place is any.
    block = rf"(?:{space}\{{{' '.join((_PLACEHOLDERS.get(key, key), *words))}\}})"
    counts = {(False, False): "", (True, False): "?", (False, True): "+", (True, True): "*?"}
    return block + counts[bool(found["optional"]), bool(found["repeated"])]
