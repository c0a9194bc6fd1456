"""Frozen dataclasses as maps of plain values, and these maps as msgpack.

The only module that imports msgpack. A message is a map of field names to values, checked against
the types of its dataclass, the same for msgpack and JSON: unknown fields are ignored, a missing or
wrong one is an error with its name; a field with a default may be missing, since peers of an
earlier release do not send it. Sizes are limited before memory is allocated; no extension types, no
object hooks. Which messages there are is in `requests` and `replies`. Source: spec.md of msgpack.
"""

from __future__ import annotations

import dataclasses
import math
import types
from collections.abc import Callable, Mapping
from enum import Enum
from functools import cache
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import msgpack

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError

# Integers of 63 bits: languages without unsigned integers can hold any id.
_MAX_INT = 2**63 - 1
_MAX_QUOTED_CHARS = 80  # of a wrong value or a reason in an error text

FieldMap = Mapping[str, Any]  # Any: every value of msgpack or JSON, before its check
_FieldReader = Callable[[Any, str], Any]
_T = TypeVar("_T")


def fields_from_message(kind: str, message: Any) -> dict[str, Any]:
    """Map of a dataclass, its kind first; for nested values see `plain_value`.

    Raises:
        LocalProtocolError: A number of the message is not finite.
    """
    return {"kind": kind, **_fields_from_dataclass(message)}


def plain_value(value: Any) -> Any:
    """Convert an enum member or a nested dataclass, which encoders cannot encode themselves.

    Raises:
        LocalProtocolError: A number of the dataclass is not finite.
    """
    if isinstance(value, Enum):
        return value.value
    return _fields_from_dataclass(value)


def dataclass_from_fields(dataclass_type: type[_T], fields: FieldMap, path: str = "") -> _T:
    """Build a dataclass from a map, with a check of every field.

    Args:
        dataclass_type: Class with fields of the types in `_reader_for_type`.
        fields: Map as a decoder returned it.
        path: Position of the map inside the message, for error texts.

    Raises:
        RemoteProtocolError: A field is missing or has another type; names the field.
    """
    values = {}
    key: Any = dataclass_type  # hashable, which type[T] does not promise to the caches below
    for name, reader in _field_readers(key).items():
        if name in fields:
            values[name] = reader(fields[name], f"{path}.{name}" if path else name)
        elif name not in _optional_fields(key):
            owner = path or dataclass_type.__name__
            raise RemoteProtocolError(f"{owner} without the field {name!r}")
    return dataclass_type(**values)


def read_str_field(fields: FieldMap, name: str) -> str:
    """Text field of a map whose dataclass is not known yet.

    Raises:
        RemoteProtocolError: The field is missing or not a str.
    """
    return _read_str(_require_field(fields, name), name)


def read_int_field(fields: FieldMap, name: str) -> int:
    """Integer field of a map whose dataclass is not known yet.

    Raises:
        RemoteProtocolError: The field is missing or not an int.
    """
    return _read_int(_require_field(fields, name), name)


def _field_error(path: str, value: Any, expected: str) -> RemoteProtocolError:
    """Error of a value at a position of a message, the value shortened."""
    return RemoteProtocolError(f"{path}: {repr(value)[:_MAX_QUOTED_CHARS]}: expected {expected}")


def _require_field(fields: FieldMap, name: str) -> Any:
    if name not in fields:
        raise RemoteProtocolError(f"a message without the field {name!r}")
    return fields[name]


# Resolved once per class: get_type_hints evaluates every annotation, which would cost more than
# decoding the message.
@cache
def _field_readers(dataclass_type: Any) -> dict[str, _FieldReader]:
    """Reader of each field of a dataclass, by name."""
    hints = get_type_hints(dataclass_type)
    return {
        field.name: _reader_for_type(hints[field.name])
        for field in dataclasses.fields(dataclass_type)
    }


@cache
def _optional_fields(dataclass_type: Any) -> frozenset[str]:
    """Names of the fields with a default, which peers of an earlier release do not send."""
    fields = dataclasses.fields(dataclass_type)
    return frozenset(f.name for f in fields if f.default is not dataclasses.MISSING)


def _reader_for_type(hint: Any) -> _FieldReader:
    """Reader of a value of a type: scalars, X | None, tuples, dicts, enums, dataclasses."""
    origin, parts = get_origin(hint), get_args(hint)
    if hint in _SCALAR_READERS:
        return _SCALAR_READERS[hint]
    if origin is types.UnionType:
        return _optional_reader(_reader_for_type(parts[0]))
    if origin is tuple:
        length = None if parts[1] is Ellipsis else len(parts)
        return _list_reader(_reader_for_type(parts[0]), length)
    if origin is dict:
        return _map_reader(_reader_for_type(parts[1]))
    if issubclass(hint, Enum):
        return _enum_reader(hint)
    nested: type[Any] = hint
    assert dataclasses.is_dataclass(nested), f"no reader for fields of type {nested}"
    return lambda value, path: dataclass_from_fields(nested, _read_map(value, path), path)


def _optional_reader(reader: _FieldReader) -> _FieldReader:
    return lambda value, path: None if value is None else reader(value, path)


def _list_reader(reader: _FieldReader, length: int | None) -> _FieldReader:
    def items(value: Any, path: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or length not in (None, len(value)):
            raise _field_error(path, value, "a list" if length is None else f"a list of {length}")
        return tuple(reader(item, f"{path}[{index}]") for index, item in enumerate(value))

    return items


def _map_reader(reader: _FieldReader) -> _FieldReader:
    def entries(value: Any, path: str) -> dict[str, Any]:
        fields = _read_map(value, path)
        return {key: reader(entry, f"{path}.{key}") for key, entry in fields.items()}

    return entries


def _enum_reader(enum: type[Enum]) -> _FieldReader:
    def member(value: Any, path: str) -> Enum:
        # Not enum(value): a decoded value may be unhashable.
        for candidate in enum:
            if candidate.value == value:
                return candidate
        raise _field_error(path, value, "one of " + ", ".join(str(one.value) for one in enum))

    return member


def _read_map(value: Any, path: str) -> FieldMap:
    if not (isinstance(value, dict) and all(isinstance(key, str) for key in value)):
        raise _field_error(path, value, "a map of field names")
    return value


def _read_float(value: Any, path: str) -> float:
    # bool is a subclass of int in Python and must not pass for a number. An integer does:
    # dynamic languages send 1.0 as 1.
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _field_error(path, value, "a finite number")
    return float(value)


def _read_int(value: Any, path: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > _MAX_INT:
        raise _field_error(path, value, "an int of 63 bits")
    return value


def _read_str(value: Any, path: str) -> str:
    if not isinstance(value, str):
        raise _field_error(path, value, "a str")
    return value


def _read_bool(value: Any, path: str) -> bool:
    if not isinstance(value, bool):
        raise _field_error(path, value, "a bool")
    return value


_SCALAR_READERS: dict[Any, _FieldReader] = {
    float: _read_float,
    int: _read_int,
    str: _read_str,
    bool: _read_bool,
}


def _fields_from_dataclass(message: Any) -> dict[str, Any]:
    key: Any = type(message)  # hashable, which type[Any] does not promise to the cache below
    fields = {name: getattr(message, name) for name in _field_names(key)}
    # Readers reject NaN and infinity, so sending one would only move the failure to the peer.
    for name, value in fields.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise LocalProtocolError(f"{type(message).__name__}.{name} is not finite: {value}")
    return fields


# Once per class: dataclasses.fields checks and copies its list at each call.
@cache
def _field_names(dataclass_type: Any) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(dataclass_type))


# The largest reply lists landmarks: a thousand of 300 bytes each fit.
MAX_REPLY_BYTES = 512 * 1024
# Entries of a list, fields of a map: as many as the landmarks above, and the widest header twice.
_MAX_ITEMS = 2048
_MAX_FIELDS = 128


def pack(kind: str, message: Any) -> bytes:
    """Encode a dataclass as a msgpack map, its kind first.

    Raises:
        LocalProtocolError: A number of the message is not finite.
    """
    return pack_fields(fields_from_message(kind, message))


def pack_fields(fields: FieldMap) -> bytes:
    """Encode the map of a message."""
    data: bytes = msgpack.packb(fields, default=plain_value)
    return data


def unpack(data: bytes, max_bytes: int) -> FieldMap:
    """Decode the msgpack map of a message, its values unchecked.

    Raises:
        RemoteProtocolError: The bytes are too many, or not exactly one map.
    """
    if len(data) > max_bytes:
        raise RemoteProtocolError(f"a message of {len(data)} bytes: at most {max_bytes} are read")
    # Limits for each container: msgpack allocates an array from its announced length alone.
    try:
        fields = msgpack.unpackb(
            data,
            max_str_len=max_bytes,
            max_bin_len=0,
            max_ext_len=0,
            max_array_len=_MAX_ITEMS,
            max_map_len=_MAX_FIELDS,
        )
    except (ValueError, msgpack.UnpackException) as error:
        # Some of msgpack's exceptions have no text, the nesting limit among them.
        reason = str(error) or type(error).__name__
        raise RemoteProtocolError(
            f"no msgpack that is accepted here: {reason[:_MAX_QUOTED_CHARS]}"
        ) from error
    if not isinstance(fields, dict):
        raise _field_error("the message", fields, "a map of field names")
    return fields
