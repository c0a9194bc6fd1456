"""Mutations of every number and every kind of line of a control server, in either dialect.

The table of fields is read from lines that a server sent: every number of a line is a field, except
names. Lines are text with numbers at known places, so that a mutation changes these and nothing
else. Another family changes the text of all lines of a kind: blanks, ends, spelling, order.
Source: SPEC.md 3 to 6, 8.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from itertools import groupby

from conformance.field_mutations import (
    CONSTANT,
    MEASURED,
    ChangeNumbers,
    Fault,
    FieldMutation,
    Numbers,
    NumericField,
    Quantity,
    generate_mutations,
)

_VALUE = re.compile(r"(?<= )-?\d+(?:\.\d+)?(?:e-?\d+)?(?:,-?\d+(?:\.\d+)?(?:e-?\d+)?)*(?=[ }])")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
# Degrees, minutes and hemisphere are one signed angle.
_GEODETIC = re.compile(r"(?<= )(\d+),(\d+\.(\d+)),([NSEW])(?=\})")
# A vector has a field for each component, a longer list has one for all its values.
_MAX_COMPONENTS = 3
_QUANTITIES = {
    Quantity.ANGLE: "Orientation|Resolution|Fov|FOV|.*Angle.*|Camera.*Fov|Max(Front|Rear)Steer|"
    r"(Front|Rear)Steer|.*Flipper|Pose\.2|Value|Vel|Pos|Latitude|Longitude|UpAzimuth|EncoderResolution",
    Quantity.DURATION: "Time|ScanInterval|Battery|TimeLimit",
    Quantity.COUNT: "Tick|View|Link|ParentLink|Fix|Satellites|StartPoses|LightIntensity|.*Cone.*|"
    "Texture.*|Width|Height|MirrorK",
}
_NEIGHBOURS = {
    "Latitude": "Longitude",
    "Resolution": "FOV",
    "Vel": "Pos",
    "MaxRange": "MinRange",
    "Width": "CentreU",
    "WheelRadius": "WheelSeparation",
    "MaxSpeed": "MaxTorque",
    "HorizonRadius": "CentreU",
    "CameraMinFov": "CameraMaxFov",
    "Value": "Torque",
}
# Names of things, and not numbers.
_NAMES = ("ID", "Name")


@dataclasses.dataclass(frozen=True, slots=True)
class _PlacedNumber:
    """A number in a line."""

    path: str
    value: float
    start: int
    end: int
    text: str


def kind_of(line: str) -> str:
    """Word and type of a line."""
    word, found = line.partition(" ")[0], re.search(r"\{Type ([^ }]*)\}", line)
    return f"{word} {found[1]}" if found and word != "STA" else word


def read_fields(lines: Iterable[str]) -> dict[str, NumericField]:
    """Table of the fields of lines, by message and path."""
    fields: dict[str, NumericField] = {}
    for line in lines:
        kind = kind_of(line)
        for path in _numbers_of(_place_numbers(line)):
            fields.setdefault(f"{kind} {path}", _make_field(kind, path))
    return fields


def generate_line_mutations(lines: Iterable[str]) -> Iterator[FieldMutation]:
    """All mutations of the fields of lines."""
    return generate_mutations(read_fields(lines))


@dataclasses.dataclass(frozen=True, slots=True)
class TextMutation:
    """One fault of the text of all lines of a kind."""

    kind: str
    fault: str

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.kind}: {self.fault}"


def generate_text_mutations(lines: Iterable[str], dialect: str) -> Iterator[TextMutation]:
    """All mutations of the text of lines."""
    for kind in dict.fromkeys(map(kind_of, lines)):
        for fault, (kinds, dialects, _) in _TEXT_FAULTS.items():
            if dialect in dialects and re.match(kinds, kind):
                yield TextMutation(kind, fault)


def mutate_lines(mutation: FieldMutation | TextMutation) -> Callable[[str], str]:
    """Change of each line of a connection, in their order; lines of a change end with CR LF."""
    if isinstance(mutation, TextMutation):
        kind, change_text = mutation.kind, _TEXT_FAULTS[mutation.fault][2]
        return lambda line: change_text(line) if kind_of(line) == kind else line
    changes: dict[str, ChangeNumbers] = {}

    def change_line(line: str) -> str:
        if kind_of(line) != mutation.field.message:
            return line
        places = _place_numbers(line)
        numbers = _numbers_of(places)
        if mutation.field.path not in numbers:
            return line
        # UDK sends a line for each sensor: each has a value before.
        name = re.search(r"\{Name ([^ }]*)", line)
        change = changes.setdefault(name[1] if name else "", mutation.make_change())
        return _write_numbers(line, places, change(numbers))

    return change_line


def _split_items(line: str) -> str:
    head, *items = re.split(r" (?=\{Name )", line)
    return "\r\n".join(f"{head} {item}" for item in items)


_BOTH = "ut2004", "udk"
# Kinds of lines, dialects and change of each fault.
_TEXT_FAULTS: dict[str, tuple[str, Collection[str], Callable[[str], str]]] = {
    "no line": ("", _BOTH, lambda line: ""),
    "LF": ("", _BOTH, lambda line: f"{line}\n"),
    "above 4095 bytes": ("", _BOTH, lambda line: f"{line.rstrip()} {{Padding {'x' * 4096}}}"),
    "two blanks": ("", _BOTH, lambda line: line.replace("} {", "}  {")),
    "no blank": ("", ("ut2004",), lambda line: line.replace("} {", "}{")),
    "blanks in vectors": ("", _BOTH, lambda line: re.sub(r"(?<=\d),(?=-?\d)", ", ", line)),
    "comma decimals": ("", _BOTH, lambda line: re.sub(r"(?<=\d)\.(?=\d)", ",", line)),
    "exponents": ("", _BOTH, lambda line: re.sub(r"(?<=\d\.)(\d+)(?=[,}])", r"\1e0", line)),
    "decimals": ("STA", _BOTH, lambda line: re.sub(r"(?<= )(-?\d+)(?=\})", r"\1.0", line)),
    "another order": ("", _BOTH, lambda line: re.sub(r" (\{.*?\}) (\{.*\})", r" \2 \1", line)),
    "other keys": ("", _BOTH, lambda line: re.sub(r"\{(?!Type |Name )(\w)", r"{Other\1", line)),
    "false": ("", _BOTH, lambda line: re.sub("True|False", lambda x: x[0].lower(), line)),
    "a block for each pair": (
        "SEN|GEO",
        ("ut2004",),
        lambda line: re.sub(r"(?<=[\w.]) (?=(Range|Tick|Location) )", "} {", line),
    ),
    "a line for each sensor": ("SEN (Sonar|Encoder)", ("ut2004",), _split_items),
    "a camera's reading": (
        "STA",
        ("ut2004",),
        lambda x: f"{x}\r\nSEN {{Time 1.0}} {{Type Camera}}",
    ),
}


def _make_field(kind: str, path: str) -> NumericField:
    key, _, index = path.partition(".")
    quantity = next(
        (one for one, names in _QUANTITIES.items() if re.fullmatch(names, path)),
        next((one for one, names in _QUANTITIES.items() if re.fullmatch(names, key)), None),
    )
    neighbour = f"{key}.{(int(index) + 1) % 3}" if index else _NEIGHBOURS.get(key, "")
    faults = MEASURED if kind.partition(" ")[0] in ("SEN", "STA", "MISSTA", "ASTA") else CONSTANT
    if _UNMEASURED.fullmatch(f"{kind} {path}"):
        faults = _IMPLAUSIBLE
    if not neighbour and key not in _LISTED:
        faults = tuple(fault for fault in faults if fault is not Fault.EXCHANGED)
    return NumericField(kind, path, quantity or Quantity.LENGTH, neighbour, faults)


# Numbers that no other statement of a server repeats and no motion shows: only what makes them
# implausible can be noticed. MISSTA prints the torque of a link at rest, 0.
_UNMEASURED = re.compile(
    r"CONF \w+ (Mass|MaxTorque|MinRange|Diameter|BeamAngle|beamAngle|maxAngle\w*|\w+Cone\w*)|"
    r"CONF (RFID|VictSensor) \w+|CONF MisPkg Max\w+|CONF Camera Error\w+|"
    r"GEO GroundVehicle (Dimensions.\d|WheelBase)|GEO (?!Sonar|GroundVehicle).* Location.\d|"
    r"GEO Sonar Location.2|GEO MisPkg Orientation.\d|\w+ Torque|SEN GPS Satellites|STA \w+Flipper"
)
_IMPLAUSIBLE = (Fault.LARGER_UNIT_NUMBER, Fault.TEN_TIMES, Fault.ABSENT)
_LISTED = ("Range", "Tick", "Link", "Vel", "Pos")


def _place_numbers(line: str) -> list[_PlacedNumber]:
    """All numbers of a line with their paths, in order."""
    geodetic = [
        _PlacedNumber(
            line[: found.start()].rpartition("{")[2].strip(),
            (int(found[1]) + float(found[2]) / 60.0) * (-1.0 if found[4] in "SW" else 1.0),
            *found.span(),
            found[0],
        )
        for found in _GEODETIC.finditer(line)
    ]
    placed = [one for found in _VALUE.finditer(line) for one in _place_value(line, found)]
    return sorted([*placed, *geodetic], key=lambda one: one.start)


def _place_value(line: str, value: re.Match[str]) -> Iterator[_PlacedNumber]:
    before = line[: value.start()].rstrip().rpartition("{")[2].split(" ")
    # `Robot2 x,y,z roll,pitch,yaw`: the words behind the name have no keys.
    is_start_pose = line.startswith("NFO {StartPoses") and "," in value[0]
    key = ("Location", "Orientation")["," in before[-1]] if is_start_pose else before[-1]
    if key in _NAMES:
        return
    numbers = list(_NUMBER.finditer(value[0]))
    for i, number in enumerate(numbers):
        is_component = 1 < len(numbers) <= _MAX_COMPONENTS
        yield _PlacedNumber(
            f"{key}.{i}" if is_component else key,
            float(number[0]),
            value.start() + number.start(),
            value.start() + number.end(),
            number[0],
        )


def _numbers_of(places: Iterable[_PlacedNumber]) -> Numbers:
    by_path = sorted(places, key=lambda one: one.path)
    return {
        path: tuple(one.value for one in sorted(group, key=lambda one: one.start))
        for path, group in groupby(by_path, key=lambda one: one.path)
    }


def _write_numbers(line: str, places: list[_PlacedNumber], numbers: Numbers) -> str:
    """Line with other numbers, as many decimals as before; those without numbers are removed."""
    values = {path: iter(values) for path, values in numbers.items()}
    texts = [
        _format_like(one.text, next(values[one.path])) if one.path in values else None
        for one in places
    ]
    for one, text in reversed(list(zip(places, texts, strict=True))):
        line = line[: one.start] + (text or "\0") + line[one.end :]
    # A block or pair whose value is gone, or the component of a vector.
    line = re.sub(r" ?\{[^ {}]+ \0(,\0)*\}| [^ {}]+ \0(,\0)*(?=[ }])", "", line)
    return re.sub(r"\0,|,?\0", "", line)


def _format_like(text: str, value: float) -> str:
    if text[-1].isdigit() and value == float(text):
        return text
    if text[-1] in "NSEW":
        sides = "NS" if text[-1] in "NS" else "EW"
        decimals = len(text.rpartition(",")[0].partition(".")[2])
        degrees, minutes = divmod(abs(value) * 60.0, 60.0)
        return f"{int(degrees)},{minutes:.{decimals}f},{sides[value < 0.0]}"
    return f"{value:.{len(text.partition('e')[0].partition('.')[2])}f}"
