"""What a Catoptra server and its clients must agree on.

`wire` holds the bytes (sans-I/O), `optics` the camera law (float64, pure functions), `landmarks`
the file of landmarks that the server draws and the client localises with. None of them imports
another.
"""
