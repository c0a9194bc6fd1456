"""Code blocks and commands of the Markdown documents."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from helpers.configs import REPOSITORY

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_SPAN = re.compile(r"`([^`\n]+)`")
_PROGRAM = re.compile(r"(?:\S*/)?(catoptra-(?:server|client|studies))$")
_OTHER_PROGRAMS = ("make", "docker", ".venv/bin/python")
_OPTION = re.compile(r"--[a-z][a-z-]*")
_VARIABLE = re.compile(r"([A-Z]+)=")


def read_blocks(path: Path, language: str) -> list[str]:
    """Fenced code blocks of a document in one language, in order."""
    text = path.read_text(encoding="utf-8")
    return [block for name, block in _BLOCK.findall(text) if name == language]


def find_commands(text: str) -> Iterator[list[str]]:
    """Words of each command of this project: lines of shell blocks, and code between backticks."""
    lines = [
        line for name, block in _BLOCK.findall(text) if name == "sh" for line in block.split("\n")
    ]
    for code in (*lines, *_SPAN.findall(_BLOCK.sub("", text))):
        # Brackets and ellipses stand for what a reader chooses.
        words = shlex.split(re.sub(r"[\[\]|]|\.\.\.", " ", code.replace("'", "")), comments=True)
        if words and (words[0] in _OTHER_PROGRAMS or _PROGRAM.match(words[0])):
            yield words


def find_command_faults(words: list[str]) -> list[str]:
    """Targets, variables, options and files of the repository that a command names in vain."""
    files = (word for word in words[1:] if word.startswith(("configs/", "docker/", "examples/")))
    faults = [f"no file {file}" for file in files if not (REPOSITORY / file).is_file()]
    if words[0] == "make":
        return faults + _find_make_faults(words[1:])
    if program := _PROGRAM.match(words[0]):
        known = set(_OPTION.findall(read_help(program[1], *words[1:2])))
        faults += [f"{shlex.join(words)}: no {word}" for word in words if _is_unknown(word, known)]
    return faults


def find_option_faults(text: str) -> list[str]:
    """Options between backticks that no program of this project has."""
    options = {code.split()[0] for code in _SPAN.findall(text) if code.startswith("--")}
    return sorted(options - _read_all_options())


def _is_unknown(word: str, known: set[str]) -> bool:
    return word.startswith("--") and word.partition("=")[0] not in known


def _find_make_faults(words: list[str]) -> list[str]:
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    faults = []
    for word in words:
        variable = _VARIABLE.match(word)
        if variable and not re.search(rf"\$\({variable[1]}\)", makefile):
            faults.append(f"make {' '.join(words)}: no recipe reads {variable[1]}")
        if not variable and not re.search(rf"^{re.escape(word)}:", makefile, re.MULTILINE):
            faults.append(f"make {' '.join(words)}: no target {word}")
    return faults


@cache
def read_help(program: str, *words: str) -> str:
    """Help of a program, or of its subcommand if the first word names one."""
    module = __import__(f"catoptra_{program.partition('-')[2]}.__main__", fromlist=["main"])
    output = io.StringIO()
    subcommand = [word for word in words[:1] if re.fullmatch(r"[a-z0-9]+", word)]
    with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
        module.main([*subcommand, "--help"])
    return output.getvalue()


@cache
def _read_all_options() -> set[str]:
    subcommands = {
        "catoptra-server": ("", "explain", "doctor", "dataset", "calibration", "import", "map"),
        "catoptra-client": (
            "",
            "snapshot",
            "train",
            "bearings",
            "calibration",
            "record",
            "replay",
            "ros2",
        ),
        "catoptra-studies": (
            "demo",
            "seeds",
            "live",
            "cost",
            "effects",
            "figures",
            "cameras",
            "compare",
        ),
    }
    return {
        option
        for program, names in subcommands.items()
        for name in names
        for option in _OPTION.findall(read_help(program, *([name] if name else [])))
    }
