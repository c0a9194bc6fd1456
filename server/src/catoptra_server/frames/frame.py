"""A rendered frame and its payloads, each encoded once for all connections."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.encode import encode_payload
from catoptra_server.frames.frame_request import IMAGE_PORT, Channel, FrameMetadata
from catoptra_server.render.renderer import Image


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
    # A frozen frame with a cache: payloads follow from the image alone.
    _payloads: dict[ImageType | ImageEncoding, bytes] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def encode(self, encoding: ImageType | ImageEncoding) -> bytes:
        """Payload of the frame; encoded on first use, by one of several concurrent threads."""
        # The stream's JPEG has the quality of type GOOD: both transports share one payload.
        encoding = ImageType.GOOD if encoding is ImageEncoding.JPEG else encoding
        # Under the lock: a second thread waits for the payload instead of encoding it, too.
        with self._lock:
            if encoding not in self._payloads:
                self._payloads[encoding] = encode_payload(self.rgb, encoding)
            return self._payloads[encoding]
