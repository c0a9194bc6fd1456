"""A folder for the private socket of a server, and removal of those that killed servers left.

A lock file inside is locked while its server lives: the system releases the lock with the process,
however it ends.
"""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

log = logging.getLogger(__name__)

_PREFIX = "catoptra-"
_LOCK_NAME = "lock"
SOCKET_NAME = "stream"
# All that a server puts there; a folder with other contents is none of ours.
_CONTENTS = {_LOCK_NAME, SOCKET_NAME}


@contextmanager
def create_private_folder() -> Iterator[Path]:
    """A new folder that only this user can open, until the block ends; sweeps old ones before.

    Raises:
        OSError: The folder for temporary files is not writable.
    """
    _remove_abandoned_folders(Path(tempfile.gettempdir()))
    # mkdtemp sets mode 0700: no other user can bypass the guard.
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    try:
        with _create_lock(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _create_lock(folder: Path) -> Iterator[None]:
    # Locked before it has its name: another server that starts now sees no lock that is free.
    unnamed = folder / (_LOCK_NAME + ".new")
    with unnamed.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        unnamed.rename(folder / _LOCK_NAME)
        yield


def _remove_abandoned_folders(parent: Path) -> None:
    """Remove the folders of servers that were killed."""
    try:
        candidates = list(parent.glob(_PREFIX + "*"))
    except OSError:
        return
    for folder in candidates:
        # Another server may remove the same folder at the same time.
        with suppress(OSError):
            if _is_own_folder(folder) and _has_no_server(folder):
                shutil.rmtree(folder)
                log.info("removed %s, which a killed server left", folder)


def _is_own_folder(folder: Path) -> bool:
    """Whether a folder is one that a server of this user made, without following links."""
    status = folder.lstat()
    return (
        stat.S_ISDIR(status.st_mode)
        and status.st_uid == os.getuid()
        and stat.S_IMODE(status.st_mode) == 0o700
        and {entry.name for entry in folder.iterdir()} <= _CONTENTS
    )


def _has_no_server(folder: Path) -> bool:
    """Whether no living server holds the lock of a folder; False for one without a lock yet."""
    try:
        lock = os.open(folder / _LOCK_NAME, os.O_RDONLY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(lock)
    return True
