"""Text of calibration files: JSON and YAML as objects, and their fields by path.

Errors name file, field and expectation. JSON has no duplicate names and no NaN. YAML is OpenCV's:
its head `%YAML:1.0`, which no YAML reader takes, and its tags of matrices; read by PyYAML's safe
loader (the extra `calibration`), without aliases, since a page of them can stand for gigabytes.
PyYAML is imported with the first YAML file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from catoptra_protocol.errors import ConfigError, RemoteProtocolError, SourceLocation
from catoptra_protocol.json_object import json_object_from_text
from catoptra_protocol.limits import MAX_IMAGE_SIDE_PX
from catoptra_protocol.slotted_dataclass import dataclass

MAX_BYTES = 2**20
"""Largest calibration file that is read: published ones have some kilobytes."""


def file_error(
    file: str, key: str, expected: str, *, value: str = "", line: int = 0
) -> ConfigError:
    """Error of a calibration file."""
    return ConfigError(SourceLocation(file, line), key=key, value=value, expected=expected)


def parse_json(text: str, file: str) -> dict[str, Any]:
    """The object of a file.

    Raises:
        ConfigError: No JSON object, NaN, a name twice, or nested too deeply.
    """
    try:
        return json_object_from_text(text, MAX_BYTES)
    except RemoteProtocolError as error:
        raise file_error(file, "JSON", f"an object: {error}") from error


_OPENCV_HEAD = re.compile(r"\A%YAML[:\s]\s*1\.[0-2]\s*\n")
_MATRIX_TAG = "tag:yaml.org,2002:opencv-matrix"


def parse_yaml(text: str, file: str) -> Any:
    """The document of a file.

    Raises:
        ConfigError: No YAML, an alias, a tag of code, or PyYAML is not installed.
    """
    try:
        import yaml
    except ImportError as error:
        expected = "the package PyYAML: pip install 'catoptra-protocol[calibration]'"
        raise file_error(file, "YAML", expected) from error

    class MatrixLoader(yaml.SafeLoader):
        """Safe loader without aliases, with OpenCV's matrices."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            """Reject an alias before it is resolved."""
            if self.check_event(yaml.AliasEvent):
                event = self.peek_event()  # type: ignore[no-untyped-call]
                raise yaml.MarkedYAMLError(problem="aliases", problem_mark=event.start_mark)
            return super().compose_node(parent, index)

    MatrixLoader.add_constructor(_MATRIX_TAG, _construct_matrix)
    try:
        return yaml.load(_OPENCV_HEAD.sub("", text), Loader=MatrixLoader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark is not None else 0
        problem = getattr(error, "problem", None) or type(error).__name__
        raise file_error(file, "YAML", "plain YAML", value=str(problem), line=line) from error


def _construct_matrix(loader: Any, node: Any) -> Any:
    """Fields of an opencv-matrix."""
    return loader.construct_mapping(node, True)


def format_number(value: float) -> str:
    """A double with a decimal point, as readers of calibration files want it.

    `180` is no focal length for Kalibr and BoofCV, and `1e-05` is a text for YAML 1.1.
    """
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}{e}{exponent}"


def format_numbers(values: tuple[float, ...]) -> str:
    """A YAML list of doubles."""
    return "[" + ", ".join(map(format_number, values)) + "]"


_MAX_NUMBERS = 4096
# Names in an error: of rigs with as many cameras as are built.
_MAX_LISTED = 16


@dataclass(frozen=True, slots=True)
class Fields:
    """An object of a file, or of an object in it."""

    file: str
    """Path of the file as the user gave it."""
    values: Mapping[str, Any]
    path: str = ""
    """Path of this object in the file; empty for the whole file."""

    def make_error(self, name: str, expected: str) -> ConfigError:
        """Error about a field, whether it is there or not."""
        value = repr(self.values[name]) if name in self.values else "missing"
        return file_error(self.file, self._path_of(name), expected, value=value)

    def has(self, name: str) -> bool:
        """Whether a field is there."""
        return name in self.values

    def get_number(self, name: str, default: float | None = None) -> float:
        """A finite number; a missing one without a default is an error."""
        if default is not None and name not in self.values:
            return default
        number = _as_number(self.values.get(name))
        if number is None:
            raise self.make_error(name, "a finite number")
        return number

    def get_positive(self, name: str) -> float:
        """A finite number above 0."""
        number = self.get_number(name)
        if number <= 0.0:
            raise self.make_error(name, "a number above 0")
        return number

    def get_side_px(self, name: str) -> int:
        """Pixels along an image's side."""
        return self._side_px(name, self.get_number(name))

    def get_size_px(self, name: str) -> tuple[int, int]:
        """Width and height in one field."""
        width, height = self.get_numbers(name, 2)
        return self._side_px(name, width), self._side_px(name, height)

    def _side_px(self, name: str, number: float) -> int:
        if not (number.is_integer() and 1 <= number <= MAX_IMAGE_SIDE_PX):
            raise self.make_error(name, f"whole numbers of pixels, 1 to {MAX_IMAGE_SIDE_PX}")
        return int(number)

    def get_numbers(self, name: str, count: int | None = None) -> tuple[float, ...]:
        """A list of finite numbers, of a given length or of any up to 4096."""
        expected = f"a list of {count if count is not None else ''} finite numbers".replace(
            "  ", " "
        )
        values = self.values.get(name)
        if not isinstance(values, Sequence) or isinstance(values, (str, bytes)):
            raise self.make_error(name, expected)
        if len(values) > _MAX_NUMBERS or (count is not None and len(values) != count):
            raise self.make_error(name, expected)
        numbers = [_as_number(value) for value in values]
        if any(number is None for number in numbers):
            raise self.make_error(name, expected)
        return tuple(number for number in numbers if number is not None)

    def get_text(self, name: str, default: str | None = None) -> str:
        """A text."""
        if default is not None and name not in self.values:
            return default
        value = self.values.get(name)
        if not isinstance(value, str):
            raise self.make_error(name, "a text")
        return value

    def get_choice(self, name: str, allowed: Sequence[str], default: str | None = None) -> str:
        """One of some words."""
        text = self.get_text(name, default)
        if text not in allowed:
            raise self.make_error(name, "one of " + ", ".join(allowed))
        return text

    def get_child(self, name: str) -> Fields:
        """An object in this one."""
        value = self.values.get(name)
        if not isinstance(value, Mapping):
            raise self.make_error(name, "an object with fields")
        return Fields(self.file, value, self._path_of(name))

    def check_camera(self, name: str, cameras: Sequence[str]) -> None:
        """Reject the name of a camera that the file has not; the error has the first of its own."""
        if name not in cameras:
            listed = ", ".join(map(str, cameras[:_MAX_LISTED])) or "none"
            raise self.make_error(name, f"a camera of this file, which has {listed}")

    def get_item(self, name: str, index: int) -> Fields:
        """An object of a list in this one."""
        value = self.values.get(name)
        if not isinstance(value, list) or len(value) <= index:
            raise self.make_error(name, f"a list with at least {index + 1} objects")
        if not isinstance(value[index], Mapping):
            raise self.make_error(name, "a list of objects with fields")
        return Fields(self.file, value[index], f"{self._path_of(name)}[{index}]")

    def _path_of(self, name: str) -> str:
        return f"{self.path}.{name}" if self.path else name


def _as_number(value: object) -> float | None:
    """A finite number of a file; None for anything else, booleans and 1x1 matrices excluded."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    # An int of a thousand digits is no float.
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
