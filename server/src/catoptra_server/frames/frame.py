"""A rendered frame and its payloads, each encoded once for all connections."""

from __future__ import annotations

import asyncio
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.encode import (
    Payload,
    encode_without_blocking,
    is_quick,
    payload_of_reply,
)
from catoptra_server.frames.frame_labels import FrameLabels
from catoptra_server.frames.frame_request import IMAGE_PORT, Channel, FrameMetadata
from catoptra_server.frames.image_difference import ImageDifference
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.render.renderer import Image

_Encoding = ImageType | ImageEncoding


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A rendered image of a channel, and the measurements of its rendering."""

    sequence: int
    """Number of the frame within the channel, from 1."""
    time_s: float
    """Simulation time of the exposure."""
    rgb: Image
    """(h, w, 3) uint8, read-only."""
    exposed_at_s: float
    """Time of the exposure on the server's monotonic clock."""
    finished_at_s: float
    """End of the rendering on the server's monotonic clock."""
    channel: Channel = IMAGE_PORT
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    stage_ms: dict[str, float] = field(default_factory=dict)
    """Duration of each rendering stage, summed over all views."""
    render_duration_s: float = 0.0
    plan: str | None = None
    """Plans of all views in words; None for a black frame."""
    error_bound_px: float | None = None
    """Upper bound on the displacement of any outline; None where unknown."""
    error_bounds: dict[str, float] | None = None
    """All error bounds and their parts by name; None where unknown."""
    effect_decisions: tuple[EffectDecision, ...] = ()
    """Decisions about the effects of the camera, in a frame of one camera."""
    choice: PlanChoice | None = None
    """Choice of the plan, in a frame of one omnidirectional camera."""
    difference: ImageDifference | None = None
    """Set where the right half of the image shows a difference from a reference."""
    labels: FrameLabels | None = None
    """Labels of the picture, where the channel has any."""
    # A frozen frame with caches: encodings follow from the image alone.
    _encoded: dict[_Encoding, Payload] = field(default_factory=dict)
    _running: dict[_Encoding, asyncio.Task[Payload]] = field(default_factory=dict)

    async def encode(self, encoding: _Encoding) -> Payload:
        """Image as by `encode.encode_image`, encoded once for all clients; on the event loop."""
        # The stream's JPEG has the quality of type GOOD: both transports share one payload.
        if encoding is ImageEncoding.JPEG:
            return payload_of_reply(await self.encode(ImageType.GOOD))
        encoded = self._encoded.get(encoding)
        if encoded is None:
            encoded = self._encoded[encoding] = await self._encode_once(encoding)
        return encoded

    async def _encode_once(self, encoding: _Encoding) -> Payload:
        if is_quick(self.rgb, encoding):
            # Ends without a pause: the next client finds the payload.
            return await encode_without_blocking(self.rgb, encoding)
        if encoding not in self._running:
            encode = encode_without_blocking(self.rgb, encoding)
            self._running[encoding] = asyncio.create_task(encode)
        # Shielded: several connections wait for one thread, and any of them may disconnect.
        return await asyncio.shield(self._running[encoding])
