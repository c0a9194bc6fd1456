"""ROS 2 messages of what the stream delivers: topics, frames, stamps and values as ROS has them.

The one place where SAE becomes REP-103, and where mirror frames become optical frames:

| frame                  | ours, SAE               | here, REP-103                               |
|------------------------|-------------------------|---------------------------------------------|
| `map`                  | world: y right, z down  | x the same, y left, z up                    |
| `odom`                 | pose of spawning        | the same pose                               |
| `base_link`            | robot: y right, z down  | x forward, y left, z up                     |
| `<camera>_optical`     | mirror: z the axis      | x right, y down in a flipped picture, z axis |

tf is the tree map -> odom -> base_link -> cameras. odom -> base_link is the newest odometry, and
map -> odom what is left to the true pose, so that map -> base_link is true at each stamp. Pixel
centres are integers in a CameraInfo, +0.5 in our models. Simulated time is both the stamp and the
log time. Values that are unknown are stated so: covariances by -1, models without a ROS name by K
of zeros.

Definitions and their hashes are those of ROS 2 Jazzy, in `ros_definitions.msg`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any, TypeAlias

import numpy as np

from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import NoteRecord
from catoptra_protocol.usarsim.readings import (
    GroundTruthReading,
    InsReading,
    OdometryReading,
    RangeScanReading,
    SonarReadings,
)
from catoptra_protocol.usarsim.reports import Report

MAP, ODOM, BASE_LINK = "map", "odom", "base_link"
LATCHED = ("/tf_static", "/landmarks", "/calibration")
"""Ends of topics that are sent once, for whoever subscribes later."""

_Fields: TypeAlias = dict[str, Any]
_FLIP = np.diag([1.0, -1.0, -1.0])
# Columns: right, down and forward in the flipped picture of an omnidirectional camera, in its
# mirror frame, whose +x is the top of the picture; and of a pinhole, whose x is the axis.
_MIRROR_FROM_OPTICAL = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_PINHOLE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_UNKNOWN_9, _UNKNOWN_36 = [-1.0, *[0.0] * 8], [-1.0, *[0.0] * 35]
# Rows of x, y, yaw in a covariance of x, y, z, roll, pitch, yaw.
_PLANAR_ROWS = (0, 1, 5)
_MAX_STAMP_S = 2**31 - 1


@dataclass(frozen=True, slots=True)
class RosMessage:
    """One message of a topic."""

    topic: str
    type: str
    """Such as `sensor_msgs/msg/Image`."""
    time_ns: int
    """Simulated time."""
    fields: Mapping[str, Any]


def read_definitions() -> dict[str, tuple[str, str]]:
    """Text of each message type with all that it contains, and its RIHS01 hash."""
    path = resources.files("catoptra_client") / "recording" / "ros_definitions.msg"
    definitions = {}
    for block in path.read_text(encoding="utf-8").split("### ")[1:]:
        head, _, text = block.partition("\n")
        name, _, type_hash = head.partition(" ")
        definitions[name] = text, type_hash
    return definitions


def ns_from_time(time_s: float) -> int:
    """Nanoseconds of a simulated time.

    Raises:
        CatoptraError: No stamp has this time, such as one that is not finite.
    """
    if not 0.0 <= time_s <= _MAX_STAMP_S:
        raise CatoptraError(f"{time_s!r} s is no time of a ROS stamp")
    return round(time_s * 1e9)


def rep103_from_sae(pose: Pose) -> Pose:
    """Pose of a REP-103 frame in another, of the pose between the two SAE frames."""
    return Pose(_FLIP @ pose.rotation @ _FLIP, _FLIP @ pose.translation)


def base_link_from_optical(
    robot_from_mirror: Pose, camera: OmniCamera | PerspectiveCamera | None
) -> Pose:
    """Pose of a camera's optical frame on `base_link`."""
    is_omni = isinstance(camera, OmniCamera)
    axes = _MIRROR_FROM_OPTICAL if is_omni else _PINHOLE_FROM_OPTICAL
    rotation = _FLIP @ robot_from_mirror.rotation @ axes
    return Pose(rotation, _FLIP @ robot_from_mirror.translation)


def topic_name(name: str) -> str:
    """Name of a camera or sensor as a part of topics and frames."""
    text = "".join(c if c.isascii() and c.isalnum() else "_" for c in name.lower())
    return text if text[:1].isalpha() else f"x{text}"


def clock(time_s: float) -> RosMessage:
    """Simulated time."""
    ns = ns_from_time(time_s)
    return RosMessage("/clock", "rosgraph_msgs/msg/Clock", ns, {"clock": _stamp(ns)})


def text(topic: str, time_s: float, content: object) -> RosMessage:
    """A string, or anything else as JSON."""
    data = content if isinstance(content, str) else json.dumps(content)
    return RosMessage(topic, "std_msgs/msg/String", ns_from_time(time_s), {"data": data})


def robot_transforms(time_s: float, world_from_robot: Pose, odom_from_robot: Pose) -> RosMessage:
    """map -> odom -> base_link, whose product is the true pose.

    Args:
        time_s: Simulated time.
        world_from_robot: True pose, SAE.
        odom_from_robot: Pose by odometry, relative to the pose of spawning, SAE.
    """
    correction = world_from_robot @ odom_from_robot.inverse()
    frames = (MAP, ODOM, correction), (ODOM, BASE_LINK, odom_from_robot)
    return _transforms("/tf", time_s, frames, convert=rep103_from_sae)


def static_transforms(time_s: float, cameras: Mapping[str, Pose]) -> RosMessage:
    """base_link -> optical frames, of poses by `base_link_from_optical`."""
    frames = [(BASE_LINK, name, pose) for name, pose in cameras.items()]
    return _transforms("/tf_static", time_s, frames, convert=lambda pose: pose)


def compressed_image(topic: str, time_s: float, frame: str, format_: str, data: bytes
    ) -> RosMessage:  # fmt: skip
    """An image file; the format is `jpeg` or `png`."""
    ns = ns_from_time(time_s)
    fields = {"header": _header(ns, frame), "format": format_, "data": data}
    return RosMessage(topic, "sensor_msgs/msg/CompressedImage", ns, fields)


def channel_image(topic: str, time_s: float, frame: str, values: Any) -> RosMessage:
    """A channel of ground truth, (h, w): range as 32FC1 with 0 for nothing, ids as 16UC1."""
    ns = ns_from_time(time_s)
    if values.dtype.kind == "f":
        values, encoding = np.where(np.isfinite(values), values, 0.0).astype("<f4"), "32FC1"
    else:
        values, encoding = values.astype("<u2"), "16UC1"
    height, width = values.shape
    fields = {
        "header": _header(ns, frame),
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": width * values.itemsize,
        "data": values.tobytes(),
    }
    return RosMessage(topic, "sensor_msgs/msg/Image", ns, fields)


def camera_info(topic: str, time_s: float, frame: str, size_px: tuple[int, int],
    focal_length_px: float | None) -> RosMessage:  # fmt: skip
    """CameraInfo of an exact pinhole; K of zeros, uncalibrated, where ROS has no model."""
    ns = ns_from_time(time_s)
    width, height = size_px
    k, r, p, model, d = [0.0] * 9, [0.0] * 9, [0.0] * 12, "", list[float]()
    if focal_length_px is not None:
        f, cx, cy = focal_length_px, 0.5 * width - 0.5, 0.5 * height - 0.5
        k = [f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0]
        r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        p = [f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
        model, d = "plumb_bob", [0.0] * 5
    roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    fields = {
        "header": _header(ns, frame),
        "height": height,
        "width": width,
        "distortion_model": model,
        **{"d": d, "k": k, "r": r, "p": p},
        **{"binning_x": 0, "binning_y": 0, "roi": roi},
    }
    return RosMessage(topic, "sensor_msgs/msg/CameraInfo", ns, fields)


def odometry(topic: str, time_s: float, frame: str, pose: Pose,
    planar_covariance: Sequence[float] | None = None) -> RosMessage:  # fmt: skip
    """Odometry of an SAE pose; the covariance has 9 numbers of x, y, yaw, SAE."""
    ns = ns_from_time(time_s)
    covariance = list(_UNKNOWN_36)
    if planar_covariance is not None:
        matrix = np.zeros((6, 6))
        matrix[np.ix_(_PLANAR_ROWS, _PLANAR_ROWS)] = (
            _FLIP @ np.reshape(planar_covariance, (3, 3)) @ _FLIP
        )
        covariance = matrix.ravel().tolist()
    fields = {
        "header": _header(ns, frame),
        "child_frame_id": BASE_LINK,
        "pose": {"pose": _pose(rep103_from_sae(pose)), "covariance": covariance},
        "twist": {"twist": {"linear": _xyz(np.zeros(3)), "angular": _xyz(np.zeros(3))},
            "covariance": list(_UNKNOWN_36)},
    }  # fmt: skip
    return RosMessage(topic, "nav_msgs/msg/Odometry", ns, fields)


def landmark_markers(time_s: float, landmarks: Sequence[Landmark]) -> RosMessage:
    """Band centres of the true landmarks, the world's floor at z = 0, heights upwards."""
    ns = ns_from_time(time_s)
    zero = {"sec": 0, "nanosec": 0}
    markers = []
    for number, one in enumerate(landmarks):
        centre = np.array([one.x_m, -one.y_m, one.band_centre_m])
        height = one.band_top_m - one.band_bottom_m
        size = np.array([one.width_m, one.width_m, height])
        marker = {
            "header": _header(ns, MAP),
            "ns": one.name,
            "id": number,
            "type": 3 if one.kind == "beacon" else 1,
            "action": 0,
            "pose": _pose(Pose(np.eye(3), centre)),
            "scale": _xyz(size),
            "color": {"r": 1.0, "g": 1.0, "b": 0.0, "a": 1.0},
            "lifetime": zero,
            **{"frame_locked": False, "points": [], "colors": [], "texture_resource": ""},
            "texture": {"header": _header(ns, ""), "format": "", "data": b""},
            **{"uv_coordinates": [], "text": one.name, "mesh_resource": ""},
            "mesh_file": {"filename": "", "data": b""},
            "mesh_use_embedded_materials": False,
        }
        markers.append(marker)
    return RosMessage("/landmarks", "visualization_msgs/msg/MarkerArray", ns, {"markers": markers})


def messages_from_report(report: Report, time_s: float, max_range_m: float) -> Iterator[RosMessage]:
    """Messages of a report that ROS has a type for; others have none.

    Args:
        report: The report.
        time_s: Time where the report has none.
        max_range_m: Range from which on a scanner has met nothing.
    """
    match report:
        case RangeScanReading():
            yield _laser_scan(report, max_range_m)
        case SonarReadings():
            for name, range_m in report.items:
                yield _sonar_range(report.time_s, name, range_m)
        case OdometryReading():
            pose = pose_from_odometry(report)
            yield odometry("/odom", _first(report.time_s, time_s), ODOM, pose)
        case InsReading():
            yield _imu(report, _first(report.time_s, time_s))
        case GroundTruthReading():
            pose = Pose.from_rpy(report.location_m, report.rotation_rad)
            yield odometry("/ground_truth/reading", report.time_s, MAP, pose)


def odometry_from_note(note: NoteRecord) -> RosMessage | None:
    """Belief of a filter that a note states; None for a note without a pose."""
    try:
        content = json.loads(note.text)
        x, y, yaw = map(float, content["pose"])
        covariance = content.get("covariance")
        covariance = None if covariance is None else np.ravel(covariance).astype(float).tolist()
        if not all(map(math.isfinite, (x, y, yaw, *(covariance or ())))):
            return None
        pose = Pose.from_rpy((x, y, 0.0), (0.0, 0.0, yaw))
        return odometry(f"/filter/{topic_name(note.name)}", note.time_s, MAP, pose, covariance)
    # Notes have no meaning to the server: any JSON may come.
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


def pose_from_odometry(reading: OdometryReading) -> Pose:
    """Pose relative to that of spawning, SAE."""
    return Pose.from_rpy((reading.x_m, reading.y_m, 0.0), (0.0, 0.0, reading.yaw_rad))


def _laser_scan(scan: RangeScanReading, max_range_m: float) -> RosMessage:
    ns = ns_from_time(scan.time_s)
    if not scan.ranges_m or len(scan.ranges_m) > 1_000_000:
        raise RemoteProtocolError(f"a scan of {len(scan.ranges_m)} ranges")
    # The wire rounds to 2 decimals at least, so the largest range may be that much off.
    ranges = [r if r < max_range_m - 0.005 else math.inf for r in scan.ranges_m]
    fields = {
        "header": _header(ns, BASE_LINK),
        # The first range is on the right in both; only the sign of the angle differs.
        "angle_min": -0.5 * scan.fov_rad,
        "angle_max": 0.5 * scan.fov_rad,
        "angle_increment": scan.fov_rad / max(len(ranges) - 1, 1),
        **{"time_increment": 0.0, "scan_time": 0.0, "range_min": 0.0, "range_max": max_range_m},
        **{"ranges": ranges, "intensities": []},
    }
    return RosMessage(f"/scan/{topic_name(scan.name)}", "sensor_msgs/msg/LaserScan", ns, fields)


def _sonar_range(time_s: float, name: str, range_m: float) -> RosMessage:
    ns = ns_from_time(time_s)
    fields = {
        "header": _header(ns, BASE_LINK),
        **{"radiation_type": 0, "field_of_view": 0.0, "min_range": 0.0, "max_range": math.inf},
        **{"range": range_m, "variance": 0.0},
    }
    return RosMessage(f"/sonar/{topic_name(name)}", "sensor_msgs/msg/Range", ns, fields)


def _imu(reading: InsReading, time_s: float) -> RosMessage:
    ns = ns_from_time(time_s)
    pose = rep103_from_sae(Pose.from_rpy(reading.location_m, reading.rotation_rad))
    fields = {
        "header": _header(ns, BASE_LINK),
        "orientation": _quaternion(pose),
        # An INS delivers no rates: -1 in the first covariance says that there are none.
        "orientation_covariance": [0.0] * 9,
        "angular_velocity": _xyz(np.zeros(3)),
        "angular_velocity_covariance": _UNKNOWN_9,
        "linear_acceleration": _xyz(np.zeros(3)),
        "linear_acceleration_covariance": _UNKNOWN_9,
    }
    return RosMessage(f"/imu/{topic_name(reading.name)}", "sensor_msgs/msg/Imu", ns, fields)


def _first(time_s: float | None, otherwise_s: float) -> float:
    return otherwise_s if time_s is None else time_s


def _transforms(
    topic: str,
    time_s: float,
    frames: Sequence[tuple[str, str, Pose]],
    convert: Callable[[Pose], Pose],
) -> RosMessage:
    ns = ns_from_time(time_s)
    transforms = []
    for parent, child, pose in frames:
        turned = convert(pose)
        transform = {"translation": _xyz(turned.translation), "rotation": _quaternion(turned)}
        header = _header(ns, parent)
        transforms.append({"header": header, "child_frame_id": child, "transform": transform})
    return RosMessage(topic, "tf2_msgs/msg/TFMessage", ns, {"transforms": transforms})


def _stamp(ns: int) -> _Fields:
    return dict(zip(("sec", "nanosec"), divmod(ns, 10**9), strict=True))


def _header(ns: int, frame: str) -> _Fields:
    return {"stamp": _stamp(ns), "frame_id": frame}


def _xyz(values: Floats) -> _Fields:
    return dict(zip("xyz", map(float, values), strict=True))


def _quaternion(pose: Pose) -> _Fields:
    return dict(zip("xyzw", map(float, pose.quaternion), strict=True))


def _pose(pose: Pose) -> _Fields:
    return {"position": _xyz(pose.translation), "orientation": _quaternion(pose)}
