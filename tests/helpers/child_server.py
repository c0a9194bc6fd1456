"""`catoptra-server` as a child process that ends with its parent.

The parent holds the other end of standard input, a pipe, and writes nothing to it. The pipe closes
when the parent closes it or ends, by whatever signal, and the server then ends at once. No timer is
involved: a slow machine cannot end a healthy server, and a killed test run leaves none behind.

With `--report-first-frame FILE` before the server's arguments, the server waits for a client of the
stream before it loads what it defers, and writes then the names of all loaded modules. With
`--report-modules FILE` before the server's arguments, the server writes at its end the names
of the modules that it loaded after those that it defers until its ports listen, as a JSON list.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path

from catoptra_server.__main__ import main

EXIT_PARENT_GONE = 70
REPORT_OPTION = "--report-modules"
REPORT_FIRST_FRAME_OPTION = "--report-first-frame"


def _exit_with_parent() -> None:
    # os.read, not sys.stdin: a thread that holds the buffer's lock at the interpreter's end aborts
    # the process. os._exit, not sys.exit: a server that hangs must end too.
    while os.read(sys.stdin.fileno(), 1):
        pass
    os._exit(EXIT_PARENT_GONE)


def _serve_and_report_modules(report: Path, arguments: list[str]) -> int:
    from catoptra_server.commands import server as app

    loaded: list[str] | None = None
    load_deferred_modules, load_view_modules = app.load_deferred_modules, app.load_view_modules

    def record(event: str, details: tuple[object, ...]) -> None:
        if event == "import" and loaded is not None:
            loaded.append(str(details[0]))

    def load_and_record(renderer: str) -> None:
        nonlocal loaded
        load_deferred_modules(renderer)
        loaded = []

    def load_view_and_record() -> None:
        nonlocal loaded
        load_view_modules()
        loaded = []

    app.load_deferred_modules, app.load_view_modules = load_and_record, load_view_and_record
    # The event occurs for modules that are not loaded yet, also where none is found.
    sys.addaudithook(record)
    status = main(arguments)
    report.write_text(json.dumps(loaded))
    return status


def _serve_and_report_first_frame(report: Path, arguments: list[str]) -> int:
    from catoptra_server.commands import server as app

    load_deferred_modules = app.load_deferred_modules

    def report_and_load(renderer: str) -> None:
        report.write_text(json.dumps(sorted(sys.modules)))
        load_deferred_modules(renderer)

    app.load_deferred_modules = report_and_load
    app._FIRST_FRAME_TIME_S = 60.0
    return main(arguments)


def _serve(arguments: list[str]) -> int:
    match arguments:
        case [option, report, *rest] if option == REPORT_OPTION:
            return _serve_and_report_modules(Path(report), rest)
        case [option, report, *rest] if option == REPORT_FIRST_FRAME_OPTION:
            return _serve_and_report_first_frame(Path(report), rest)
        case _:
            return main(arguments)


if __name__ == "__main__":
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    sys.exit(_serve(sys.argv[1:]))
