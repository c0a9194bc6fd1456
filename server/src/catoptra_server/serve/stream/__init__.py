"""Server side of the ZeroMQ stream.

`guard` owns the public port and limits what a connection can use. `router` has the ROUTER socket
behind it, and the queue of messages to each client. `peer` has the clients, on ZeroMQ or a
WebSocket: the robot of a client is a `session`, pictures come from `frames`, all else from
`replies`.
"""

from __future__ import annotations
