"""The protocol of the ZeroMQ stream (SPEC.md, chapter 9), without sockets.

`requests` and `replies` hold the messages, one frozen dataclass each, and the tables REQUESTS and
REPLIES; `messages` converts messages to bytes and back; `msgpack_codec` checks maps against
dataclasses. Sockets: `transports/stream` of the server, `frame_sources/stream` of the client.
"""
