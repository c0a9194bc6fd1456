"""All that the page reads by GET: its files, and descriptions of the server as JSON.

Addresses are looked up in tables: a request never names a file.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.transports.stream.server_info import ServerInfo
from catoptra_server.transports.web.camera_table import camera_table
from catoptra_server.transports.web.floor_plan import floor_plan
from catoptra_server.transports.web.page_files import Document, create_document
from catoptra_server.transports.web.server_description import describe_server
from catoptra_server.world.scene_mesh import SceneMesh

_JSON = "application/json; charset=utf-8"
# Path and, for a camera, its class and name.
_Key = tuple[str, ...]


class WebPages:
    """Documents by address; those that take time are made at the first request, in a thread."""

    def __init__(
        self, files: Mapping[str, Document], server_info: ServerInfo, scene: SceneMesh
    ) -> None:
        """Begin without descriptions.

        Args:
            files: The files of the page, by path of the address.
            server_info: The server, its robots and cameras.
            scene: Triangles of the world.
        """
        self._files = files
        self._makers: dict[_Key, Callable[[], object]] = {
            ("/api/server.json",): lambda: describe_server(server_info),
            ("/api/floor_plan.json",): lambda: floor_plan(scene),
        }
        for robot in server_info.robots:
            for omni in robot.omni_cameras:
                key = (_CAMERA_TABLE, robot.class_name, omni.name)
                self._makers[key] = _table_maker(omni.camera)
        self._documents: dict[_Key, asyncio.Task[Document]] = {}

    def close(self) -> None:
        """Wait for nothing more."""
        for task in self._documents.values():
            task.cancel()

    async def find(self, path: str, query: Mapping[str, str]) -> Document | None:
        """Document at an address; None if there is none."""
        if path in self._files:
            return self._files[path]
        key: _Key = (path,)
        if path == _CAMERA_TABLE:
            key = path, query.get("class", ""), query.get("camera", "")
        if key not in self._makers:
            return None
        task = self._documents.get(key)
        if task is None or (task.done() and (task.cancelled() or task.exception())):
            task = asyncio.create_task(_make_document(self._makers[key]))
            self._documents[key] = task
        # Shielded: other requests wait for the same document.
        return await asyncio.shield(task)


_CAMERA_TABLE = "/api/camera_table.json"


def _table_maker(camera: OmniCamera) -> Callable[[], object]:
    return lambda: camera_table(camera)


async def _make_document(make: Callable[[], object]) -> Document:
    return await asyncio.to_thread(
        lambda: create_document(_JSON, json.dumps(make(), allow_nan=False).encode())
    )
