"""Arrays that can be computed again, kept on disk so that a second start need not wait for them.

Occlusion maps, skies, textures and light bakes lie in folders of their own under XDG_CACHE_HOME. A
key states all that the arrays depend on. A digest precedes them: a file that is cut off, changed or
of another program is computed anew. A folder grows to its limit; then the files go that were not
used for the longest time. A damaged file and an unwritable folder cost one warning each. Several
processes may share a folder.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catoptra_protocol.slotted_dataclass import dataclass

log = logging.getLogger(__name__)

_DIGEST_BYTES = 32
_SUFFIX = ".arrays"
# Of some hundred worlds; a file is at most a half.
MAX_FOLDER_BYTES = 256 * 2**20


def find_cache_folder(kind: str) -> Path:
    """Folder of one kind of files, of this user, under XDG_CACHE_HOME."""
    configured = os.environ.get("XDG_CACHE_HOME", "")
    # The XDG specification ignores relative paths.
    root = Path(configured) if configured.startswith("/") else Path.home() / ".cache"
    return root / "catoptra" / kind


@dataclass(frozen=True, slots=True)
class ArrayCache:
    """Arrays by key in one folder.

    Fields:
        folder: Folder of the files, created at the first write; None for no cache.
        max_bytes: Largest sum of the sizes of the folder's files.
    """

    folder: Path | None
    max_bytes: int = MAX_FOLDER_BYTES

    def read(self, key: str, count: int) -> tuple[NDArray[Any], ...] | None:
        """Read-only arrays under a key; None where they are absent or damaged.

        What the arrays mean (shapes, types, indices) is for the caller to check.
        """
        if self.folder is None:
            return None
        file = self.folder / f"{key}{_SUFFIX}"
        try:
            # A larger file was not written here.
            with file.open("rb") as opened:
                content = opened.read(self.max_bytes // 2 + 1)
            body = memoryview(content)[_DIGEST_BYTES:]
            if hashlib.sha256(body).digest() != content[:_DIGEST_BYTES]:
                raise ValueError("its digest differs")
            # NumPy's own format has a header in Python, which CPython up to 3.11.7 and 3.12.1 may
            # fail to parse in two threads at once (gh-106905).
            header_bytes = content.index(b"\n", _DIGEST_BYTES) + 1
            arrays, start = [], header_bytes
            for data_type, shape in json.loads(content[_DIGEST_BYTES:header_bytes]):
                # A copy, because what it is in need not lie on a multiple of its elements' size.
                arrays.append(np.ndarray(shape, data_type, content, start).copy())
                arrays[-1].setflags(write=False)
                start += arrays[-1].nbytes
            if len(arrays) != count:
                raise ValueError(f"{len(arrays)} arrays instead of {count}")
        # Absent; or not readable, of which the next write warns if it fails, too.
        except OSError:
            return None
        # Whatever is wrong with the form: NumPy raises any of these.
        except (ValueError, TypeError) as error:
            _warn(file, f"{file} cannot be used, and is computed anew: {error}")
            return None
        # The order in which files are removed; where it cannot be written, nothing is removed.
        with suppress(OSError):
            os.utime(file)
        return tuple(arrays)

    def write(self, key: str, arrays: Sequence[NDArray[Any]]) -> None:
        """Store arrays under a key, atomically, and remove the oldest files beyond the limit."""
        if self.folder is None:
            return
        header = json.dumps([(array.dtype.str, array.shape) for array in arrays]).encode() + b"\n"
        body = b"".join((header, *(array.tobytes() for array in arrays)))
        if _DIGEST_BYTES + len(body) <= self.max_bytes // 2:
            file = self.folder / f"{key}{_SUFFIX}"
            write_cache_file(file, hashlib.sha256(body).digest() + body)
            self._remove_oldest(file)

    def _remove_oldest(self, newest: Path) -> None:
        """Remove files, in the order of their last use, until the rest is within the limit."""
        # Another process may remove the same file.
        with suppress(OSError):
            stats = [(file.stat(), file) for file in newest.parent.iterdir() if file != newest]
            total = newest.stat().st_size + sum(stat.st_size for stat, _ in stats)
            for stat, file in sorted(stats, key=lambda pair: (pair[0].st_mtime_ns, pair[1])):
                if total <= self.max_bytes:
                    return
                file.unlink(missing_ok=True)
                total -= stat.st_size


def write_cache_file(file: Path, content: bytes) -> None:
    """Write a file and its folder, atomically; one warning where the folder cannot be written."""
    # A file of the process's own, then renamed: another server never reads half a file.
    unfinished = file.with_suffix(f".{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_bytes(content)
        unfinished.replace(file)
    except OSError as error:
        _warn(file.parent, f"{file.parent.name} cannot be stored in {file.parent}: {error}")


@cache
def _warn(place: Path, message: str) -> None:
    """Log a warning, once for each place and message."""
    log.warning("%s", message)
