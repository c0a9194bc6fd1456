"""Commands that the documents name exist, with their options, targets and variables."""

from __future__ import annotations

import subprocess

import pytest

from helpers.configs import REPOSITORY
from helpers.documents import find_command_faults, find_commands, find_option_faults

# Not the change log, which names what is gone.
DOCUMENTS = (
    "README.md",
    "client/README.md",
    "configs/README.md",
    "docs/EFFECTS.md",
    "ARCHITECTURE.md",
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
        *("make", "docker", "catoptra-server", "catoptra-client", "catoptra-studies")
    }


@pytest.mark.parametrize(
    "text",
    [
        "```sh\nmake nothing\n```\n",
        "runs with `make demo SPEED=3`",
        "```sh\n.venv/bin/catoptra-server --robots a.ini  # serves\n```\n",
        "`catoptra-studies cost --page a.md` writes",
        "with `--no-such-option 3`",
        "```sh\ndocker compose -f docker/no.yaml up\n```\n",
    ],
)
def test_command_that_does_not_exist_is_found(text: str) -> None:
    faults = [fault for words in find_commands(text) for fault in find_command_faults(words)]
    assert faults + find_option_faults(text)


@pytest.mark.parametrize(
    ("target", "tracked"), [("cost", "README.md"), ("cost", "COST.md"), ("effects", "EFFECTS.md")]
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
