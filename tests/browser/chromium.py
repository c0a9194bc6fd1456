"""Headless Chromium as a child process with a profile of its own, killed as a group."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from browser.devtools import DevTools, DevToolsError, connect_devtools, wait_until

INSTALL_HINT = (
    "the tests of the live page need Chromium, and {browser!r} is not installed: "
    "apt-get install chromium, or make browser-test BROWSER=/path/to/chromium"
)
_START_LIMIT_S = 30.0
_END_LIMIT_S = 5.0
_FLAGS = (
    "--headless=new",
    # Containers give no user namespaces; the only pages are those of the tests' own server.
    "--no-sandbox",
    # As on a machine without a GPU: the page is composed by the processor, WebGL by SwiftShader.
    # With --use-angle=swiftshader SwiftShader composes too, at 30 instead of 60 frames a second
    # of two plain canvases.
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
    # No request of the browser's own leaves the machine, and none of a page would succeed.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--no-first-run",
    "--mute-audio",
    "--force-device-scale-factor=1",
    "--window-size=1280,900",
)


@dataclass(frozen=True, slots=True)
class Browser:
    """A browser that runs, and its DevTools connection."""

    process: subprocess.Popen[bytes]
    devtools: DevTools
    downloads: Path
    """Folder of downloaded files."""

    @property
    def version(self) -> str:
        """Product and release."""
        return str(self.devtools.call("Browser.getVersion")["product"])

    def kill(self) -> None:
        """End all processes of the browser by SIGKILL, as a crash does."""
        _kill_group(self.process)
        self.process.wait(_END_LIMIT_S)


def is_installed(executable: str) -> bool:
    """Whether an executable exists, by name or path."""
    return shutil.which(executable) is not None


@contextmanager
def start_browser(executable: str) -> Iterator[Browser]:
    """Run Chromium for the length of a block; nothing of it remains."""
    # Not pytest's folder: a profile has a hundred files, and pytest keeps those of three runs.
    with tempfile.TemporaryDirectory(
        prefix="catoptra-browser-", ignore_cleanup_errors=True
    ) as folder:
        profile = Path(folder)
        downloads = profile / "downloads"
        downloads.mkdir()
        command = [executable, *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            # Chromium's complaints of a missing D-Bus say nothing about a page.
            stderr=subprocess.DEVNULL,
            process_group=0,
        )
        try:
            with connect_devtools(_wait_for_address(profile, process)) as devtools:
                devtools.call(
                    "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(downloads)
                )
                yield Browser(process, devtools, downloads)
                _close(process, devtools)
        finally:
            _kill_group(process)
            process.wait(_START_LIMIT_S)


def _wait_for_address(profile: Path, process: subprocess.Popen[bytes]) -> str:
    """Address of the DevTools socket, from the file that Chromium writes once it listens."""
    path = profile / "DevToolsActivePort"

    def read_lines() -> list[str]:
        assert process.poll() is None, f"Chromium ended with status {process.returncode}"
        lines = path.read_text(encoding="utf-8").split() if path.exists() else []
        return lines if len(lines) == 2 else []

    port, tail = wait_until(read_lines, "DevTools port of Chromium", _START_LIMIT_S)
    return f"ws://127.0.0.1:{port}{tail}"


def _close(process: subprocess.Popen[bytes], devtools: DevTools) -> None:
    """End the browser, which then waits for its own children: a kill alone leaves zombies."""
    if process.poll() is None:
        with contextlib.suppress(DevToolsError, subprocess.TimeoutExpired):
            devtools.call("Browser.close")
            process.wait(_END_LIMIT_S)


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
