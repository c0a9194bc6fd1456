"""`catoptra-server` as a child process that ends with its parent.

The parent holds the other end of standard input, a pipe, and writes nothing to it. The pipe closes
when the parent closes it or ends, by whatever signal, and the server then ends at once. No timer is
involved: a slow machine cannot end a healthy server, and a killed test run leaves none behind.
"""

from __future__ import annotations

import os
import sys
import threading

from catoptra_server.__main__ import main

EXIT_PARENT_GONE = 70


def _exit_with_parent() -> None:
    # os.read, not sys.stdin: a thread that holds the buffer's lock at the interpreter's end aborts
    # the process. os._exit, not sys.exit: a server that hangs must end too.
    while os.read(sys.stdin.fileno(), 1):
        pass
    os._exit(EXIT_PARENT_GONE)


if __name__ == "__main__":
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    sys.exit(main(sys.argv[1:]))
