"""One command line for all programs: one word for a meaning, every default stated, 40 mistakes."""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache

import pytest

from catoptra_client.__main__ import COMMANDS as CLIENT_COMMANDS
from catoptra_client.__main__ import main as run_client
from catoptra_protocol.command_line import CommandParser
from catoptra_server.__main__ import main as run_server
from catoptra_server.commands import COMMANDS as SERVER_COMMANDS
from catoptra_studies.cli import COMMANDS as STUDIES_COMMANDS
from catoptra_studies.cli import main as run_studies

PROGRAMS: dict[str, Callable[[Sequence[str]], int]] = {
    "server": run_server,
    "client": run_client,
    "studies": run_studies,
}
COMMANDS = [
    *(("server", command) for command in SERVER_COMMANDS),
    *(("client", command) for command in CLIENT_COMMANDS),
    *(("studies", command) for command in STUDIES_COMMANDS),
]
# A new option has a line here: its meaning is none of the others'.
MEANINGS = {
    "--help": "print the help",
    "--version": "print the version",
    "--out": "where to write",
    # Which robot, and what is looked at
    "--robot": "robot: a file where it is described, a class where spawned, a name where served",
    "--world": "world file",
    "--landmarks": "file of landmarks",
    "--camera": "camera by its name",
    "--camera-file": "camera file",
    "--cameras": "camera files",
    "--board": "inner corners of a chessboard",
    "--square": "side of a chessboard's square",
    "--configs": "folder of configurations",
    "--models": "folders of models",
    "--rings-world": "world of the figure of rings",
    "--rooms-world": "world of rooms",
    "--server-ini": "ini of UDK's server",
    "--classifier": "trained classifier",
    "--spawn": "spawn a robot for the command's time",
    "--start": "start pose by its tag",
    "--pose": "pose by numbers",
    "--velocity": "velocity of the robot",
    # Where the server is
    "--host": "host of the server",
    "--control-port": "control port",
    "--image-port": "image port",
    "--stream-port": "port of the stream",
    "--view": "port of the live page",
    "--no-view": "no live page",
    "--server": "running server of a set-up",
    "--probe": "host of a running server to check",
    "--ray": "cluster of Ray",
    # What the server does
    "--strict": "unknown keys are errors",
    "--image-type": "encoding of the image port",
    "--legacy-images": "frame before the first request",
    "--no-legacy-images": "none",
    "--max-connections": "limit of connections",
    "--max-per-address": "limit of connections of an address",
    "--handshake-timeout": "limit of a first command",
    "--idle-timeout": "limit of silence",
    "--frame-skip": "ticks of a frame",
    "--multi-view": "tiles of cameras",
    "--dialect": "dialect of the control port",
    "--renderer": "renderer",
    "--threads": "threads of the renderer",
    "--workers": "processes that work at the same time",
    "--max-error-px": "accuracy target",
    "--budget-ms": "time budget",
    "--memory-limit-mib": "memory limit",
    "--clock": "clock",
    "--verbose": "log of every message",
    # Pictures and files
    "--picture": "hand of the picture",
    "--panorama": "panorama",
    "--size": "pixels along a side, or width x height",
    "--to": "format to convert to",
    "--field-of-view": "widest angle of a converted calibration",
    "--max-residual-px": "largest difference of a calibration",
    "--verify": "read back",
    "--sheet": "contact sheet",
    "--repair": "damaged recording",
    "--serve": "show a recording as a server",
    "--speed": "simulated seconds a second",
    "--resimulate": "recorded commands again",
    "--rerender": "recorded poses through another camera",
    "--robot-file": "file of another robot than the recorded one",
    "--files": "folder of recorded files",
    "--channels": "channels of ground truth",
    "--views": "pinhole pictures",
    "--duration": "time of a recording",
    "--hz": "frames a second",
    "--json": "JSON instead of lines",
    # Extent of a study
    "--seed": "seed of random numbers",
    "--seeds": "number of seeds",
    "--runs": "number of drives",
    "--laps": "number of laps",
    "--frames": "number of frames",
    "--training-frames": "number of frames of the classifier's training",
    "--places": "number of places",
    "--theta": "threshold of the classifier",
    "--timeout": "longest wait of the command",
    "--setup": "set-ups of the experiment",
    "--figures": "who draws the figures of the camera",
    "--quick": "smaller extent",
    "--only": "one part",
    "--sweep": "one sweep",
    "--drives": "with drives",
    "--no-drives": "without drives",
    "--machine": "remark about the machine",
    # Further results
    "--page": "file whose block gets a table",
    "--report": "report to write",
    "--fitted": "camera file to write",
    "--effects": "effects to force on",
    "--data": "copy of the numbers",
    "--report-only": "measure nothing",
    "--frame-rates-only": "measure frame rates alone",
}
OLD_WORDS = {
    ("client", "train"): {"--output": "--out", "--frames": "--training-frames"},
    ("client", "bearings"): {"--robot-class": "--robot"},
    ("studies", "cost"): {"--output": "--out", "--readme": "--page"},
    ("studies", "seeds"): {"--output": "--out", "--processes": "--workers"},
    ("studies", "demo"): {"--output": "--out"},
    ("studies", "figures"): {"--output": "--out"},
}
# What stands for a value; elsewhere a word has one.
METAVARS = {
    "--robot": {"FILE", "CLASS", "NAME"},
    "--out": {"DIR", "FILE", "FILE.ini", "PLAN.png"},
    "--size": {"PX", "WxH"},
}


class _FoundError(Exception):
    """Carries the parser out of a command."""


@cache
def find_parser(program: str, command: str) -> CommandParser:
    """Parser of a command, as that command makes it."""

    def stop(parser: CommandParser, _: object = None) -> argparse.Namespace:
        raise _FoundError(parser)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CommandParser, "parse_args", stop)
        with pytest.raises(_FoundError) as found:
            PROGRAMS[program]([command])
    parser = found.value.args[0]
    assert isinstance(parser, CommandParser)
    return parser


def list_options(program: str, command: str) -> list[argparse.Action]:
    return [action for action in find_parser(program, command)._actions if action.option_strings]


def test_each_meaning_has_one_word_and_each_word_a_meaning() -> None:
    used = {
        word
        for command in COMMANDS
        for action in list_options(*command)
        for word in action.option_strings
        if word.startswith("--")
    }
    assert used == set(MEANINGS)
    assert len(set(MEANINGS.values())) == len(MEANINGS)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_option_has_help_and_states_its_default(command: tuple[str, str]) -> None:
    lines = " ".join(find_parser(*command).format_help().split())
    for action in list_options(*command):
        word = action.option_strings[-1]
        assert action.help, word
        value = action.default
        if action.nargs != 0 and value is not None and value not in ("", []):
            _, _, text = lines.partition(f" {word} {action.metavar or ''}".rstrip())
            assert "(default: " in text.partition(" --")[0], word


def test_word_stands_for_the_same_in_every_command() -> None:
    metavars: dict[str, set[str]] = {}
    for command in COMMANDS:
        for action in list_options(*command):
            if action.nargs != 0 and action.choices is None:
                metavars.setdefault(action.option_strings[0], set()).add(str(action.metavar))
    several = {word: found for word, found in metavars.items() if len(found) > 1}
    assert several == METAVARS


@pytest.mark.parametrize("command", OLD_WORDS, ids=" ".join)
def test_word_of_an_earlier_release_is_read_and_not_listed(command: tuple[str, str]) -> None:
    parser = find_parser(*command)
    for old, new in OLD_WORDS[command].items():
        assert parser._option_string_actions[old].option_strings[-1] == new
        assert f"{old} " not in parser.format_help()


def test_values_in_the_form_of_an_earlier_release_are_read() -> None:
    figures, snapshot = find_parser("studies", "figures"), find_parser("client", "snapshot")
    new = figures.parse_args(["--pose", "-1,2,0.5"]).pose
    old = figures.parse_args(["--pose", "-1", "2", str(math.degrees(0.5))]).pose
    assert (new.x_m, new.y_m, new.yaw_rad) == (-1.0, 2.0, 0.5)
    assert (old.x_m, old.y_m, old.yaw_rad) == pytest.approx((-1.0, 2.0, 0.5))
    for words in (["a.png"], ["--out", "a.png"]):
        assert snapshot.parse_args([*words, "--panorama"]).out == "a.png"


@pytest.mark.parametrize("program", PROGRAMS)
def test_version_of_a_program_is_one_line(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        PROGRAMS[program](["--version"])
    assert ended.value.code == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"catoptra-{program} ")


# Words, and a part of the line: the remedy. {tmp} is an empty folder.
WRONG_WORDS = [
    ("server", "explan", "did you mean explain?"),
    ("server", "--robt p2at_omni", "did you mean --robot?"),
    ("server", "serve --worl=x --bogus", "`catoptra-server --help` lists the options"),
    ("server", "", "--robot is missing: an ini file, or one of the bundled robots: kenaf"),
    ("server", "--robot p2at_omni", "--world is missing"),
    ("server", "--robot p2at_omn --world x", "did you mean p2at_omni?"),
    ("server", "--robot p2at_omni --world rescu", "did you mean rescue?"),
    ("server", "--control-port 65536", "a port is 0 to 65535, not 65536"),
    ("server", "--renderer rastr", "did you mean raster?"),
    ("server", "--clock", "expected one argument"),
    ("server", "--multi-view 2x2", "has the form 2x2:320x240"),
    ("server", "--image-type PNG", "RAW"),
    ("server", "explain --robo p2at_omni --wold rescue", "did you mean --world?"),
    ("server", "explain --robot p2at_omni", "required: --world"),
    ("server", "explain --robot p2at_omni --world rescue --pose 1,2", "three numbers X,Y,YAW"),
    ("server", "calibration --robot p2at_omni --ot x", "did you mean --out?"),
    ("server", "dataset --out {tmp}/a", "which RECIPE? A file, or one of the bundled ones: "),
    ("server", "dataset feild_tour --out {tmp}/a", "did you mean field_tour?"),
    ("server", "dataset field_tour --out {tmp}/a --workers 0", "a number of workers is 1 to"),
    ("server", "import x.sdf --out {tmp}/a.xml", "ends with .ini"),
    ("server", "map coridor --out {tmp}/a.png", "did you mean corridor?"),
    ("server", "list robot", "did you mean robots?"),
    ("server", "doctor --prob x --hots y", "did you mean --host?"),
    ("client", "", "the commands are snapshot, calibration, convert, train, bearings"),
    ("client", "snapshoot", "did you mean snapshot?"),
    ("client", "snapshot", "--out is missing: the name of a PNG or JPEG file"),
    ("client", "snapshot --out a.png --pictur fliped", "did you mean flipped?"),
    ("client", "train --output a --epochs 3", "`catoptra-client train --help` lists the options"),
    ("client", "bearings --stream-port http", "a port is an integer from 0 to 65535"),
    ("client", "--hlep", "did you mean --help?"),
    ("studies", "dmo", "did you mean demo?"),
    ("studies", "demo --out {tmp} --runs 0", "a number is 1 to 1000000"),
    ("studies", "demo --out {tmp} --server sim", "a server is NAME=HOST[:CONTROL[:IMAGE]]"),
    ("studies", "seeds --proceses 3", "did you mean --workers?"),
    ("studies", "live --view page", "a port is an integer"),
    ("studies", "cost --size 15", "a size is 16 to 4096"),
    ("studies", "effects --only page", "did you mean pages?"),
    ("studies", "cameras --cameras papr", "paper"),
    ("studies", "compare --world coridor", "did you mean corridor?"),
    ("studies", "figures --pose 1 2", "three numbers X,Y,YAW"),
]
FAILURES = [
    ("server", "explain --robot {tmp}/no.ini --world rescue", "{tmp}/no.ini: "),
    ("server", "calibration --robot p2at_omni --out {tmp} --camera Omni", "OmniCamPillar_Link4"),
    ("server", "dataset --out {tmp}/none --verify", "{tmp}/none"),
    ("server", "import {tmp}/no.sdf --out {tmp}/a.ini", "{tmp}/no.sdf"),
    ("client", "bearings --classifier {tmp}/no.npz", "{tmp}/no.npz"),
    ("client", "train --landmarks four_leged", "four_legged_2006"),
    ("studies", "seeds --out {tmp} --report-only", "no seed_*/summary.json"),
    ("studies", "cost --out {tmp} --report-only", "cost.json"),
    ("studies", "cameras --out {tmp} --world {tmp}/no.ini", "{tmp}/no.ini: "),
]


def make_words(text: str, folder: object) -> list[str]:
    return text.format(tmp=folder).split()


@pytest.mark.parametrize(("program", "text", "remedy"), WRONG_WORDS)
def test_wrong_word_is_answered_by_one_line_with_the_remedy_and_2(
    program: str,
    text: str,
    remedy: str,
    tmp_path_factory: pytest.TempPathFactory,
    capfd: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path_factory.mktemp("words")
    with pytest.raises(SystemExit) as ended:
        PROGRAMS[program](make_words(text, folder))
    assert ended.value.code == 2
    check_line(capfd.readouterr(), program, remedy)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("program", "text", "reason"), FAILURES)
def test_failure_is_one_line_with_the_reason_and_1(
    program: str,
    text: str,
    reason: str,
    tmp_path_factory: pytest.TempPathFactory,
    capfd: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path_factory.mktemp("words")
    assert PROGRAMS[program](make_words(text, folder)) == 1
    check_line(capfd.readouterr(), program, reason.format(tmp=folder))


def check_line(printed: pytest.CaptureResult[str], program: str, part: str) -> None:
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith(f"catoptra-{program}")
    assert part in line
    # argparse's own words for a wrong value have the name of a function.
    assert "invalid" not in line
    assert "parse_" not in line


@pytest.mark.parametrize(
    ("program", "words", "status"),
    [
        ("server", ["map", "coridor", "--out", "a.png"], 2),
        ("client", ["bearings", "--classifier", "no.npz"], 1),
        ("studies", ["cost", "--sise", "3"], 2),
    ],
)
def test_process_ends_as_the_function_does(program: str, words: list[str], status: int) -> None:
    command = [sys.executable, "-m", f"catoptra_{program}", *words]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (status, "")
    assert len(ended.stderr.splitlines()) == 1


def test_output_to_a_reader_that_has_left_ends_without_a_word() -> None:
    pipe = subprocess.PIPE
    command = [sys.executable, "-m", "catoptra_server", "list"]
    with subprocess.Popen(command, stdout=pipe, stderr=pipe) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 0
