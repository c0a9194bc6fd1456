"""Labels of one frame, and their payloads, each encoded once for all connections."""

from __future__ import annotations

import asyncio
import zlib
from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np

from catoptra_protocol.labels.channels import Channels, GroundTruth, LabelledObject
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.requests import ChannelEncoding
from catoptra_server.frames.encode import Payload

# Level 1: ranges shrink to 60 % and ids to 1 % of their bytes; higher levels take twice the time
# for a few per cent.
_ZLIB_LEVEL = 1


@dataclass(frozen=True, slots=True, eq=False)
class FrameLabels:
    """Labels of the picture of one camera."""

    truth: GroundTruth
    has_row_times: bool = False
    """Whether each row of pixels has a time of its own."""
    is_displaced: bool = False
    """Whether the labels are of a displaced capture camera."""
    flow_to_time_s: float | None = None
    """Time of the frame that the flow leads to."""
    # A frozen record with a cache: payloads follow from the channels alone.
    _encoded: dict[ChannelEncoding, Mapping[str, Payload]] = field(default_factory=dict)

    def turn(self) -> FrameLabels:
        """Labels of the picture turned round left to right."""
        turned = {
            name: np.ascontiguousarray(values[:, ::-1])
            for name, values in self.truth.channels.items()
        }
        if "flow" in turned:
            turned["flow"][..., 0] *= -1.0
        return replace(self, truth=replace(self.truth, channels=turned), _encoded={})

    def objects_in_view(self) -> tuple[LabelledObject, ...]:
        """Objects whose numbers the channel `ids` has; none without that channel."""
        ids = self.truth.channels.get("ids")
        if ids is None:
            return ()
        present = np.bincount(ids.reshape(-1), minlength=2**16) > 0
        return tuple(one for one in self.truth.objects if present[one.number])

    async def encode(self, encoding: ChannelEncoding) -> Mapping[str, Payload]:
        """Parts of all channels by name, encoded once for all clients; on the event loop."""
        if encoding not in self._encoded:
            channels = self.truth.channels
            self._encoded[encoding] = (
                {name: values.data.cast("B") for name, values in channels.items()}
                if encoding is ChannelEncoding.RAW
                else await asyncio.to_thread(_compress, channels)
            )
        return self._encoded[encoding]


def _compress(channels: Channels) -> Mapping[str, Payload]:
    return {
        name: zlib.compress(values.data.cast("B"), _ZLIB_LEVEL) for name, values in channels.items()
    }
