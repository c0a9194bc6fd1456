"""A finished picture, what is known of it, and its payloads: encoded once for all who ask."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.encode import encode_payload, encode_png
from catoptra_server.frames.frame_request import IMAGE_PORT, Channel, FrameMetadata
from catoptra_server.render.renderer import Image


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A finished picture of a channel.

    rgb: (h, w, 3) uint8, read-only. time_s: simulation time of the exposure. exposed_at_s, finished_s:
    on the server's monotonic clock. drawn_s: seconds that it took to draw. plan: how it was drawn.
    error_bound_px: how far off an outline in it may be at most; bound: that and its parts by name.
    Both None where unknown. effects: what was decided about each that is named, of one camera's
    picture.
    """

    sequence: int
    time_s: float
    rgb: Image
    exposed_at_s: float
    finished_at_s: float
    channel: Channel = IMAGE_PORT
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    stage_ms: dict[str, float] = field(default_factory=dict)
    render_duration_s: float = 0.0
    plan: str | None = None
    error_bound_px: float | None = None
    error_bounds: dict[str, float] | None = None
    effect_decisions: tuple[EffectDecision, ...] = ()
    _payloads: dict[ImageType | ImageEncoding, bytes] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def encode(self, encoding: ImageType | ImageEncoding) -> bytes:
        """Return the whole picture's payload; encoded once, also when threads ask at once.

        A JPEG of the stream is one of type GOOD: viewers of both transports share it.
        """
        encoding = ImageType.GOOD if encoding is ImageEncoding.JPEG else encoding
        with self._lock:
            if encoding not in self._payloads:
                self._payloads[encoding] = _encode(self.rgb, encoding)
            return self._payloads[encoding]


def _encode(rgb: Image, encoding: ImageType | ImageEncoding) -> bytes:
    if isinstance(encoding, ImageType):
        return encode_payload(rgb, encoding)
    return rgb.tobytes() if encoding is ImageEncoding.RAW else encode_png(rgb)
