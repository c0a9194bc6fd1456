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
from catoptra_server.imaging.encode import cropped, encoded_payload
from catoptra_server.imaging.frame import Frame
from catoptra_server.imaging.multi_view import TileLayout
from catoptra_server.imaging.shot import SCREEN, Channel, ScreenChannel
from catoptra_server.mailbox import Mailbox, Mailboxes
from catoptra_server.transports.listening import listening, peer_name

log = logging.getLogger(__name__)

_READ_BYTES = 4 * 1024


@dataclass(frozen=True, slots=True)
class ImageOptions:
    """How frames are sent. legacy: one frame unasked on connecting, as ImageSrv did.

    multi_view: the tiles of the screen, where it has some.
    """

    image_type: ImageType = ImageType.GOOD
    legacy: bool = False
    multi_view: TileLayout | None = None


def serve_images(
    host: str, port: int, *, mailboxes: Mailboxes, options: ImageOptions
) -> AbstractAsyncContextManager[asyncio.Server]:
    """Listen for viewers. Each is served at its own pace; a slow one slows nobody else."""

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = peer_name(writer)
        log.info("viewer %s connected", peer)
        viewer = _Viewer(writer, mailboxes, options)
        try:
            await viewer.serve(reader)
        finally:
            log.info("viewer %s gone after %d frames", peer, viewer.sent)

    return listening(host, port, converse)


class _Viewer:
    """One connection. While a frame is on its way no request is read: TCP holds them back."""

    def __init__(
        self, writer: asyncio.StreamWriter, mailboxes: Mailboxes, options: ImageOptions
    ) -> None:
        self._writer = writer
        self._mailboxes = mailboxes
        self._options = options
        self._watched: dict[Channel, tuple[Mailbox, int]] = {}
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
        channel, wanted = _channel(request, self._options.multi_view)
        frame = await self._newest(channel)
        payload = await asyncio.to_thread(_payload, frame, wanted, self._options.image_type)
        self._writer.write(frame_header(self._options.image_type, len(payload)))
        self._writer.write(payload)
        await self._writer.drain()
        self.sent += 1

    async def _newest(self, channel: Channel) -> Frame:
        """Return a frame of a channel that this viewer has not seen."""
        mailbox, last = self._watched.get(channel) or (self._mailboxes.of(channel), 0)
        frame = await mailbox.newer_than(last)
        self._watched[channel] = (mailbox, frame.sequence)
        return frame


def _channel(
    request: WholeFrame | SubFrame, multi_view: TileLayout | None
) -> tuple[Channel, WholeFrame | SubFrame]:
    """Return what to draw for a request: one tile alone if it asks for no more of a multi-view."""
    if multi_view is None or isinstance(request, WholeFrame):
        return SCREEN, request
    x, y, width, height = request.x, request.y, request.width, request.height
    touched = multi_view.tiles_within(x, y, width, height)
    tile = multi_view.tile(touched[0]) if len(touched) == 1 else None
    if tile is None:
        return SCREEN, request
    last_x, last_y = multi_view.width_px - 1, multi_view.height_px - 1
    within = SubFrame(min(x, last_x) - tile.x_px, min(y, last_y) - tile.y_px, width, height)
    return ScreenChannel(touched[0]), within


def _payload(frame: Frame, request: WholeFrame | SubFrame, image_type: ImageType) -> bytes:
    if isinstance(request, WholeFrame):
        return frame.payload(image_type)
    part = cropped(frame.rgb, request.x, request.y, request.width, request.height)
    return encoded_payload(part, image_type)
