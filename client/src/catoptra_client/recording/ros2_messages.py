"""ROS 2 messages of what the stream delivers, as dictionaries, and the definitions of their types.

The one place where SAE frames become those of REP 103. Robot and world: x forward, y left, z up, so
that y and z change their signs. An optical frame has x to the right of the flipped picture, y down
and z along the optical axis.

ROS has no model of a mirror or of most lenses: CameraInfo of such a camera has K = 0, which means
uncalibrated, and the calibration as JSON has the model.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from catoptra_protocol.calibration.exports import ExportedFile, export_camera
from catoptra_protocol.calibration.formats import FORMATS
from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.configurations import CHASSIS_MOUNT
from catoptra_protocol.usarsim.grammar import Message
from catoptra_protocol.usarsim.readings import (
    GroundTruthReading,
    InsReading,
    OdometryReading,
    RangeScanReading,
    SonarReadings,
)
from catoptra_protocol.usarsim.reports import Configuration, Geometry, Report

RosMessage = dict[str, Any]

_SEPARATOR = "=" * 80 + "\n"
_FLU_SIGNS = np.array([1.0, -1.0, -1.0])
# Columns: the axes of the optical frame in the frame of the viewpoint.
_MIRROR_FROM_OPTICAL = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_PINHOLE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# REP 103 and sensor_msgs: -1 in the first element says that nothing is known.
_UNKNOWN_3X3 = [-1.0] + [0.0] * 8
_UNKNOWN_6X6 = [-1.0] + [0.0] * 35
_COLOURS = {"cyan": (0.0, 1.0, 1.0), "magenta": (1.0, 0.0, 1.0), "yellow": (1.0, 1.0, 0.0)}


@dataclass(frozen=True, slots=True, eq=False)
class MountedSensor:
    """What CONF and GEO say of a sensor."""

    base_from_sensor: Pose | None = None
    """Between frames of REP 103; None on a part that moves."""
    min_range_m: float = 0.0
    max_range_m: float = math.inf
    """Range that is stated where there is no echo."""
    beam_angle_rad: float = 0.0


Sensors = Mapping[str, MountedSensor]
_UNKNOWN_SENSOR = MountedSensor()


def sensors_by_name(reports: Iterable[Report]) -> dict[str, MountedSensor]:
    """Sensors of the reports of a robot class, as `StreamClient.get_parts` has them."""
    found: dict[str, MountedSensor] = {}
    limits: dict[str, tuple[float, float, float]] = {}
    for report in reports:
        match report:
            case Configuration():
                keys = (("MinRange", "0"), ("MaxRange", "inf"), ("BeamAngle", "0"))
                low, high, angle = (float(report.get(key) or default) for key, default in keys)
                limits[report.get("Name") or ""] = low, high, angle
            case Geometry(_, (item, *_)):
                pose = flu_pose(Pose.from_rpy(item.location_m, item.rotation_rad))
                is_fixed = item.mount == CHASSIS_MOUNT
                found[item.name] = MountedSensor(
                    pose if is_fixed else None, *limits.get(item.name, ())
                )
    return found


@cache
def read_definitions() -> dict[str, str]:
    """Definition of each type, `package/Name`, without those of its parts."""
    text = resources.files(__package__).joinpath("ros2_messages.txt").read_text()
    entries = (entry.partition("\n") for entry in text.split(_SEPARATOR) if entry)
    return {head.removeprefix("MSG: "): body for head, _, body in entries}


@cache
def schema_text(type_name: str) -> str:
    """Definition of a type, `package/Name`, followed by those of all its parts."""
    definitions, found = read_definitions(), [type_name]
    for name in found:
        for line in definitions[name].splitlines():
            part = line.split()[0].partition("[")[0]
            if part in definitions and part not in found:
                found.append(part)
    parts = "".join(f"{_SEPARATOR}MSG: {name}\n{definitions[name]}" for name in found[1:])
    return definitions[type_name] + parts


# Of CDR: format of `struct`, by the type of a field.
_FORMATS = {
    **{"bool": "?", "byte": "B", "char": "B", "float32": "f", "float64": "d", "int8": "b"},
    **{"int16": "h", "int32": "i", "int64": "q", "uint8": "B", "uint16": "H", "uint32": "I"},
    "uint64": "Q",
}


class _Field(NamedTuple):
    """A field of a type: a number, a text, or a message; or an array of these."""

    name: str
    format: str
    """Of a number; empty for the others."""
    parts: tuple[_Field, ...] | None
    """Fields of a message; None for the others."""
    numbers: Callable[[RosMessage], tuple[float, ...]] | None
    """Values of a message whose fields are all numbers of one size; None of others."""
    length: int | None
    """Length of an array; -1 if it is not fixed; None without one."""


@cache
def _fields_of(type_name: str) -> tuple[_Field, ...]:
    fields = []
    for line in read_definitions()[type_name].splitlines():
        kind, *names = line.partition("#")[0].split()[:2] or [""]
        if not names or "=" in line:
            continue  # a constant
        kind, _, size = kind.partition("[")
        length = int(size[:-1] or -1) if size else None
        format_, parts, numbers = _FORMATS.get(kind, ""), None, None
        if kind in read_definitions():
            parts = _fields_of(kind)
            is_flat = all(part.format and part.parts is None is part.length for part in parts)
            if is_flat and len({struct.calcsize(part.format) for part in parts}) == 1 < len(parts):
                format_ = "".join(part.format for part in parts)
                numbers = itemgetter(*(part.name for part in parts))
        fields.append(_Field(names[0], format_, parts, numbers, length))
    return tuple(fields)


def encode_cdr(type_name: str, message: RosMessage) -> bytes:
    """Message as little-endian CDR (XCDR1).

    A third of the time of the package mcap-ros2-support, which looks at each number on its own: a
    scan has 181.
    """
    data = bytearray()
    _encode_fields(_fields_of(type_name), message, data)
    return b"\0\1\0\0" + bytes(data)


def _encode_fields(fields: tuple[_Field, ...], message: RosMessage, data: bytearray) -> None:
    for field in fields:
        value = message[field.name]
        if field.length is None:
            _encode_value(field, value, data)
            continue
        if field.length < 0:
            _encode_numbers("I", (len(value),), data)
        if isinstance(value, bytes):
            data += value
        elif field.format and field.parts is None:
            # Without values there is nothing to align.
            if value:
                _encode_numbers(f"{len(value)}{field.format}", value, data)
        else:
            for one in value:
                _encode_value(field, one, data)


def _encode_value(field: _Field, value: Any, data: bytearray) -> None:
    if field.numbers is not None:
        _encode_numbers(field.format, field.numbers(value), data)
    elif field.parts is not None:
        _encode_fields(field.parts, value, data)
    elif field.format:
        _encode_numbers(field.format, (value,), data)
    else:
        text = value.encode() + b"\0"
        _encode_numbers("I", (len(text),), data)
        data += text


def _encode_numbers(format_: str, values: Sequence[float], data: bytearray) -> None:
    """Append numbers of one size, the first of them aligned to it."""
    size = _find_size(format_[-1])
    data += bytes(-len(data) % size)
    data += struct.pack(f"<{format_}", *values)


@cache
def _find_size(format_: str) -> int:
    return struct.calcsize(f"<{format_}")


def nanoseconds_from_s(time_s: float) -> int:
    """Time of a stamp, rounded to a nanosecond.

    Raises:
        RemoteProtocolError: A time that no stamp has: below 0, not finite, or after 2038.
    """
    if not 0.0 <= time_s < 2.0**31:
        raise RemoteProtocolError(f"a time of {time_s} s has no stamp")
    return round(time_s * 1e9)


def flu_pose(pose: Pose) -> Pose:
    """Pose between frames of REP 103, of one between SAE frames."""
    # Products with matrices of signs alone.
    return Pose(_FLU_SIGNS[:, None] * pose.rotation * _FLU_SIGNS, _FLU_SIGNS * pose.translation)


def optical_pose(robot_from_mirror: Pose, camera: OmniCamera | PerspectiveCamera | None) -> Pose:
    """Pose of the optical frame in the base's frame of REP 103, base_from_optical."""
    is_pinhole = isinstance(camera, PerspectiveCamera)
    mirror_from_optical = _PINHOLE_FROM_OPTICAL if is_pinhole else _MIRROR_FROM_OPTICAL
    rotation = _FLU_SIGNS[:, None] * robot_from_mirror.rotation @ mirror_from_optical
    return Pose(rotation, _FLU_SIGNS * robot_from_mirror.translation)


def wheel_speeds(
    forward_m_s: float, turn_rad_s: float, wheel_radius_m: float, wheel_separation_m: float
) -> tuple[float, float]:
    """Speeds of the left and right wheels, rad/s, of a geometry_msgs/Twist.

    A positive turn is to the left in REP 103, so that the right wheels are the faster ones.
    """
    swing_m_s = 0.5 * turn_rad_s * wheel_separation_m
    return (forward_m_s - swing_m_s) / wheel_radius_m, (forward_m_s + swing_m_s) / wheel_radius_m


def velocity_message(left_m_s: float, right_m_s: float, wheel_separation_m: float) -> RosMessage:
    """geometry_msgs/Twist of the rims of the wheels; a positive turn is to the left."""
    turn_rad_s = (right_m_s - left_m_s) / wheel_separation_m
    forward = np.array([0.5 * (left_m_s + right_m_s), 0.0, 0.0])
    return {"linear": _vector(forward), "angular": _vector(np.array([0.0, 0.0, turn_rad_s]))}


def clock_message(time_s: float) -> RosMessage:
    """rosgraph_msgs/Clock."""
    return {"clock": _stamp(time_s)}


def string_message(value: object) -> RosMessage:
    """std_msgs/String of a text, or of any other value as JSON."""
    text = value if isinstance(value, str) else json.dumps(value, allow_nan=False)
    return {"data": text}


def transform_message(time_s: float, parent: str, child: str, pose: Pose) -> RosMessage:
    """geometry_msgs/TransformStamped of parent_from_child, between frames of REP 103."""
    transform = {
        "translation": _vector(pose.translation),
        "rotation": _quaternion(pose),
    }
    return {"header": _header(time_s, parent), "child_frame_id": child, "transform": transform}


def compressed_image_message(
    time_s: float, frame_id: str, encoding: str, data: bytes
) -> RosMessage:
    """sensor_msgs/CompressedImage of a JPEG or PNG file."""
    return {"header": _header(time_s, frame_id), "format": encoding, "data": data}


def channel_image_message(
    time_s: float, frame_id: str, encoding: str, size_px: tuple[int, int], data: bytes
) -> RosMessage:
    """sensor_msgs/Image of a channel of labels: `32FC1` or `16UC1`, (height, width) pixels.

    A range without a surface is 0, as of depth images of integers (REP 118), not infinite.
    """
    height_px, width_px = size_px
    if encoding == "32FC1":
        ranges = np.frombuffer(data, dtype="<f4")
        data = np.where(np.isfinite(ranges), ranges, np.float32(0.0)).tobytes()
    return {
        "header": _header(time_s, frame_id),
        "height": height_px,
        "width": width_px,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": len(data) // height_px,
        "data": data,
    }


def camera_info_message(
    time_s: float, frame_id: str, camera: OmniCamera | PerspectiveCamera
) -> RosMessage:
    """sensor_msgs/CameraInfo; K = 0 but of a pinhole, whose pixel centres are whole in ROS."""
    k, r, p, model, distortion = [0.0] * 9, [0.0] * 9, [0.0] * 12, "", []
    if isinstance(camera, PerspectiveCamera):
        f, (u, v) = camera.focal_length_px, camera.centre_px
        k = [f, 0.0, u - 0.5, 0.0, f, v - 0.5, 0.0, 0.0, 1.0]
        r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        p = [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]
        model, distortion = "plumb_bob", [0.0] * 5
    return {
        "header": _header(time_s, frame_id),
        "height": camera.height_px,
        "width": camera.width_px,
        "distortion_model": model,
        "d": distortion,
        "k": k,
        "r": r,
        "p": p,
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


def calibration_message(
    name: str, camera: OmniCamera | PerspectiveCamera, pairs: dict[str, str], picture: Picture
) -> RosMessage:
    """std_msgs/String: the pairs of CONF, and each calibration file that describes the camera.

    A model that does not describe it has the reason in place of its file.
    """
    exports: dict[str, dict[str, object]] = {}
    for export in FORMATS if isinstance(camera, OmniCamera) else ():
        assert isinstance(camera, OmniCamera)
        file = export_camera(camera, export, name=name, picture=picture)
        exports[export.name] = (
            {"file": export.file_name, "text": file.text, "residual_px": file.residual.max_px}
            if isinstance(file, ExportedFile)
            else {"refused": file.reason}
        )
    hand = picture.value if isinstance(camera, OmniCamera) else None
    return string_message(
        {"camera": name, "camera_model": pairs, "picture": hand, "exports": exports}
    )


def pose_odometry_message(time_s: float, parent: str, pose: Pose) -> RosMessage:
    """nav_msgs/Odometry of a pose between frames of REP 103, with unknown covariance and speed."""
    unknown = {"linear": _vector(np.zeros(3)), "angular": _vector(np.zeros(3))}
    return {
        "header": _header(time_s, parent),
        "child_frame_id": "base_link",
        "pose": {
            "pose": {"position": _vector(pose.translation), "orientation": _quaternion(pose)},
            "covariance": list(_UNKNOWN_6X6),
        },
        "twist": {"twist": unknown, "covariance": list(_UNKNOWN_6X6)},
    }


def filter_message(time_s: float, note: dict[str, Any]) -> RosMessage | None:
    """nav_msgs/Odometry of a filter's note with a `pose`; None of another note."""
    try:
        x_m, y_m, yaw_rad = map(float, note["pose"])
        rows = np.array(note["covariance"], dtype=np.float64).reshape(3, 3)
    except (KeyError, TypeError, ValueError):
        return None
    # Position and yaw change their signs as the frame does: y and yaw.
    signs, places = np.array([1.0, -1.0, -1.0]), [0, 1, 5]
    covariance = np.zeros((6, 6))
    covariance[np.ix_(places, places)] = rows * np.outer(signs, signs)
    pose = flu_pose(Pose.from_rpy((x_m, y_m, 0.0), (0.0, 0.0, yaw_rad)))
    message = pose_odometry_message(time_s, "map", pose)
    message["pose"]["covariance"] = covariance.ravel().tolist()
    return message


def source_of_message(message: Message) -> str:
    """What distinguishes a sensor's lines from those of others."""
    return f"{message.word} {message.get('Type')} {message.get('Name')}"


def reading_messages(
    reading: object, time_s: float, sensors: Sensors
) -> list[tuple[str, str, RosMessage]]:
    """Topic, type and message of each of a line's readings; none where ROS has no type."""
    match reading:
        case RangeScanReading():
            scan = _scan(reading, sensors.get(reading.name, _UNKNOWN_SENSOR))
            return [(f"/scan/{reading.name}", "sensor_msgs/LaserScan", scan)]
        case SonarReadings():
            return [
                (
                    f"/range/{name}",
                    "sensor_msgs/Range",
                    _range(name, range_m, reading.time_s, sensors.get(name, _UNKNOWN_SENSOR)),
                )
                for name, range_m in reading.items
            ]
        case OdometryReading():
            pose = Pose.from_rpy((reading.x_m, reading.y_m, 0.0), (0.0, 0.0, reading.yaw_rad))
            message = pose_odometry_message(time_s, "odom", flu_pose(pose))
            return [("/odom", "nav_msgs/Odometry", message)]
        case GroundTruthReading():
            pose = Pose.from_rpy(reading.location_m, reading.rotation_rad)
            message = pose_odometry_message(reading.time_s, "map", flu_pose(pose))
            return [(f"/reading/{reading.name}", "nav_msgs/Odometry", message)]
        case InsReading():
            pose = flu_pose(Pose.from_rpy(reading.location_m, reading.rotation_rad))
            return [(f"/imu/{reading.name}", "sensor_msgs/Imu", _imu(time_s, pose))]
    return []


def landmarks_message(landmarks: Sequence[Landmark]) -> RosMessage:
    """visualization_msgs/MarkerArray: one cylinder or box for each of a landmark's two colours."""
    markers: list[RosMessage] = []
    for landmark in landmarks:
        bottom_m, top_m = landmark.band_bottom_m, landmark.band_top_m
        middle_m = landmark.band_centre_m
        halves = (
            (bottom_m, middle_m, landmark.lower_colour),
            (middle_m, top_m, landmark.upper_colour),
        )
        for low_m, high_m, colour in halves:
            centre = np.array([landmark.x_m, -landmark.y_m, 0.5 * (low_m + high_m)])
            markers.append(_marker(len(markers), landmark, centre, high_m - low_m, colour))
    return {"markers": markers}


def _marker(
    number: int, landmark: Landmark, centre_m: Floats, height_m: float, colour: str
) -> RosMessage:
    is_beacon = landmark.kind == "beacon"
    red, green, blue = _COLOURS[colour]
    zero = {"sec": 0, "nanosec": 0}
    size_m = np.array([landmark.width_m, landmark.width_m, height_m])
    return {
        "header": _header(0.0, "map"),
        "ns": landmark.name,
        "id": number,
        "type": 3 if is_beacon else 1,
        "action": 0,
        "pose": {"position": _vector(centre_m), "orientation": _quaternion(Pose.identity())},
        "scale": _vector(size_m),
        "color": {"r": red, "g": green, "b": blue, "a": 1.0},
        "lifetime": zero,
        "frame_locked": False,
        "points": [],
        "colors": [],
        "texture_resource": "",
        "texture": {"header": _header(0.0, ""), "format": "", "data": b""},
        "uv_coordinates": [],
        "text": landmark.name,
        "mesh_resource": "",
        "mesh_file": {"filename": "", "data": b""},
        "mesh_use_embedded_materials": False,
    }


def _range(name: str, range_m: float, time_s: float, sensor: MountedSensor) -> RosMessage:
    return {
        "header": _header(time_s, name),
        "radiation_type": 0,
        "field_of_view": sensor.beam_angle_rad,
        "min_range": sensor.min_range_m,
        "max_range": sensor.max_range_m,
        "range": math.inf if range_m >= sensor.max_range_m else range_m,
        # Of Jazzy and later, whose readers need it; older ones skip what follows the range.
        "variance": 0.0,
    }


def _scan(reading: RangeScanReading, sensor: MountedSensor) -> RosMessage:
    # The first range is on the right, as in ROS; no echo is infinite there.
    max_range_m = sensor.max_range_m
    ranges = [math.inf if one >= max_range_m else one for one in reading.ranges_m]
    return {
        "header": _header(reading.time_s, reading.name),
        "angle_min": -0.5 * reading.fov_rad,
        "angle_max": 0.5 * reading.fov_rad,
        "angle_increment": reading.resolution_rad,
        "time_increment": 0.0,
        "scan_time": 0.0,
        "range_min": sensor.min_range_m,
        "range_max": max_range_m,
        "ranges": ranges,
        "intensities": [],
    }


def _imu(time_s: float, pose: Pose) -> RosMessage:
    return {
        "header": _header(time_s, "base_link"),
        "orientation": _quaternion(pose),
        # Of what is there, unknown is 0; -1 would say that there is no orientation.
        "orientation_covariance": [0.0] * 9,
        "angular_velocity": _vector(np.zeros(3)),
        "angular_velocity_covariance": list(_UNKNOWN_3X3),
        "linear_acceleration": _vector(np.zeros(3)),
        "linear_acceleration_covariance": list(_UNKNOWN_3X3),
    }


def _stamp(time_s: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(nanoseconds_from_s(time_s), 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds}


def _header(time_s: float, frame_id: str) -> RosMessage:
    return {"stamp": _stamp(time_s), "frame_id": frame_id}


def _vector(values: Floats) -> dict[str, float]:
    x, y, z = values.tolist()
    return {"x": x, "y": y, "z": z}


def _quaternion(pose: Pose) -> dict[str, float]:
    x, y, z, w = pose.quaternion.tolist()
    return {"x": x, "y": y, "z": z, "w": w}
