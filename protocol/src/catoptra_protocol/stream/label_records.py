"""Labels in a frame's header: the channels behind the image, and the objects in view."""

from __future__ import annotations

from enum import Enum

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.transform import Transform
from catoptra_protocol.vectors import Vector3


class ChannelEncoding(Enum):
    """Encoding of a channel's part: rows of little-endian values, or these compressed by zlib."""

    RAW = "raw"
    ZLIB = "zlib"


@dataclass(frozen=True, slots=True)
class ChannelRecord:
    """One channel; the records are in the order of the parts."""

    name: str
    dtype: str
    """Type of a value as NumPy writes it, such as `<f4`."""
    depth: int
    """Values of a pixel."""
    encoding: ChannelEncoding
    num_bytes: int
    """Length of the part."""


@dataclass(frozen=True, slots=True)
class ObjectRecord:
    """One object in view, with its box at the exposure."""

    number: int
    """Value of the channel `ids`."""
    name: str
    class_name: str
    class_number: int
    """Value of the channel `classes`."""
    world_from_box: Transform
    """Pose of the box's centre."""
    half_size_m: Vector3
    """Half lengths of the edges."""


@dataclass(frozen=True, slots=True)
class LabelsRecord:
    """Labels of a frame, of the exact camera model whatever the plan of the picture."""

    channels: tuple[ChannelRecord, ...]
    objects: tuple[ObjectRecord, ...] = ()
    """Objects in view by ascending number, with the channel `ids`; the first 1000 of them."""
    times: str = "middle"
    """`middle`: all pixels at the middle of the exposure, `time_s`; `rows`: each row of a rolling
    shutter at the middle of its own."""
    is_displaced: bool = False
    """Whether the labels are of a displaced capture camera, as the picture is (Misalignment)."""
    flow_to_time_s: float | None = None
    """Time of the frame that the flow leads to, the last one of this channel; None without."""
