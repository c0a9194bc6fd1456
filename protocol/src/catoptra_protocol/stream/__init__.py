"""The protocol of the ZeroMQ stream and of the page (SPEC.md, chapter 9), without sockets.

`requests` and `replies` hold the messages, one frozen dataclass each, and the tables REQUESTS and
REPLIES; `messages` converts messages to msgpack and to JSON, and back; `codec` checks decoded maps
against dataclasses. Sockets: `serve/stream` of the server, `frame_sources/stream` of the
client.
"""
