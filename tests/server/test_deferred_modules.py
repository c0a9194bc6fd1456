"""Modules that are loaded once the ports listen: none before the first frame, all afterwards."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

# A process of its own: this one has loaded nearly all modules already.
SCRIPT = """
import json, sys
from catoptra_server.commands.serve import main
from catoptra_server.commands.server import load_deferred_modules, load_view_modules
before = sorted(sys.modules)
load_deferred_modules(sys.argv[1])
if sys.argv[2] == "view":
    load_view_modules()
print(json.dumps([before, sorted(sys.modules)]))
"""
STREAM = {"zmq", "msgpack", "catoptra_server.serve.stream.peer"}
RASTER = {"moderngl", "catoptra_server.render.raster.raster_renderer"}


VIEW = {"aiohttp", "catoptra_server.serve.web.web_server"}


def list_modules(renderer: str, view: str = "view") -> tuple[set[str], set[str]]:
    """Modules loaded for a start, and those after the deferred ones."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, renderer, view], check=True, capture_output=True, text=True
    )
    before, after = json.loads(done.stdout)
    return set(before), set(after)


@pytest.mark.parametrize(("renderer", "deferred"), [("auto", STREAM | RASTER), ("trace", STREAM)])
def test_modules_of_stream_and_second_renderer_are_loaded_after_the_start(
    renderer: str, deferred: set[str]
) -> None:
    before, after = list_modules(renderer)
    assert not before & (STREAM | RASTER)
    assert after & (STREAM | RASTER) == deferred


@pytest.mark.parametrize(("view", "deferred"), [("view", VIEW), ("no view", set())])
def test_modules_of_the_page_are_loaded_after_the_start_where_it_is_served(
    view: str, deferred: set[str]
) -> None:
    before, after = list_modules("trace", view)
    assert not before & VIEW
    assert after & VIEW == deferred
