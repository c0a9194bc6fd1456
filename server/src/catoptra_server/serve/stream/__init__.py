"""Server side of the ZeroMQ stream.

`connection_guard` owns the public port and limits what a connection can use: it counts messages by
`zmtp_part_limit`, removes identities by `zmtp_identity`, and passes bytes by `relay`.
`router_socket` is the ROUTER behind the guard, in a `private_folder`, and `stream_server` has its
clients. A `stream_peer`, on ZeroMQ or a WebSocket, replies to the requests of one client: about its
robot by `robot_session`, frames by `frame_sender`, the server by `server_replies` (`server_info`),
others by `landmark_replies` and `plan_replies`. All share the `stream_context`.
`pending_requests` gives each request one reply, `outbox` holds replies that the client has no room
for.
"""

from __future__ import annotations
