"""Templates of calibration files: one description of a format's fields that reads and writes them.

A template is a nested mapping as of the file itself. Its leaves are

* `"$fx"`: a number by its canonical name, see `calibrated_camera`; a 1 x 1 matrix reads as one;
* `"[xi fx fy cx cy]"`: a list of them, `"3x3[...]"` as a matrix of the format. It reads from flat
  and nested lists and from matrices alike. A number in it must be there; `-` negates, a last `*`
  takes all that is left;
* other texts: words by which the format is recognised, `|` between equals, `null` for none;
* `?` after a name or a word: readers do without, writers have what is known; `!` in front of a
  leaf, numbers, truth values and objects of them: demanded by the format's reader alone, ignored
  here;
* `"@mask?"`: a text, by its name among the numbers.

Keys have equals by `|`, too; `a/b` is a field of an object, as each of its equals may be; a dotted
key reads from nested objects, and the other way round. The key `cam0`, and a list of one item,
stand for all cameras of a file.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import Any

from catoptra_protocol.calibration.files import OCAM_LINES, as_number, format_number
from catoptra_protocol.slotted_dataclass import dataclass

Numbers = dict[str, Any]
"""Numbers of a camera by their canonical names: floats, and polynomials as tuples of floats."""

_MAX_NUMBERS = 4096
# Objects of a file in which a template is looked for: of rigs, and of nerfstudio's frames.
_MAX_OBJECTS = 1024
_LIST = re.compile(r"(?:(\d+)x(\d+))?\[(.*)\]")
_PLAIN_WORD = re.compile(r"[A-Za-z/][\w/.-]*")
_YAML_WORDS = ("yes", "no", "on", "off", "true", "false", "null", "y", "n")


@dataclass(frozen=True, slots=True)
class Mismatch:
    """Difference of a file from a template."""

    key: str
    """Path in the file."""
    expected: str
    value: str = "missing"
    is_wrong_format: bool = True
    """Whether a field or word is missing, and not a number wrong."""


@dataclass(slots=True)
class Match:
    """A template compared with an object of a file."""

    path: str = ""
    """Path of the camera."""
    numbers: Numbers = field(default_factory=dict)
    faults: list[Mismatch] = field(default_factory=list)
    num_found: int = 0
    num_words: int = 0
    cameras: list[str] = field(default_factory=list)
    """Names of the cameras, of a template with several."""

    @property
    def share_found(self) -> float:
        """Of the fields that the template needs."""
        return self.num_found / max(self.num_found + len(self.faults), 1)


def iter_objects(document: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Objects of a document with their paths, outer ones first, at most 1024."""
    waiting: list[tuple[str, Any]] = []
    if isinstance(document, (dict, list)):
        waiting.append(("", document))
    for _ in range(_MAX_OBJECTS):
        if not waiting:
            return
        path, node = waiting.pop(0)
        if isinstance(node, dict):
            yield path, node
        children = node.items() if isinstance(node, dict) else enumerate(node)
        waiting += [
            (_join(path, key), child)
            for key, child in children
            if isinstance(child, (dict, list)) and len(waiting) < _MAX_OBJECTS
        ]


def keys_of(node: Mapping[str, Any]) -> set[str]:
    """Keys of an object or a template and of objects in it, with equals, dotted ones in part."""
    objects = (node, *(child for child in node.values() if isinstance(child, dict)))
    keys = (key for each in objects for key in each if isinstance(key, str))
    names = {name for key in keys for name in key.split("|")}
    return names | {name.split(".")[0].split("/")[0] for name in names}


def fields_for_readers(template: Any) -> Any:
    """A template without what is for writers alone."""
    if isinstance(template, dict):
        kept = {key: each for key, each in template.items() if not _is_for_writers(each)}
        return {key: fields_for_readers(each) for key, each in kept.items()}
    return [fields_for_readers(template[0])] if isinstance(template, list) else template


def match(template: Mapping[str, Any], node: Mapping[str, Any], path: str, camera: str) -> Match:
    """A template compared with an object.

    Args:
        template: The template, of `fields_for_readers`.
        node: The object.
        path: Path of the object in the file.
        camera: Name of the camera, in a file with several; empty for the first.
    """
    found = Match(path)
    _match(template, node, path, camera, found)
    return found


def _join(path: str, key: object) -> str:
    if isinstance(key, int):
        return f"{path}[{key}]"
    return f"{path}.{key}" if path else str(key)


def _is_for_writers(template: Any) -> bool:
    if isinstance(template, Mapping):
        return all(map(_is_for_writers, template.values()))
    if isinstance(template, list):
        return all(map(_is_for_writers, template))
    return not isinstance(template, str) or template.startswith("!")


def _is_optional(template: Any) -> bool:
    if isinstance(template, Mapping):
        return all(map(_is_optional, template.values()))
    return isinstance(template, str) and template.endswith("?")


def _match(template: Any, node: Any, path: str, camera: str, found: Match) -> None:
    if isinstance(template, Mapping):
        if not isinstance(node, Mapping):
            found.faults.append(Mismatch(path, "an object with fields", repr(node)))
        elif "cam0" in template:
            objects = {key: each for key, each in node.items() if isinstance(each, Mapping)}
            _match_camera(template["cam0"], objects, path, camera, found)
        else:
            for key, each in template.items():
                _match_field(key, each, node, path, camera, found)
    elif isinstance(template, list):
        items = dict(enumerate(node)) if isinstance(node, list) else {}
        _match_camera(template[0], items, path, camera, found)
    elif template.startswith("$"):
        _match_numbers([template.strip("$?")], node, path, found)
    elif listed := _LIST.fullmatch(template):
        _match_numbers(listed[3].split(), node, path, found)
    elif template.startswith("@"):
        found.numbers[template.strip("@?")] = str(node)
    else:
        words = template.removesuffix("?").split("|")
        if ("null" if node is None else str(node)).lower() in map(str.lower, words):
            found.num_found += 1
            found.num_words += 1
        else:
            found.faults.append(Mismatch(path, " or ".join(words), str(node)))


def _match_camera(
    template: Any, items: Mapping[Any, Any], path: str, camera: str, found: Match
) -> None:
    """The same of one of several cameras, of objects or of numbers."""
    if not items:
        found.faults.append(Mismatch(_join(path, "cam0"), "a camera"))
        return
    names = {key if isinstance(key, str) else f"cam{key}": key for key in items}
    found.cameras = found.cameras or list(names)
    key = names.get(camera, next(iter(items)))
    if isinstance(template, Mapping):
        found.path = _join(path, key)
    _match(template, items[key], _join(path, key), camera, found)


def _match_field(
    key: str, template: Any, node: Mapping[str, Any], path: str, camera: str, found: Match
) -> None:
    for name in key.split("|"):
        value = _look_up(node, name)
        if value is not _MISSING and not (value is None and _is_optional(template)):
            _match(template, value, _join(path, name), camera, found)
            return
    if not _is_optional(template):
        found.faults.append(Mismatch(_join(path, key.split("|")[0]), _describe(template)))


_MISSING = object()


def _look_up(node: Mapping[str, Any], name: str) -> Any:
    """Field of an object; dotted names and nested objects stand for each other."""
    if name in node:
        return node[name]
    first, dot, rest = name.partition("/" if "/" in name else ".")
    if dot and isinstance(node.get(first), Mapping):
        return _look_up(node[first], rest)
    prefix = f"{name}."
    parts = {key[len(prefix) :]: value for key, value in node.items() if _begins(key, prefix)}
    return parts or _MISSING


def _begins(key: object, prefix: str) -> bool:
    return isinstance(key, str) and key.startswith(prefix)


def _describe(template: Any) -> str:
    if isinstance(template, str) and not template.startswith("$"):
        return template.rstrip("?").replace("|", " or ")
    return "a number" if isinstance(template, str) else "an object with fields"


def _flatten(value: Any) -> list[Any] | None:
    """Numbers of nested lists or of a matrix, at most 4096; None for more."""
    if isinstance(value, Mapping):
        value = value.get("data", value)
    if not isinstance(value, list):
        return [value]
    flat: list[Any] = []
    for row in value:
        flat += row if isinstance(row, list) else [row]
        if len(flat) > _MAX_NUMBERS:
            return None
    return flat


def _match_numbers(tokens: list[str], node: Any, path: str, found: Match) -> None:
    """Numbers of a field by the tokens of a list."""
    flat = _flatten(node)
    numbers = None if flat is None else [as_number(value) for value in flat]
    rest = tokens[-1].lstrip("-") if tokens and tokens[-1].endswith("*") else ""
    fixed = tokens[:-1] if rest else tokens
    least = sum(not token.endswith("?") for token in fixed)

    def reject() -> None:
        expected = f"finite numbers {' '.join(tokens)}"
        if len(tokens) == 1:
            expected = "a finite number" if as_number(tokens[0]) is None else tokens[0]
        found.faults.append(Mismatch(path, expected, repr(node), is_wrong_format=False))

    if (
        numbers is None
        or None in numbers
        or not least <= len(numbers) <= (_MAX_NUMBERS if rest else len(fixed))
    ):
        reject()
        return
    values = [number for number in numbers if number is not None]
    for token, value in zip(fixed, values, strict=False):
        constant = as_number(token.rstrip("?"))
        if constant is None:
            found.numbers[token.strip("-?")] = -value if token[0] == "-" else value
        elif constant != value:
            reject()
    if rest:
        sign = -1.0 if tokens[-1][0] == "-" else 1.0
        found.numbers[rest.rstrip("*")] = tuple(sign * value for value in values[len(fixed) :])
    found.num_found += 1


def names_in(template: Any) -> set[str]:
    """Names of the numbers that a template has, without signs."""
    if isinstance(template, Mapping):
        return {name for each in template.values() for name in names_in(each)}
    if isinstance(template, list):
        return {name for each in template for name in names_in(each)}
    if not isinstance(template, str):
        return set()
    listed = _LIST.fullmatch(template.removeprefix("!"))
    tokens = listed[3].split() if listed else [template] if "$" in template[:2] else []
    return {token.strip("!$-?*") for token in tokens if as_number(token.rstrip("?")) is None}


def describe_fields(template: Any) -> str:
    """Fields of a template of `fields_for_readers` in a line."""
    if isinstance(template, Mapping):
        return "; ".join(
            f"{key.split('|')[0]} {described}".strip()
            for key, each in template.items()
            if (described := describe_fields(each))
        )
    if isinstance(template, list):
        return describe_fields(template[0])
    return str(template).replace("|", " or ").replace("$", "").replace("@", "")


def write_document(template: Mapping[str, Any], values: Mapping[str, Any], notation: str) -> str:
    """Text of a file.

    Args:
        template: The template.
        values: Numbers and texts by name; a list for a name with `*`.
        notation: One of json, yaml, opencv (YAML with its head and matrices) and lines.
    """
    if notation == "json":
        return json.dumps(_nest_matrices(_fill(template, values)), indent=2) + "\n"
    if notation == "lines":
        return "\n".join(_iter_lines(template, values)) + "\n"
    head = ["%YAML:1.0", "---"] if notation == "opencv" else []
    lines = _iter_yaml(_fill(template, values), "", notation == "opencv")
    return "\n".join((*head, *lines, ""))


class _Matrix(dict[str, Any]):
    """A matrix, which OpenCV tags."""


def _nest_matrices(filled: Any) -> Any:
    """The same with matrices as lists of rows."""
    if isinstance(filled, _Matrix) and "dt" in filled:
        cols = filled["cols"]
        return [filled["data"][row * cols :][:cols] for row in range(filled["rows"])]
    if isinstance(filled, Mapping):
        return {key: _nest_matrices(value) for key, value in filled.items()}
    return filled


def _fill(template: Any, values: Mapping[str, Any]) -> Any:
    """A template with values: mappings, lists, matrices, numbers and words."""
    if isinstance(template, Mapping):
        filled: dict[str, Any] = {}
        for key, each in template.items():
            *path, name = key.split("|")[0].split("/")
            inner = filled
            for part in path:
                inner = inner.setdefault(part, {})
            if (value := _fill(each, values)) is not None:
                inner[name] = value
        return _Matrix(filled) if "data" in filled else filled
    if isinstance(template, list):
        return [_fill(each, values) for each in template]
    if not isinstance(template, str):
        return template
    name = template.strip("!$@?")
    if template.lstrip("!")[0] in "$@":
        if name.isdigit():
            return float(name)
        return values.get(name) if template.endswith("?") else values[name]
    template = template.removeprefix("!").removesuffix("?")
    listed = _LIST.fullmatch(template)
    if listed is None:
        return template.split("|")[0]
    numbers: list[Any] = []
    for token in listed[3].split():
        name = token.strip("-?*")
        value = float(name) if as_number(name) is not None else values[name]
        several = list(value) if isinstance(value, tuple) else [value]
        numbers += [-each for each in several] if token[0] == "-" and name in values else several
    if listed[1] is None:
        return numbers
    rows, cols = int(listed[1]), int(listed[2])
    return _Matrix(rows=rows, cols=cols, dt="d", data=numbers)


def _iter_lines(template: Mapping[str, Any], values: Mapping[str, Any]) -> Iterator[str]:
    """Lines of numbers: OCamCalib's with a comment before each, COLMAP's with its number."""
    if "cameras" in template:
        camera = _fill(template["cameras"][0], values)
        yield " ".join(("1", camera["model"], *map(_format, camera["parameters"])))
        return
    for key in OCAM_LINES:
        yield f"# {key}: {describe_fields(template[key])}"
        yield " ".join(map(_format, _fill(template[key], values)))


def _iter_yaml(node: Mapping[str, Any], indent: str, is_opencv: bool) -> Iterator[str]:
    for key, value in node.items():
        if isinstance(value, Mapping):
            is_matrix = isinstance(value, _Matrix)
            yield f"{indent}{key}:" + (" !!opencv-matrix" if is_opencv and is_matrix else "")
            plain = is_matrix and not is_opencv
            inner = {name: one for name, one in value.items() if not (plain and name == "dt")}
            yield from _iter_yaml(inner, indent + "   ", is_opencv)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield f"{indent}{key}:"
            first, *rest = _iter_yaml(value[0], indent + "     ", is_opencv)
            yield from (f"{indent}   - {first.strip()}", *rest)
        else:
            yield f"{indent}{key}: {_format(value)}"


def _format(value: Any) -> str:
    """A number, word, truth value or list of them, as all readers of YAML take it."""
    if isinstance(value, list):
        return "[" + ", ".join(map(_format, value)) + "]"
    if isinstance(value, float):
        return format_number(value) if math.isfinite(value) else ".inf"
    if isinstance(value, str) and _PLAIN_WORD.fullmatch(value):
        return json.dumps(value) if value.lower() in _YAML_WORDS else value
    return json.dumps(value)
