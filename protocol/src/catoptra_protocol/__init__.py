"""The contract between a Catoptra server and its clients.

`usarsim` and `stream` hold the two protocols (bytes, no sockets), `optics` the camera model
(float64, pure functions), `landmarks` the file of landmarks that the server renders and the client
localizes with. None of the four imports another; `camera_conf` alone joins optics and wire.
`errors`, `limits` and `vectors` are shared by all.
"""
