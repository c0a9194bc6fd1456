"""Documents by address, made once."""

from __future__ import annotations

import asyncio
import json
import threading

import pytest

from catoptra_server.serve.web import pages as web_pages
from catoptra_server.serve.web.pages import WebPages
from catoptra_server.world.scene_mesh import build_scene
from helpers.fake_simulation import SERVER_INFO
from helpers.live_page import FILES
from helpers.loopback import run_scenario
from helpers.worlds import make_test_world

(ROBOT,) = SERVER_INFO.robots
assert ROBOT.omni_camera is not None
CAMERA = {"class": ROBOT.class_name, "camera": ROBOT.omni_camera.name}


def make_pages() -> WebPages:
    return WebPages(FILES, SERVER_INFO, build_scene(make_test_world()))


def test_files_and_descriptions_are_found() -> None:
    async def scenario() -> None:
        pages = make_pages()
        assert await pages.find("/", {}) is FILES["/"]
        for path, key in [("/api/server.json", "classes"), ("/api/floor_plan.json", "segments")]:
            document = await pages.find(path, {"ignored": "1"})
            assert document is not None
            assert document.content_type.startswith("application/json")
            assert json.loads(document.body)[key]
        table = await pages.find("/api/camera_table.json", CAMERA)
        assert table is not None
        assert json.loads(table.body)["kind"] == "radial"

    run_scenario(scenario())


@pytest.mark.parametrize(
    ("path", "query"),
    [
        *(("/index.html", {}), ("/static", {}), ("/static/", {}), ("//", {}), ("", {})),
        *(("/static/../web_pages.py", {}), ("/static//etc/passwd", {}), ("/api", {})),
        *(("/static/main.js\0", {}), ("/static/%2e%2e/x", {}), ("/api/camera_table.json", {})),
        ("/api/camera_table.json", CAMERA | {"camera": "Other"}),
        ("/api/camera_table.json", {"camera": CAMERA["camera"]}),
    ],
)
def test_address_when_unknown_has_no_document(path: str, query: dict[str, str]) -> None:
    async def scenario() -> None:
        assert await make_pages().find(path, query) is None

    run_scenario(scenario())


def test_description_for_many_requests_is_made_once_although_one_is_cancelled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[object] = []
    may_end = threading.Event()

    def make(info: object) -> dict[str, object]:
        calls.append(info)
        assert may_end.wait(20.0)
        return {}

    monkeypatch.setattr(web_pages, "describe_server", make)

    async def scenario() -> None:
        pages = make_pages()
        first, *others = (asyncio.create_task(pages.find("/api/server.json", {})) for _ in range(4))
        await asyncio.sleep(0)
        first.cancel()
        await asyncio.gather(first, return_exceptions=True)
        may_end.set()
        documents = await asyncio.gather(*others)
        assert first.cancelled()
        assert documents[0] is documents[1] is documents[2]
        assert len(calls) == 1

    run_scenario(scenario())


def test_description_when_it_fails_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    results = iter([ZeroDivisionError("injected"), {}])

    def make(_: object) -> object:
        result = next(results)
        if isinstance(result, Exception):
            raise result
        return result

    monkeypatch.setattr(web_pages, "floor_plan", make)

    async def scenario() -> None:
        pages = make_pages()
        with pytest.raises(ZeroDivisionError):
            await pages.find("/api/floor_plan.json", {})
        assert await pages.find("/api/floor_plan.json", {}) is not None

    run_scenario(scenario())
