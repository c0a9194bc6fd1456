"""Commands that the documents name exist, with their options, targets and variables."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from catoptra_server.config.robot_file import read_robot
from catoptra_studies.accuracy_cost.cost_report import format_cost_report, format_summary_table
from catoptra_studies.accuracy_cost.cost_results import read_cost_results
from helpers.configs import OMNI_ROBOT, REPOSITORY
from helpers.documents import find_command_faults, find_commands, find_option_faults, read_blocks

DOCUMENTS = (
    "README.md",
    "client/README.md",
    "configs/README.md",
    "docs/EFFECTS.md",
    "docs/MODELS.md",
    "docs/data-sets.md",
    "docs/environment.md",
    "docs/measured.md",
    "docs/real-mirror.md",
    "docs/server.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "protocol/SPEC.md",
    "server/COST.md",
)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_commands_of_a_document_exist(document: str) -> None:
    text = (REPOSITORY / document).read_text(encoding="utf-8")
    faults = [fault for words in find_commands(text) for fault in find_command_faults(words)]
    assert faults + find_option_faults(text) == []


def test_documents_have_commands_of_every_program() -> None:
    text = "".join((REPOSITORY / document).read_text(encoding="utf-8") for document in DOCUMENTS)
    programs = {words[0].rpartition("/")[2] for words in find_commands(text)}
    assert programs == {
        *("make", "docker", "python", "catoptra-server", "catoptra-client", "catoptra-studies")
    }


@pytest.mark.parametrize(
    "text",
    [
        "```sh\nmake nothing\n```\n",
        "runs with `make demo SPEED=3`",
        "```sh\n.venv/bin/catoptra-server --robots a.ini  # serves\n```\n",
        "`catoptra-studies cost --pages a.md` writes",
        "with `--no-such-option 3`",
        "drawn by `.venv/bin/python examples/no.py`",
        "```sh\ndocker compose -f docker/no.yaml up\n```\n",
    ],
)
def test_command_that_does_not_exist_is_found(text: str) -> None:
    faults = [fault for words in find_commands(text) for fault in find_command_faults(words)]
    assert faults + find_option_faults(text)


def test_ini_block_of_the_effects_page_is_a_part_of_a_robot_file(tmp_path: Path) -> None:
    (block,) = read_blocks(REPOSITORY / "docs/EFFECTS.md", "ini")
    path = tmp_path / "robot.ini"
    path.write_text(f"[Configuration]\nBasedOn={OMNI_ROBOT}\n{block}", encoding="utf-8")
    robot, file = read_robot(path)
    plain, _ = read_robot(OMNI_ROBOT)
    assert robot.omni_camera is not None
    assert plain.omni_camera is not None
    assert robot.omni_camera.effects != plain.omni_camera.effects
    unknown = {entry.key for entry in file.unknown_names()}
    assert unknown.isdisjoint(re.findall(r"^(\w+)=", block, re.MULTILINE))


@pytest.mark.parametrize(
    ("target", "tracked"),
    [
        *(("cost", name) for name in ("README.md", "COST.md", "cost.json")),
        *(("effects", "EFFECTS.md"), ("ramps", "measured.md")),
    ],
)
def test_target_names_a_tracked_file_with_update_alone(target: str, tracked: str) -> None:
    for update, expected in (((), False), (("UPDATE=no",), False), (("UPDATE=yes",), True)):
        recipe = subprocess.run(
            ["make", "--dry-run", "--assume-old=.venv/.ready", target, *update],
            cwd=REPOSITORY,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert f"out/{target}" in recipe
        assert (tracked in recipe) is expected


# Written by `make cost UPDATE=yes`: tables by hand would state what nobody measured.
def test_cost_report_and_table_are_those_of_the_measured_numbers() -> None:
    results = read_cost_results(REPOSITORY / "server/cost.json")
    report = (REPOSITORY / "server/COST.md").read_text(encoding="utf-8")
    assert report == format_cost_report(results)
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    block = readme.partition("<!-- cost: begin")[2].partition("-->\n")[2]
    assert block.partition("\n<!-- cost: end -->")[0] == format_summary_table(results)


def _table_rows(path: Path, head: str) -> list[list[str]]:
    """Cells of the rows of the tables whose first cell of the head is given."""
    tables = re.findall(
        rf"^\| {head}[^\n]*\n\|[-| :]+\n((?:\|.*\n)+)", path.read_text("utf-8"), re.M
    )
    return [
        [cell.strip() for cell in row.strip("|").split("|")]
        for table in tables
        for row in table.splitlines()
    ]


def test_measured_properties_of_the_readme_are_those_of_docs_measured() -> None:
    measured = (REPOSITORY / "docs/measured.md").read_text(encoding="utf-8")
    known = set(re.findall(r"\d+(?:\.\d+)?", measured))
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    rows = readme.partition("| claim | measured |\n|---|---|\n")[2].partition("\n\n")[0]
    faults = {
        row: unknown
        for row in rows.splitlines()
        if (unknown := set(re.findall(r"\d+(?:\.\d+)?", row)) - known)
    }
    assert rows
    assert faults == {}
