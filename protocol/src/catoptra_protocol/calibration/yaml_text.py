"""YAML of calibration files, with OpenCV's head and tags.

OpenCV writes `%YAML:1.0`, which no YAML reader takes, and tags its matrices. Read by PyYAML's safe
loader (the extra `calibration`), without aliases: a page of them can stand for gigabytes.
"""

from __future__ import annotations

import re
from typing import Any

from catoptra_protocol.errors import ConfigError, SourceLocation

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
        raise ConfigError(
            SourceLocation(file),
            key="YAML",
            value="",
            expected="the package PyYAML: pip install 'catoptra-protocol[calibration]'",
        ) from error

    class Loader(yaml.SafeLoader):
        """Safe loader without aliases, with OpenCV's matrices."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            """Reject an alias before it is resolved."""
            if self.check_event(yaml.AliasEvent):
                event = self.peek_event()  # type: ignore[no-untyped-call]
                raise yaml.MarkedYAMLError(problem="aliases", problem_mark=event.start_mark)
            return super().compose_node(parent, index)

    Loader.add_constructor(_MATRIX_TAG, _construct_matrix)
    try:
        return yaml.load(_OPENCV_HEAD.sub("", text), Loader=Loader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark is not None else 0
        problem = getattr(error, "problem", None) or type(error).__name__
        raise ConfigError(
            SourceLocation(file, line), key="YAML", value=str(problem), expected="plain YAML"
        ) from error


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
