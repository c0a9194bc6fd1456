"""Measured costs on disk: a restarted server does not measure again.

A file belongs to one renderer on one processor or graphics card, one scene, camera, surface and
release. An unreadable file only means a new measurement: the cache may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
from collections.abc import Mapping
from pathlib import Path

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server import __version__
from catoptra_server.planning.cost_model import Rates
from catoptra_server.render.render_settings import MirrorSurface
from catoptra_server.runtime.memory import count_processors
from catoptra_server.world.scene_mesh import SceneMesh

log = logging.getLogger(__name__)

# Increased when the meaning of a rate or the name of a stage changes.
_FORMAT_VERSION = 4
_CPU_INFO = Path("/proc/cpuinfo")


def default_cache_folder() -> Path:
    """Cache folder of this user, under XDG_CACHE_HOME."""
    configured = os.environ.get("XDG_CACHE_HOME", "")
    # The XDG specification ignores relative paths.
    root = Path(configured) if configured.startswith("/") else Path.home() / ".cache"
    return root / "catoptra" / "costs"


class CostCache:
    """Cost files of one scene."""

    def __init__(self, folder: Path | None, scene: SceneMesh) -> None:
        self._folder = folder
        self._scene = scene
        self._digest = ""

    def read(self, key: str) -> dict[str, Rates] | None:
        """Rates under a key, by cost group; None for an absent or unreadable file."""
        if self._folder is None:
            return None
        try:
            groups = json.loads(self._path(key).read_text(encoding="utf-8"))
            return {
                str(group): {str(s): tuple(map(float, rates)) for s, rates in stages.items()}
                for group, stages in groups.items()
            }
        # Malformed content raises any of these, by the depth at which the form is wrong.
        except (OSError, ValueError, AttributeError, TypeError):
            return None

    def write(self, key: str, rates: Mapping[str, Rates]) -> None:
        """Store rates under a key, atomically."""
        if self._folder is None:
            return
        file = self._path(key)
        # A file of the process's own, then renamed: another server never reads half a file.
        unfinished = file.with_suffix(f".{os.getpid()}")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            unfinished.write_text(json.dumps(rates, indent=1), encoding="utf-8")
            unfinished.replace(file)
        except OSError as error:
            log.warning("frame costs cannot be stored in %s: %s", self._folder, error)

    def make_key(
        self, renderer_description: str, camera: OmniCamera, surface: MirrorSurface
    ) -> str:
        """Key of everything that the rates depend on.

        Args:
            renderer_description: The renderer's `describe()`: library, device, threads.
        """
        # On demand: hashing a million triangles takes half a second.
        if not self._digest:
            self._digest = hash_scene(self._scene)
        return self.make_key_of(renderer_description, self._digest, camera, surface)

    def make_key_of(self, *facts: object) -> str:
        """Key of some facts, this processor and this release."""
        parts = (_FORMAT_VERSION, __version__, _describe_processor(), *facts)
        # repr of frozen dataclasses names every field, so a new field changes the key.
        return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:32]

    def _path(self, key: str) -> Path:
        assert self._folder is not None, "a path exists only with a folder"
        return self._folder / f"{key}.json"


def hash_scene(scene: SceneMesh) -> str:
    """Digest of everything visible in a scene."""
    digest = hashlib.sha256()
    arrays = (scene.corners, scene.albedo, scene.unlit, scene.texture_index, *scene.textures)
    occlusion = () if scene.occlusion is None else scene.occlusion.arrays
    for array in (*arrays, scene.corner_albedo, *occlusion):
        if array is not None:
            digest.update(repr(array.shape).encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


def _describe_processor() -> str:
    """Name of the processor, and the number of processors this process may use."""
    try:
        lines = _CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    name = next((line for line in lines if line.startswith("model name")), None)
    # Only where the kernel names none: `platform` runs a process for its answer.
    return f"{name or platform.processor()}, {count_processors()}"
