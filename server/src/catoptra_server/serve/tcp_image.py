"""Server of the image port (TCP 5003): one frame per request, as in USARSim's image server."""

from __future__ import annotations

import logging
import re
import time
from contextlib import AbstractAsyncContextManager

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.image_port import (
    FullFrameRequest,
    ImageRequestReader,
    ImageType,
    RegionRequest,
)
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    Channel,
    Frame,
    ImagePortChannel,
    Payload,
    crop,
    encode_without_blocking,
)
from catoptra_server.frames.mailbox import ChannelUnavailableError, Mailbox, Mailboxes
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.serve.limits import LoopAccount
from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.tcp_server import TcpConnection, TcpServer, serve_tcp

log = logging.getLogger(__name__)
# Time for the frames of a viewer that has closed its sending side.
_END_GRACE_S = 1.0
# Time of the loop for a read, beside that of requests and replies, which is measured.
_READ_S = 5e-5


@dataclass(frozen=True, slots=True)
class ImageOptions:
    """Options of the image port."""

    image_type: ImageType = ImageType.GOOD
    """Encoding of all frames."""
    legacy_mode: bool = False
    """Whether a new connection gets one frame without a request, as in ImageSrv."""
    multi_view: TileLayout | None = None
    """Tiles of the image-port picture; None without tiles."""


def serve_images(
    host: str,
    port: int,
    *,
    mailboxes: Mailboxes,
    options: ImageOptions,
    limits: ConnectionLimits | None = None,
) -> AbstractAsyncContextManager[TcpServer]:
    """Serve image clients until the block ends, each at a pace of its own.

    Args:
        host: Host name or address of the interface.
        port: TCP port; 0 = a free one.
        mailboxes: Newest frame of each channel.
        options: Encoding, legacy mode and tiles.
        limits: Number of connections and time-outs; None for the defaults.

    Raises:
        OSError: The port is not available.
    """

    limits = limits or ConnectionLimits()
    share = limits.loop_share

    async def handle_connection(connection: TcpConnection) -> None:
        address = connection.address
        log.info("image client %s connected", address)
        peer = _ImagePeer(connection, mailboxes, options, share.open_account(address))
        try:
            await peer.answer_requests()
        except ChannelUnavailableError as error:
            # The port has no errors (SPEC.md 7.2), and a viewer that waits would wait for ever.
            reason = error.reason or "no such camera"
            log.warning("image client %s disconnected: no frame: %s", address, reason)
        finally:
            log.info("image client %s disconnected after %d frames", address, peer.num_sent)

    return serve_tcp(
        host,
        port,
        handle_connection,
        name="image",
        first_bytes=re.compile(rb"[OU]"),
        limits=limits,
        end_grace_s=_END_GRACE_S,
    )


class _ImagePeer:
    """One connection."""

    def __init__(
        self,
        connection: TcpConnection,
        mailboxes: Mailboxes,
        options: ImageOptions,
        account: LoopAccount,
    ) -> None:
        self._connection = connection
        self._mailboxes = mailboxes
        self._options = options
        self._account = account
        self._subscriptions: dict[Channel, tuple[Mailbox, int]] = {}
        # Whether the client had sent nothing beyond the last request at the time of the answer.
        self._is_dialogue = True
        self.num_sent = 0

    async def answer_requests(self) -> None:
        """Reply to requests, in order, until the client sends nothing more.

        Raises:
            ChannelUnavailableError: The image cannot be rendered; the argument is the reason.
        """
        if self._options.legacy_mode:
            await self._answer(FullFrameRequest())
        reader = ImageRequestReader()
        while data := await self._connection.read():
            begin_s = time.thread_time()
            requests = reader.receive(data)
            parse_s = time.thread_time() - begin_s
            # In order, and the next read waits for all replies: TCP holds back a fast client.
            for request in requests:
                self._connection.has_handshake = True
                self._connection.watched_at_s = time.monotonic()
                await self._answer(request)
            # Input without a request is no part of a dialogue.
            is_dialogue = bool(requests) and self._is_dialogue
            self._account.charge(_READ_S + parse_s, is_dialogue=is_dialogue)
            await self._account.wait()

    async def _answer(self, request: FullFrameRequest | RegionRequest) -> None:
        channel, region = _select_channel(request, self._options.multi_view)
        frame = await self._next_frame(channel)
        reply = await _encode_reply(frame, region, self._options.image_type)
        # Before the reply: a fast client sends the next request while the reply is written.
        self._is_dialogue = not self._connection.has_more_input
        with self._account.charge_block(is_dialogue=self._is_dialogue):
            self._connection.write(reply)
        await self._connection.drain()
        self.num_sent += 1

    async def _next_frame(self, channel: Channel) -> Frame:
        """Next frame of a channel that this client has not received."""
        # Per channel: a client may alternate between the full picture and tiles.
        mailbox, last = self._subscriptions.get(channel) or (self._mailboxes.get(channel), 0)
        frame = await mailbox.wait_for_newer(last, self._account)
        self._subscriptions[channel] = (mailbox, frame.sequence)
        return frame


def _select_channel(
    request: FullFrameRequest | RegionRequest, multi_view: TileLayout | None
) -> tuple[Channel, FullFrameRequest | RegionRequest]:
    """Channel and region of a request; a region inside one tile has the channel of that tile."""
    if multi_view is None or isinstance(request, FullFrameRequest):
        return IMAGE_PORT, request
    x, y, width, height = request.x, request.y, request.width, request.height
    tiles = multi_view.tiles_overlapping(x, y, width, height)
    tile = multi_view.tile_at(tiles[0]) if len(tiles) == 1 else None
    if tile is None:
        return IMAGE_PORT, request
    # A region beyond the picture is clipped to the last pixel (SPEC.md 7.3), here before the shift
    # into the tile.
    last_x, last_y = multi_view.width_px - 1, multi_view.height_px - 1
    in_tile = RegionRequest(min(x, last_x) - tile.x_px, min(y, last_y) - tile.y_px, width, height)
    return ImagePortChannel(tiles[0]), in_tile


async def _encode_reply(
    frame: Frame, request: FullFrameRequest | RegionRequest, image_type: ImageType
) -> Payload:
    if isinstance(request, FullFrameRequest):
        return await frame.encode(image_type)
    region = crop(frame.rgb, request.x, request.y, request.width, request.height)
    return await encode_without_blocking(region, image_type)
