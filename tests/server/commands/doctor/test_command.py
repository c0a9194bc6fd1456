"""The doctor as a whole: each kind of fault is found, and sets the exit status."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import pytest

from catoptra_server.commands.doctor import command, devices
from catoptra_server.commands.doctor.command import main
from catoptra_server.commands.doctor.machine import ok
from helpers.configs import OMNI_ROBOT, Edit, write_edited_copy
from helpers.opengl import device_or_skip

FREE_PORTS = ("--control-port", "0", "--image-port", "0", "--stream-port", "0", "--view", "0")
# One renderer and one file: the slow checks run in one test only.
FAST_CHECKS = (*FREE_PORTS, "--renderer", "trace", "--robot", "p2at_omni")


def run_doctor(
    capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[int, list[dict[str, Any]]]:
    """Exit status, and the findings that are problems."""
    status = main([*arguments, "--json"])
    document = json.loads(capsys.readouterr().out)
    assert document["status"] == status
    problems = [f for f in document["findings"] if f["level"] != "ok"]
    assert all(f["remedy"] and "\n" not in f["message"] + f["remedy"] for f in problems)
    return status, [f for f in problems if f["topic"] != "threads"]


def test_machine_when_raster_and_trace_run_has_no_problem(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    device_or_skip().close()
    monkeypatch.setattr(devices, "_TIMEOUT_S", 600.0)  # llvmpipe on a busy machine
    assert run_doctor(capsys, *FREE_PORTS, "--world", "corridor")[1] == []


def test_lines_when_printed_end_with_a_summary(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(FAST_CHECKS) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("ok       python: 3.")
    assert lines[-1].startswith("catoptra-server can start (faults: 0")


def test_opengl_when_its_library_is_broken_is_found(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "libEGL.so.1").touch()
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    status, (found,) = run_doctor(capsys, *FREE_PORTS, "--renderer", "raster", "--robot", "p2at")
    assert status == 1
    assert "libEGL.so.1 cannot be loaded" in found["message"]
    assert "libegl1" in found["remedy"]


def test_file_when_broken_is_found(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("C=2.321", "C=two"))
    status, (found,) = run_doctor(capsys, *FREE_PORTS, "--renderer", "trace", "--robot", str(path))
    assert status == 1
    assert "C='two'" in found["message"]


def test_name_when_no_file_has_it_is_found(capsys: pytest.CaptureFixture[str]) -> None:
    status, (found,) = run_doctor(
        capsys, *FREE_PORTS, "--renderer", "trace", "--robot", "p2at_omin"
    )
    assert status == 1
    assert "p2at_omni" in found["message"]


def test_faults_of_a_port_a_package_and_a_library_are_all_found(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "numpy-1.26.4.dist-info").mkdir()
    metadata = "Metadata-Version: 2.1\nName: numpy\nVersion: 1.26.4\n"
    (tmp_path / "numpy-1.26.4.dist-info/METADATA").write_text(metadata)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "numpy").mkdir()
    (tmp_path / "numpy/__init__.py").write_text("raise ImportError('numpy is broken')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        status, found = run_doctor(capsys, *FAST_CHECKS, "--control-port", port)
    assert status == 1
    messages = [one["message"] for one in found]
    assert sum("numpy is 1.26.4, numpy>=2.0 is required" in message for message in messages) == 1
    assert "the trace renderer cannot run: numpy is broken" in messages
    assert [one["topic"] for one in found].count("ports") == 1
    assert len(found) == 4


def test_server_when_none_replies_is_a_fault(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = str(unused.getsockname()[1])
        options = ("--probe", "127.0.0.1", "--control-port", port, "--image-port", port)
        status, found = run_doctor(capsys, *options)
    assert (status, [f["topic"] for f in found]) == (1, ["control", "image"])


def test_probe_looks_at_the_ports_that_are_named_and_says_whether_a_server_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = str(unused.getsockname()[1])
        options = ("--probe", "127.0.0.1", "--control-port", port, "--image-port", port)
        _, found = run_doctor(capsys, *options, "--stream-port", port, "--view", port)
        assert main(options) == 1
    assert [one["topic"] for one in found] == ["control", "image", "stream", "live page"]
    *findings, summary = capsys.readouterr().out.splitlines()
    assert len(findings) == 2
    assert summary.startswith("catoptra-server does not run on all these ports of 127.0.0.1")


def test_probe_when_all_ports_answer_says_that_the_server_runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [ok("control", "a server answers")]
    monkeypatch.setattr(command, "check_running_server", lambda *_: found)
    assert main(["--probe", "127.0.0.1"]) == 0
    assert "catoptra-server runs on 127.0.0.1 (faults: 0" in capsys.readouterr().out


def test_port_when_out_of_range_is_rejected() -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--control-port", "65536"])
