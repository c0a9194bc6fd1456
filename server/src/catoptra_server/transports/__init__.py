"""The sockets: asyncio around the sans-I/O protocol. One file a port, on top of `listening`."""
