"""The live page: its files, its description of the server, and its WebSockets.

`web_server` has the port and its connections (`web_connection`), `web_access` decides who may use
it, `web_pages` has all that is read by GET: `page_files`, `server_description`, `floor_plan` and
`camera_table`. A `page_socket` is a client of the stream, like one on ZeroMQ, whose robots stop
without it by a `dead_man_switch`.
"""

from __future__ import annotations
