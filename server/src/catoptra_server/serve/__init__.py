"""The sockets of the server: asyncio around the protocols of `catoptra_protocol`.

`tcp_control` and `tcp_image` are the two ports of USARSim, on top of `tcp_server`; `stream` is the
ZeroMQ stream, `web` the live page, whose pages are clients of the stream. `limits` is what all
clients together may take. Commands go to the simulation as events, frames come from mailboxes: no
transport depends on the motion of robots or on the rendering of images.
"""

from __future__ import annotations
