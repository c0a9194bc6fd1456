"""`python -m catoptra_client.child_server`: catoptra-server as a child that ends with its program.

The program holds the other end of standard input, a pipe, and writes nothing to it. The pipe ends
with the program, by whatever signal; the server then ends in order, as on SIGTERM. Without this a
killed program would leave a server behind that serves nobody.
"""

from __future__ import annotations

import os
import runpy
import signal
import sys
import threading


def _terminate_with_program() -> None:
    # os.read, not sys.stdin: a thread that holds the buffer's lock at the interpreter's end aborts
    # the process.
    while os.read(sys.stdin.fileno(), 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def main() -> None:
    """Serve by the arguments of the command line until the program ends or a signal arrives."""
    threading.Thread(target=_terminate_with_program, daemon=True).start()
    # By name: the client imports nothing of the server, which is another distribution.
    runpy.run_module("catoptra_server", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
