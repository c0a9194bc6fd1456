"""A server process that counts its frames and the processor time of drawing and of all the rest.

Run by `served_process.py`: python -m cost.counted_server [--stand-in-ms MS] SERVER-OPTIONS. For
each line on standard input a line of JSON goes to standard output. With a stand-in each view is
drawn once; its frames take that time afterwards, and no processor time.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

from catoptra_server.__main__ import main
from catoptra_server.frames import views
from catoptra_server.frames.frame_plan import ViewKey
from catoptra_server.render.renderer import RenderedImage

STAND_IN_OPTION = "--stand-in-ms"
# As many frames as clients may hold at once: a frame on its way must not be drawn over.
STAND_IN_IMAGES = 24
# Threads of renderers that are written in Python; native ones have no name there.
DRAWING_THREADS = "trace"
ZMQ_THREADS = "ZMQ"


class DrawingCounter:
    """Frames drawn, and the render thread's processor time for them."""

    def __init__(self, stand_in_s: float | None) -> None:
        self.frames = 0
        self.draw_s = 0.0
        self._stand_in_s = stand_in_s
        self._images: dict[int, deque[RenderedImage]] = {}

    def render(self, view: Any, *arguments: Any) -> RenderedImage:
        """Render by a view, or by the stand-in, and count."""
        begin_s = time.thread_time()
        image = self._draw(view, arguments)
        self.draw_s += time.thread_time() - begin_s
        self.frames += 1
        return image

    def _draw(self, view: Any, arguments: tuple[Any, ...]) -> RenderedImage:
        if self._stand_in_s is None:
            image: RenderedImage = view.render(*arguments)
            return image
        images = self._images.get(id(view))
        if images is None:
            images = self._images[id(view)] = _copy_image(view.render(*arguments))
        time.sleep(self._stand_in_s)
        images.rotate()
        return images[0]


class CountedView:
    """A view whose frames are counted."""

    def __init__(self, view: Any, counter: DrawingCounter) -> None:
        self._view = view
        self._counter = counter

    def render(self, *arguments: Any) -> RenderedImage:
        """Render one exposure."""
        return self._counter.render(self._view, *arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._view, name)


def _copy_image(image: RenderedImage) -> deque[RenderedImage]:
    copies = deque(replace(image, rgb=image.rgb.copy()) for _ in range(STAND_IN_IMAGES))
    for copy in copies:
        copy.rgb.setflags(write=False)
    return copies


def _count_frames(counter: DrawingCounter) -> None:
    """Have every view of this process counted."""
    # By its private name: a measurement of the drawing alone, in a process of its own.
    store_type = views._ViewStore
    get = store_type.get

    def get_counted(store: Any, key: ViewKey, **options: bool) -> Any:
        return CountedView(get(store, key, **options), counter)

    store_type.get = get_counted  # type: ignore[method-assign] # every frame's view passes here


def _answer_lines(counter: DrawingCounter) -> None:
    for _ in sys.stdin:
        process_s = time.process_time()
        print(
            json.dumps(
                {
                    "time_s": time.monotonic(),
                    "frames": counter.frames,
                    "process_s": process_s,
                    "serving_s": _serving_s() - counter.draw_s,
                }
            ),
            flush=True,
        )


def _serving_s() -> float:
    """Processor time of all threads but those that only draw, seconds."""
    names = {thread.native_id: thread.name for thread in threading.enumerate()}
    total_s = 0.0
    for folder in Path("/proc/self/task").iterdir():
        try:
            name = names.get(int(folder.name)) or (folder / "comm").read_text()
            on_processor_ns = int((folder / "schedstat").read_text().split()[0])
        except FileNotFoundError:
            continue  # the thread has ended meanwhile
        is_known = int(folder.name) in names or name.startswith(ZMQ_THREADS)
        if is_known and not name.startswith(DRAWING_THREADS):
            total_s += 1e-9 * on_processor_ns
    return total_s


def _run(arguments: list[str]) -> int:
    stand_in_s = None
    if arguments[:1] == [STAND_IN_OPTION]:
        stand_in_s, arguments = 1e-3 * float(arguments[1]), arguments[2:]
    counter = DrawingCounter(stand_in_s)
    _count_frames(counter)
    threading.Thread(target=_answer_lines, args=(counter,), daemon=True).start()
    return main(arguments)


if __name__ == "__main__":
    status = _run(sys.argv[1:])
    sys.stdout.flush()
    # At once: the thread that reads standard input holds its lock.
    os._exit(status)
