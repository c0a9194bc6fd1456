"""The list of names, each described and usable; the line of --version."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest

from catoptra_server.commands import list as list_module
from catoptra_server.commands.list import describe_version, main
from catoptra_server.config.known_names import FileKind, find_configuration
from catoptra_server.config.robot_file import read_robots
from catoptra_server.render.trace.kernel.library import LIBRARY_OF_INSTRUCTION_SET
from helpers.trace_kernels import open_kernel
from helpers.worlds import make_test_world

KINDS = ["robots", "worlds", "cameras", "landmarks", "datasets", "classes"]
ListEntries = Callable[[str], list[dict[str, str]]]


@pytest.fixture
def list_entries(capsys: pytest.CaptureFixture[str]) -> ListEntries:
    """Entries of a kind, as the command prints them for programs."""

    def entries(kind: str) -> list[dict[str, str]]:
        assert main([kind, "--json"]) == 0
        found: list[dict[str, str]] = json.loads(capsys.readouterr().out)
        return found

    return entries


@pytest.mark.parametrize("kind", KINDS)
def test_entry_of_each_kind_has_a_description_and_a_file(
    list_entries: ListEntries, kind: str
) -> None:
    entries = list_entries(kind)
    assert entries
    for entry in entries:
        assert entry["kind"] == kind
        assert entry["description"]
        assert Path(entry["path"]).is_file()


@pytest.mark.parametrize("kind", ["robots", "worlds"])
def test_name_that_is_listed_is_found_by_the_server(
    list_entries: ListEntries, kind: FileKind
) -> None:
    for entry in list_entries(kind):
        assert find_configuration(kind, entry["name"]) == Path(entry["path"])


def test_class_is_listed_with_every_file_that_serves_it(list_entries: ListEntries) -> None:
    listed = {(entry["name"], entry["path"]) for entry in list_entries("classes")}
    served = {
        (robot.class_name, entry["path"])
        for entry in list_entries("robots")
        for robot in read_robots(Path(entry["path"]))[0]
    }
    assert listed == served


def test_class_is_described_by_cameras_and_sensors(list_entries: ListEntries) -> None:
    described = {entry["description"] for entry in list_entries("classes")}
    assert (
        "--robot p2at_omni: mirror camera OmniCamPillar_Link4 360 x 360 px, Odometry, GroundTruth"
        in described
    )


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("; A robot, in the manner of USARBot.ini: with\n; a mirror. Metres.\n[X]\n",
         "A robot, in the manner of USARBot.ini: with a mirror."),
        ("# Landmarks of a field. World frame\nname,kind\n", "Landmarks of a field."),
        ("; No full stop\n\n; another comment\n", "No full stop"),
        ("[X]\n; later\n", ""),
    ],
)  # fmt: skip
def test_first_sentence_is_that_of_the_comment_at_the_head(
    list_entries: ListEntries,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    content: str,
    sentence: str,
) -> None:
    path = tmp_path / "file.ini"
    path.write_text(content)
    monkeypatch.setattr(list_module, "bundled_files", lambda kind: [path])
    assert [entry["description"] for entry in list_entries("worlds")] == [sentence]


def test_list_prints_a_heading_for_each_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.rstrip(":") for line in lines if not line.startswith(" ")] == KINDS


def test_version_with_a_kernel_names_the_instruction_set() -> None:
    with open_kernel(make_test_world()):
        line = describe_version()
    assert line.startswith(f"catoptra-server {metadata.version('catoptra-server')} (Python 3.")
    assert line.rpartition("kernel: ")[2].rstrip(")") in LIBRARY_OF_INSTRUCTION_SET


def test_version_without_a_kernel_has_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", "off")
    line = describe_version()
    assert "no native kernel: CATOPTRA_KERNEL=off" in line
    assert "\n" not in line
