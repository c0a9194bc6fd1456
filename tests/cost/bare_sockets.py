"""Processor time of a process that only sends frames: the least that serving them can cost."""

from __future__ import annotations

import os
import socket
import struct
import time

from cost.served_process import HOST, Watcher


def measure_bare_sockets(image_bytes: int, frames: int = 200) -> float:
    """Processor seconds of a process that sends a frame's bytes, without anything else."""
    with socket.create_server((HOST, 0)) as listener:
        port = listener.getsockname()[1]
        read_end, write_end = os.pipe()
        child = os.fork()
        if child == 0:
            _send_frames(listener, write_end, bytes(image_bytes), frames)
        watcher = Watcher(port)
        for _ in range(frames):
            watcher.receive_frame()
        watcher.close()
        os.waitpid(child, 0)
    with open(read_end, "rb") as pipe:
        os.close(write_end)
        processor_s: float = struct.unpack("d", pipe.read())[0]
    return processor_s / frames


def _send_frames(listener: socket.socket, result: int, image: bytes, frames: int) -> None:
    """Answer the requests of one connection, in a process that ends here."""
    connection, _ = listener.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    data = struct.pack(">BI", 0, len(image)) + image
    begin_s = time.process_time()
    for _ in range(frames):
        connection.recv(16)
        connection.sendall(data)
    os.write(result, struct.pack("d", time.process_time() - begin_s))
    os._exit(0)
