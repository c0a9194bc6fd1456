"""The image port (TCP 5003): one frame for each request, as USARSim's image server answers."""

from __future__ import annotations

import asyncio
import logging
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

from catoptra_protocol.usarsim.image_port import (
    FullFrameRequest,
    ImageRequestReader,
    ImageType,
    RegionRequest,
    encode_frame_header,
)
from catoptra_server.frames.encode import crop, encode_payload
from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_request import IMAGE_PORT, Channel, ImagePortChannel
from catoptra_server.frames.mailbox import Mailbox, Mailboxes
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.transports.tcp_server import peer_name, serve_tcp

log = logging.getLogger(__name__)

_READ_BYTES = 4 * 1024


@dataclass(frozen=True, slots=True)
class ImageOptions:
    """How frames are sent. legacy: one frame unasked on connecting, as ImageSrv did.

    multi_view: the tiles of the screen, where it has some.
    """

    image_type: ImageType = ImageType.GOOD
    legacy_mode: bool = False
    multi_view: TileLayout | None = None


def serve_images(
    host: str, port: int, *, mailboxes: Mailboxes, options: ImageOptions
) -> AbstractAsyncContextManager[asyncio.Server]:
    """Listen for viewers. Each is served at its own pace; a slow one slows nobody else."""

    async def handle_connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = peer_name(writer)
        log.info("viewer %s connected", peer)
        viewer = _ImagePeer(writer, mailboxes, options)
        try:
            await viewer.answer_requests(reader)
        finally:
            log.info("viewer %s gone after %d frames", peer, viewer.num_sent)

    return serve_tcp(host, port, handle_connection)


class _ImagePeer:
    """One connection. While a frame is on its way no request is read: TCP holds them back."""

    def __init__(
        self, writer: asyncio.StreamWriter, mailboxes: Mailboxes, options: ImageOptions
    ) -> None:
        self._writer = writer
        self._mailboxes = mailboxes
        self._options = options
        self._subscriptions: dict[Channel, tuple[Mailbox, int]] = {}
        self.num_sent = 0

    async def answer_requests(self, reader: asyncio.StreamReader) -> None:
        """Answer requests, in order, until the viewer leaves."""
        if self._options.legacy_mode:
            await self._answer(FullFrameRequest())
        requests = ImageRequestReader()
        while data := await reader.read(_READ_BYTES):
            for request in requests.receive(data):
                await self._answer(request)

    async def _answer(self, request: FullFrameRequest | RegionRequest) -> None:
        channel, wanted = _select_channel(request, self._options.multi_view)
        frame = await self._next_frame(channel)
        payload = await asyncio.to_thread(_encode_payload, frame, wanted, self._options.image_type)
        self._writer.write(encode_frame_header(self._options.image_type, len(payload)))
        self._writer.write(payload)
        await self._writer.drain()
        self.num_sent += 1

    async def _next_frame(self, channel: Channel) -> Frame:
        """Return a frame of a channel that this viewer has not seen."""
        mailbox, last = self._subscriptions.get(channel) or (self._mailboxes.get(channel), 0)
        frame = await mailbox.wait_for_newer(last)
        self._subscriptions[channel] = (mailbox, frame.sequence)
        return frame


def _select_channel(
    request: FullFrameRequest | RegionRequest, multi_view: TileLayout | None
) -> tuple[Channel, FullFrameRequest | RegionRequest]:
    """Return what to draw for a request: one tile alone if it asks for no more of a multi-view."""
    if multi_view is None or isinstance(request, FullFrameRequest):
        return IMAGE_PORT, request
    x, y, width, height = request.x, request.y, request.width, request.height
    touched = multi_view.tiles_overlapping(x, y, width, height)
    tile = multi_view.tile_at(touched[0]) if len(touched) == 1 else None
    if tile is None:
        return IMAGE_PORT, request
    last_x, last_y = multi_view.width_px - 1, multi_view.height_px - 1
    within = RegionRequest(min(x, last_x) - tile.x_px, min(y, last_y) - tile.y_px, width, height)
    return ImagePortChannel(touched[0]), within


def _encode_payload(
    frame: Frame, request: FullFrameRequest | RegionRequest, image_type: ImageType
) -> bytes:
    if isinstance(request, FullFrameRequest):
        return frame.encode(image_type)
    part = crop(frame.rgb, request.x, request.y, request.width, request.height)
    return encode_payload(part, image_type)
