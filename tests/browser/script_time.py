"""Script time of the tasks of a page, from a trace of the browser.

A task is one turn of the main thread's event loop. Its script time is the processor time of the
thread inside script: on a busy machine the wall time has the other processes' time in it.
"""

from __future__ import annotations

import base64
import json
import queue
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from browser.devtools import CALL_LIMIT_S, DevTools, Message

_CATEGORIES = ("devtools.timeline", "disabled-by-default-devtools.timeline", "v8", "toplevel")
_TASKS = ("RunTask", "ThreadControllerImpl::RunTask")
_SCRIPTS = frozenset(
    {
        "EvaluateScript",
        "FunctionCall",
        "RunMicrotasks",
        "FireAnimationFrame",
        "TimerFire",
        "EventDispatch",
        "v8.evaluateModule",
        "v8.callFunction",
        "v8.run",
    }
)


@dataclass(slots=True)
class ScriptTimes:
    """Script time of every task that ran script, filled at the end of the trace."""

    tasks_ms: list[float] = field(default_factory=list)


@contextmanager
def trace_scripts(devtools: DevTools) -> Iterator[ScriptTimes]:
    """Trace all pages of a browser for the length of a block."""
    times = ScriptTimes()
    finished: queue.Queue[Message] = queue.Queue()

    def handle(method: str, params: Message) -> None:
        if method == "Tracing.tracingComplete":
            finished.put(params)

    devtools.set_handler("", handle)
    config = {"includedCategories": list(_CATEGORIES), "recordMode": "recordUntilFull"}
    devtools.call("Tracing.start", transferMode="ReturnAsStream", traceConfig=config)
    try:
        yield times
    finally:
        devtools.call("Tracing.end")
        stream = finished.get(timeout=CALL_LIMIT_S)["stream"]
        times.tasks_ms += _script_times(json.loads(_read_stream(devtools, stream))["traceEvents"])
        devtools.remove_handler("")


def _read_stream(devtools: DevTools, handle: str) -> str:
    parts: list[bytes] = []
    while True:
        part = devtools.call("IO.read", handle=handle, size=1 << 20)
        data = part["data"]
        parts.append(base64.b64decode(data) if part.get("base64Encoded") else data.encode())
        if part["eof"]:
            devtools.call("IO.close", handle=handle)
            return b"".join(parts).decode("utf-8")


def _script_times(events: list[dict[str, Any]]) -> list[float]:
    """Script time of each task with script, in milliseconds."""
    threads = defaultdict(list)
    for event in events:
        if event.get("ph") == "X" and (event["name"] in _SCRIPTS or event["name"] in _TASKS):
            threads[event["pid"], event["tid"]].append(event)
    return [time_ms for thread in threads.values() for time_ms in _thread_times(thread)]


def _thread_times(events: list[dict[str, Any]]) -> Iterator[float]:
    """Sum of the outermost scripts within each outermost task of one thread."""
    task_end = script_end = total_us = 0.0
    for event in sorted(events, key=lambda event: (event["ts"], -event.get("dur", 0))):
        end = event["ts"] + event.get("dur", 0)
        if event["ts"] >= task_end:
            if total_us:
                yield total_us / 1000.0
            task_end, total_us = end, 0.0
        if event["name"] in _SCRIPTS and event["ts"] >= script_end:
            total_us += event.get("tdur", event.get("dur", 0))
            script_end = end
    if total_us:
        yield total_us / 1000.0
