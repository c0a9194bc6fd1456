"""Server side of the ZeroMQ stream.

`connection_guard` owns the public port and ends endless messages, which `zmtp_part_limit` counts;
`router_socket` is the ROUTER behind the guard. `stream_server` dispatches requests: about the
server by itself (`server_info`, `landmark_replies`, `plan_replies`), about one client's robot to
its `stream_peer`, frames to its `frame_sender`.
"""
