"""Ctrl-C while libraries are loaded, and processes are spawned."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

INTERRUPTED = """
import os, signal, sys
from catoptra_protocol.command_line import run_program
# Jobs in the background inherit that it is ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
def load(name):
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:
        print("a library has caught it", file=sys.stderr)
sys.exit(run_program("catoptra-client", {"walk": "walk"}, load, ["walk"]))
"""


def test_interrupt_while_libraries_load_ends_at_once_with_one_line() -> None:
    command = [sys.executable, "-c", INTERRUPTED]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (130, "catoptra-client: interrupted\n")


# The group of processes is interrupted as soon as the child exists: it has loaded nothing.
SPAWNED = """
import multiprocessing, os, signal, sys
from catoptra_protocol.interrupts import start_without_interrupts
if __name__ == "__main__":
    signal.signal(signal.SIGINT, lambda *_: None)
    process = multiprocessing.get_context("spawn").Process(target=print, args=("whole",))
    with start_without_interrupts():
        process.start()
    os.killpg(0, signal.SIGINT)
    process.join()
"""


def test_interrupt_does_not_reach_a_process_that_is_being_spawned(tmp_path: Path) -> None:
    script = tmp_path / "spawn.py"
    script.write_text(SPAWNED)
    ended = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        check=False,
        start_new_session=True,
    )
    assert (ended.stdout, ended.stderr) == ("whole\n", "")
    assert ended.returncode != -signal.SIGINT
