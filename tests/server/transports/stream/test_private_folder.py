"""Folders of living and of killed servers."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_server.serve.stream.router import create_private_folder

# Prints the folder and waits, as a server does; a socket file stays behind when it is killed.
OTHER_SERVER = """
import signal
from catoptra_server.serve.stream.router import create_private_folder
with create_private_folder() as folder:
    (folder / "stream").touch()
    print(folder, flush=True)
    signal.pause()
"""


@pytest.fixture(autouse=True)
def temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Folder for temporary files of this process and of its children."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def start_other_server() -> tuple[subprocess.Popen[str], Path]:
    process = subprocess.Popen(
        [sys.executable, "-c", OTHER_SERVER], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


def test_folder_is_of_this_user_alone_and_removed_at_the_end(temporary_folder: Path) -> None:
    with create_private_folder() as folder:
        assert folder.parent == temporary_folder
        assert folder.stat().st_mode & 0o077 == 0
        (folder / "stream").touch()
    assert list(temporary_folder.iterdir()) == []


def test_folder_of_a_killed_server_is_removed_and_of_a_living_one_stays() -> None:
    killed, killed_folder = start_other_server()
    living, living_folder = start_other_server()
    with killed, living:
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert killed_folder.exists()
        with create_private_folder() as own, create_private_folder() as second:
            assert own.exists()
            assert second.exists()
            assert living_folder.exists()
            assert not killed_folder.exists()
        living.kill()


def test_folders_that_no_server_made_stay(temporary_folder: Path) -> None:
    def make(name: str, *files: str, mode: int = 0o700) -> Path:
        folder = temporary_folder / name
        folder.mkdir(mode=mode)
        for file in files:
            (folder / file).touch()
        return folder

    others = [
        make("catoptra-cache", "lock", "results.json"),
        make("catoptra-shared", "lock", mode=0o755),
        make("catoptra-starting"),  # of a server that has no lock yet
        make("other-server", "lock", "stream"),
    ]
    (temporary_folder / "catoptra-file").touch()
    link = temporary_folder / "catoptra-link"
    link.symlink_to(make("target", "lock"))
    with create_private_folder():
        pass
    assert all(folder.exists() for folder in (*others, link, temporary_folder / "target/lock"))
    assert (temporary_folder / "catoptra-file").exists()
    # The form of a folder that is swept, so that the others stay for the reasons above.
    swept = make("catoptra-swept", "lock", "stream")
    with create_private_folder():
        assert not swept.exists()
