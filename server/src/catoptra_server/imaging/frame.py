"""A finished picture, what is known of it, and its payloads: encoded once for all who ask."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from catoptra_protocol.wire.image import ImageType
from catoptra_protocol.wire.stream_requests import Encoding
from catoptra_server.effects.decide import Decision
from catoptra_server.imaging.encode import encoded_payload, png_payload
from catoptra_server.imaging.shot import SCREEN, Caption, Channel
from catoptra_server.render.renderer import Image


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A finished picture of a channel.

    rgb: (h, w, 3) uint8, read-only. time_s: simulation time of the exposure. exposed_s, finished_s:
    on the server's monotonic clock. drawn_s: seconds that it took to draw. plan: how it was drawn.
    error_bound_px: how far off an outline in it may be at most; bound: that and its parts by name.
    Both None where unknown. effects: what was decided about each that is named, of one camera's
    picture.
    """

    sequence: int
    time_s: float
    rgb: Image
    exposed_s: float
    finished_s: float
    channel: Channel = SCREEN
    caption: Caption = field(default_factory=Caption)
    stage_ms: dict[str, float] = field(default_factory=dict)
    drawn_s: float = 0.0
    plan: str | None = None
    error_bound_px: float | None = None
    bound: dict[str, float] | None = None
    effects: tuple[Decision, ...] = ()
    _payloads: dict[ImageType | Encoding, bytes] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def payload(self, kind: ImageType | Encoding) -> bytes:
        """Return the whole picture's payload; encoded once, also when threads ask at once.

        A JPEG of the stream is one of type GOOD: viewers of both transports share it.
        """
        kind = ImageType.GOOD if kind is Encoding.JPEG else kind
        with self._lock:
            if kind not in self._payloads:
                self._payloads[kind] = _encoded(self.rgb, kind)
            return self._payloads[kind]


def _encoded(rgb: Image, kind: ImageType | Encoding) -> bytes:
    if isinstance(kind, ImageType):
        return encoded_payload(rgb, kind)
    return rgb.tobytes() if kind is Encoding.RAW else png_payload(rgb)
