"""Text of calibration files as nested objects: JSON, YAML, OpenCV's XML, lines of numbers.

JSON has no duplicate names and no NaN. YAML is OpenCV's: its head `%YAML:1.0`, which no YAML reader
takes, and its tags of matrices; read by PyYAML's safe loader (the extra `calibration`), without
aliases, since a page of them can stand for gigabytes. For the same reason XML has no declarations
of its own. PyYAML is imported with the first YAML file.
"""

from __future__ import annotations

import math
import re
import struct
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from catoptra_protocol.errors import ConfigError, RemoteProtocolError, SourceLocation
from catoptra_protocol.json_object import json_object_from_text
from catoptra_protocol.optics.numerics import Bools

MAX_BYTES = 2**20
"""Largest calibration file that is read: published ones have some kilobytes."""
MAX_XML_DEPTH = 16
_MAX_MASK_BYTES, _MAX_MASK_PX = 2**24, 2**26
_PNG = b"\x89PNG\r\n\x1a\n"
OCAM_LINES = ("polynomial", "inverse", "centre", "affine", "size")
"""Names of the lines of numbers of OCamCalib's file, in their order."""


def file_error(
    file: str, key: str, expected: str, *, value: str = "", line: int = 0
) -> ConfigError:
    """Error of a calibration file."""
    return ConfigError(SourceLocation(file, line), key=key, value=value, expected=expected)


def parse_document(text: str, file: str) -> Any:
    """Nested mappings, lists, numbers and words of a file in any of the notations.

    Raises:
        ConfigError: The notation that the file begins in is broken.
    """
    start = text.lstrip()[:1]
    if start == "{":
        return parse_json(text, file)
    if start == "<":
        return _parse_xml(text, file)
    return _parse_lines(text) or parse_yaml(text, file)


def as_number(value: object) -> float | None:
    """A finite number, or a word that is one to programs (`1e-05` is a text in YAML 1.1)."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        number = float(value)
    except (OverflowError, ValueError):  # an int of a thousand digits is no float
        return None
    return number if math.isfinite(number) else None


def _parse_lines(text: str) -> dict[str, Any] | None:
    """Lines of OCamCalib's five kinds, or of COLMAP's cameras; None for other texts."""
    lines = [line.split() for line in text.splitlines() if line.strip()[:1] not in ("", "#")]
    if len(lines) == len(OCAM_LINES) and all(
        as_number(word) is not None for line in lines for word in line
    ):
        return dict(zip(OCAM_LINES, lines, strict=True))
    if lines and all(len(line) > 4 and line[0].isdigit() and line[1].isupper() for line in lines):
        return {"cameras": [{"model": line[1], "parameters": line[2:]} for line in lines]}
    return None


def _parse_xml(text: str, file: str) -> Any:
    """The document of OpenCV's FileStorage."""
    try:
        if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):
            raise ValueError("a declaration")
        root = ElementTree.fromstring(text)
        return _value_of(root, MAX_XML_DEPTH)
    except (ElementTree.ParseError, ValueError) as error:
        raise file_error(file, "XML", "plain XML", value=str(error)) from error


def _value_of(element: ElementTree.Element, depth: int) -> Any:
    if depth == 0:
        raise ValueError("elements that are nested too deeply")
    if len(element) > 0:
        return {child.tag: _value_of(child, depth - 1) for child in element}
    words = (element.text or "").split()
    numeric = len(words) > 1 and all(as_number(word) is not None for word in words)
    return words if numeric else " ".join(words)


def parse_json(text: str, file: str) -> dict[str, Any]:
    """The object of a file.

    Raises:
        ConfigError: No JSON object, NaN, a name twice, or nested too deeply.
    """
    try:
        return json_object_from_text(text, MAX_BYTES)
    except RemoteProtocolError as error:
        raise file_error(file, "JSON", f"an object: {error}") from error


_OPENCV_HEAD = re.compile(r"\A%YAML[:\s]\s*1\.[0-2][^\n]*(\n|\Z)")
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


def read_mask(file: str, name: str, size_px: tuple[int, int]) -> Bools:
    """Pixels (height, width) that a mask beside a file shows: those that are not black.

    Raises:
        ConfigError: No such picture, no PNG, of another size, or OpenCV is not installed.
    """
    path = Path(file).parent / name
    where = partial(file_error, file, "mask")
    try:
        if not path.is_file() or path.stat().st_size > _MAX_MASK_BYTES:
            expected = f"a picture beside the file of at most {_MAX_MASK_BYTES} bytes, or no mask"
            raise where(expected, value=name)
        data = path.read_bytes()
    except OSError as error:
        raise where(f"a readable picture: {error.strerror}", value=name) from error
    # Its size before its pixels: a small file may unpack to gigabytes.
    head = data[16:24] if data.startswith(_PNG) else b""
    stated = struct.unpack(">II", head) if len(head) == 8 else None
    if stated != size_px or stated[0] * stated[1] > _MAX_MASK_PX:
        found = "no PNG" if stated is None else "{} x {} px".format(*stated)
        expected = "a PNG of {} x {} px, as the camera's, {} in all at most"
        raise where(expected.format(*size_px, _MAX_MASK_PX), value=found)
    try:
        import cv2
    except ImportError as error:
        raise where("the package OpenCV: pip install opencv-python-headless") from error
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if picture is None or picture.shape != size_px[::-1]:
        raise where("a PNG that can be read", value=name)
    shown: Bools = picture > 0
    return shown
