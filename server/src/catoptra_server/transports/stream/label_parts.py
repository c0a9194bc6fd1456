"""Labels of a frame as parts of a message, and their record in the header."""

from __future__ import annotations

from catoptra_protocol.labels.channels import LABEL_CHANNELS, LabelledObject
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    ChannelRecord,
    LabelsRecord,
    ObjectRecord,
)
from catoptra_server.frames.encode import Payload
from catoptra_server.frames.frame import FrameLabels
from catoptra_server.transports.stream.server_info import transform_from_pose

# A record has 300 bytes and more; a header, with all else, at most MAX_REPLY_BYTES.
MAX_OBJECT_RECORDS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class EncodedLabels:
    """Labels, ready to be sent."""

    record: LabelsRecord | None = None
    """None for a frame without labels."""
    parts: tuple[Payload, ...] = ()
    """Channels in the order of the record."""


async def encode_labels(labels: FrameLabels | None, encoding: ChannelEncoding) -> EncodedLabels:
    """Encode the labels of a frame, once for all clients."""
    if labels is None:
        return EncodedLabels()
    parts = await labels.encode(encoding)
    channels = tuple(
        ChannelRecord(
            name, LABEL_CHANNELS[name].dtype, LABEL_CHANNELS[name].depth, encoding, len(part)
        )
        for name, part in parts.items()
    )
    objects = labels.objects_in_view()[:MAX_OBJECT_RECORDS]
    record = LabelsRecord(
        channels,
        tuple(_record_from_object(one) for one in objects),
        "rows" if labels.has_row_times else "middle",
        labels.is_displaced,
        labels.flow_to_time_s,
    )
    return EncodedLabels(record, tuple(parts.values()))


def _record_from_object(labelled: LabelledObject) -> ObjectRecord:
    x, y, z = labelled.half_size_m.tolist()
    return ObjectRecord(
        labelled.number,
        labelled.name[:_MAX_NAME_CHARS],
        labelled.class_name[:_MAX_NAME_CHARS],
        labelled.class_number,
        transform_from_pose(labelled.world_from_box),
        (x, y, z),
    )


# Names come from world files and, with their nodes, from mesh files.
_MAX_NAME_CHARS = 120
