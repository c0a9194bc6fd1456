"""The image port (TCP 5003): one frame for each request, as USARSim's image server answers."""

from __future__ import annotations

import asyncio
import logging
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

from catoptra_protocol.wire.image import (
    ImageRequestReader,
    ImageType,
    SubFrame,
    WholeFrame,
    frame_header,
)
from catoptra_server.encode import Frame, cropped, encoded_payload
from catoptra_server.mailbox import Mailbox
from catoptra_server.transports.listening import listening, peer_name

log = logging.getLogger(__name__)

_READ_BYTES = 4 * 1024


@dataclass(frozen=True, slots=True)
class ImageOptions:
    """How frames are sent. legacy: one frame unasked on connecting, as ImageSrv did."""

    image_type: ImageType = ImageType.GOOD
    legacy: bool = False


def serve_images(
    host: str, port: int, *, mailbox: Mailbox, options: ImageOptions
) -> AbstractAsyncContextManager[asyncio.Server]:
    """Listen for viewers. Each is served at its own pace; a slow one slows nobody else."""

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = peer_name(writer)
        log.info("viewer %s connected", peer)
        viewer = _Viewer(writer, mailbox, options)
        try:
            await viewer.serve(reader)
        finally:
            log.info("viewer %s gone after %d frames", peer, viewer.sent)

    return listening(host, port, converse)


class _Viewer:
    """One connection. While a frame is on its way no request is read: TCP holds them back."""

    def __init__(
        self, writer: asyncio.StreamWriter, mailbox: Mailbox, options: ImageOptions
    ) -> None:
        self._writer = writer
        self._mailbox = mailbox
        self._options = options
        self._last_sequence = 0
        self.sent = 0

    async def serve(self, reader: asyncio.StreamReader) -> None:
        """Answer requests, in order, until the viewer leaves."""
        if self._options.legacy:
            await self._answer(WholeFrame())
        requests = ImageRequestReader()
        while data := await reader.read(_READ_BYTES):
            for request in requests.receive(data):
                await self._answer(request)

    async def _answer(self, request: WholeFrame | SubFrame) -> None:
        frame = await self._mailbox.newer_than(self._last_sequence)
        self._last_sequence = frame.sequence
        payload = await asyncio.to_thread(_payload, frame, request, self._options.image_type)
        self._writer.write(frame_header(self._options.image_type, len(payload)))
        self._writer.write(payload)
        await self._writer.drain()
        self.sent += 1


def _payload(frame: Frame, request: WholeFrame | SubFrame, image_type: ImageType) -> bytes:
    if isinstance(request, WholeFrame):
        return frame.payload(image_type)
    part = cropped(frame.rgb, request.x, request.y, request.width, request.height)
    return encoded_payload(part, image_type)
