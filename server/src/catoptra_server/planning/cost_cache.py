"""Measured costs, kept on disk: a server that starts again does not measure again.

A file is of one renderer on one processor or graphics card, one scene, camera, surface and release.
What cannot be read or written is measured instead: the cache may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.cost_model import Rates
from catoptra_server.robot.render_settings import MirrorSurface
from catoptra_server.scene.scene_mesh import SceneMesh

log = logging.getLogger(__name__)

# Raised when the meaning of a rate changes.
_FORMAT_VERSION = 1
_CPU_INFO = Path("/proc/cpuinfo")


def default_cache_folder() -> Path:
    """Return where this user's programs keep what they can make again."""
    said = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(said) if said.startswith("/") else Path.home() / ".cache"
    return root / "catoptra" / "costs"


class CostCache:
    """The files of one scene. folder None: nothing is kept."""

    def __init__(self, folder: Path | None, scene: SceneMesh) -> None:
        self._folder = folder
        self._scene = scene
        self._digest = ""

    def read(self, key: str) -> dict[str, Rates] | None:
        """Return the rates by way of drawing under a key; None where there are none."""
        if self._folder is None:
            return None
        try:
            ways = json.loads(self._path(key).read_text(encoding="utf-8"))
            return {
                str(way): {str(s): tuple(map(float, rates)) for s, rates in stages.items()}
                for way, stages in ways.items()
            }
        except (OSError, ValueError, AttributeError, TypeError):
            return None

    def write(self, key: str, rates: Mapping[str, Rates]) -> None:
        """Keep rates; whole or not at all, whoever else writes."""
        if self._folder is None:
            return
        file = self._path(key)
        unfinished = file.with_suffix(f".{os.getpid()}")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            unfinished.write_text(json.dumps(rates, indent=1), encoding="utf-8")
            unfinished.replace(file)
        except OSError as error:
            log.warning("costs of frames are not kept in %s: %s", self._folder, error)

    def make_key(
        self, renderer_description: str, camera: OmniCamera, surface: MirrorSurface
    ) -> str:
        """Return the key of what a renderer's words say, for a camera and its mirror's surface."""
        if not self._digest:
            self._digest = hash_scene(self._scene)
        parts = (
            _FORMAT_VERSION,
            _server_version(),
            renderer_description,
            _describe_processor(),
            self._digest,
            camera,
            surface,
        )
        return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:32]

    def _path(self, key: str) -> Path:
        assert self._folder is not None, "only asked where files are kept"
        return self._folder / f"{key}.json"


def hash_scene(scene: SceneMesh) -> str:
    """Return a digest of all that is drawn of a scene."""
    digest = hashlib.sha256()
    for array in (scene.corners, scene.albedo, scene.unlit, scene.texture_index, *scene.textures):
        digest.update(repr(array.shape).encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _describe_processor() -> str:
    """Return what computes: the processor's name, and how many of them this process may use."""
    try:
        lines = _CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    name = next((line for line in lines if line.startswith("model name")), platform.processor())
    return f"{name}, {len(os.sched_getaffinity(0))}"


def _server_version() -> str:
    return version("catoptra-server")
