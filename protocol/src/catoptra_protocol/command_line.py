"""Command lines of all programs: their words, their mistakes, their end.

A mistake is one line on standard error, with the remedy: the nearest word, the words that exist, or
the expected form. Help states every default. Words of earlier releases are still read as the
option that replaces them, and are listed nowhere. Each kind of end has one exit status:

    0        done; also help, a version, a reader of the output that has seen enough, and SIGTERM
    1        not done, or a check that failed: a file, a peer, a measurement; the reason is a line
    2        the command line is wrong: an option, a value, a name; nothing was begun
    128 + n  ended by signal n, with one line; 130 is Ctrl-C

Here argparse alone is loaded: mistakes are found before a program loads its libraries.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.interrupts import EXIT_INTERRUPTED, end_at_interrupt
from catoptra_protocol.names import list_names, suggest_name

EXIT_FAILURE, EXIT_USAGE = 1, 2
Command = Callable[[Sequence[str]], int]
"""A command: reads the words after its name, and returns its exit status."""


def run_program(
    program: str,
    commands: Mapping[str, str],
    load: Callable[[str], Command],
    words: Sequence[str] | None,
    *,
    default: str = "",
) -> int:
    """Run the command that the first word names.

    Args:
        program: Name of the program.
        commands: Names of its commands, with their help.
        load: Imports a command by its name: only that command's libraries are loaded.
        words: Words of the command line without the program; None reads `sys.argv`.
        default: Command of a line without one; the program prints its own help if there is none.

    Returns:
        The exit status of the process.

    Raises:
        SystemExit: For a wrong command line, and after a help or a version.
    """
    words = sys.argv[1:] if words is None else [*words]
    try:
        name, rest = _select_command(program, commands, words, default)
        with end_at_interrupt(program):
            command = load(name)
        status = command(rest)
        print(end="", flush=True)
        return status
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    # Expected failures only; a programming error keeps its traceback.
    except (CatoptraError, OSError) as error:
        if isinstance(error, BrokenPipeError) and _has_lost_reader():
            return 0
        print(f"{program} {name}: {_join_lines(str(error))}", file=sys.stderr)
        return EXIT_FAILURE
    finally:
        _end_output()


def list_commands(program: str, commands: Mapping[str, str]) -> str:
    """Commands of a program, for its help."""
    width = max(map(len, commands)) + 2
    lines = "\n".join(f"  {name:{width}}{text}" for name, text in commands.items())
    return f"commands:\n{lines}\n\n`{program} COMMAND --help` lists the options of a command."


def _select_command(
    program: str, commands: Mapping[str, str], words: Sequence[str], default: str
) -> tuple[str, Sequence[str]]:
    word = words[0] if words else ""
    if word in commands:
        return word, words[1:]
    is_option = word.startswith("-")
    if default and (is_option or not word):
        return default, words
    parser = CommandParser(
        program, usage=f"{program} COMMAND [options]", epilog=list_commands(program, commands)
    )
    if is_option:
        parser.parse_args(words[:1])
    problem = f"no command {word!r}" if word and not is_option else "the command is missing"
    parser.error(f"{problem}: the commands are {list_names(word, commands)}")


def _has_lost_reader() -> bool:
    """Whether the reader of the output has seen enough, as `head` has; not a peer of a socket."""
    import select

    # Windows has no poll.
    if not hasattr(select, "poll"):
        return False
    output = select.poll()
    output.register(1, 0)
    return any(events & (select.POLLERR | select.POLLHUP) for _, events in output.poll(0))


def _end_output() -> None:
    """Write what is left of the output, or drop it where that fails."""
    try:
        print(end="", flush=True)
    except OSError:
        # Else the interpreter tries once more at its end, and exits with 120.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def describe_version(distribution: str) -> str:
    """Version of a distribution, of Python and of the system."""
    import platform
    from importlib import metadata

    system = f"{platform.system()} {platform.machine()}"
    version = metadata.version(distribution)
    return f"{distribution} {version} (Python {platform.python_version()}, {system})"


class _PrintVersion(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        assert isinstance(parser, CommandParser)
        print(parser.describe_version(parser.prog.split()[0]))
        parser.exit()


class _HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Help with the default of every option."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        # A list of commands keeps its lines; sentences are wrapped.
        if "\n" in text:
            return super()._fill_text(text, width, indent)
        return argparse.HelpFormatter._fill_text(self, text, width, indent)

    def _get_help_string(self, action: argparse.Action) -> str:
        # What Python 3.11 adds to a pair of --x and --no-x.
        text = (action.help or "").removesuffix(" (default: %(default)s)")
        value = action.default
        if value in (None, "", [], argparse.SUPPRESS) or value is False or "default:" in text:
            return text
        return f"{text} (default: {_format_value(value).replace('%', '%%')})".lstrip()


def _format_value(value: object) -> str:
    match value:
        case True:
            return "yes"
        case float():
            return f"{value:g}"
        case list() | tuple():
            return " ".join(map(_format_value, value))
        case _:
            return str(value)


class CommandParser(argparse.ArgumentParser):
    """Parser of the options of one command: argparse with short errors and suggestions.

    A reader of a value (`type`) may raise CatoptraError: its text is the message.

    Args:
        prog: The program and its command.
        description: What the command does.
        usage: The head of the help; None for one of all options.
        epilog: Text below the options.
    """

    def __init__(
        self, prog: str, description: str = "", *, usage: str | None = None, epilog: str = ""
    ) -> None:
        super().__init__(
            prog, usage, description=description, epilog=epilog, formatter_class=_HelpFormatter
        )
        self.describe_version: Callable[[str], str] = describe_version
        # Such as the pose -1,2,0: argparse takes only a single number for a value.
        self._negative_number_matcher = re.compile(r"-(\.?\d|inf|nan)")
        self.add_argument("--version", action=_PrintVersion, nargs=0, default=argparse.SUPPRESS,
            help="print version and system")  # fmt: skip

    def read_too(self, option: str, *old_words: str) -> None:
        """Read words of earlier releases as an option."""
        for word in old_words:
            self._option_string_actions[word] = self._option_string_actions[option]

    def parse_args(  # type: ignore[override]  # one of argparse's overloads is enough
        self, words: Sequence[str] | None = None
    ) -> argparse.Namespace:
        """Options of a command line; ends the process for a wrong one."""
        words = sys.argv[1:] if words is None else words
        # First: a misspelt option that is required would be reported as missing.
        for word in words:
            if word == "--":
                break
            self._check_option(word.partition("=")[0])
        parsed, further = self.parse_known_args(words)
        if further:
            self.error(f"{further[0]!r} is more than the command takes")
        return parsed

    def _check_option(self, word: str) -> None:
        is_option = len(word) > 1 and word[0] == "-" and " " not in word
        known = self._option_string_actions
        if not is_option or self._negative_number_matcher.match(word):
            return
        if not any(option.startswith(word) for option in known):
            hint = ""
            if near := suggest_name(word, known):
                # In place of an old word the one that has replaced it.
                words = known[near].option_strings
                hint = f"; did you mean {near if near in words else words[0]}?"
            self.error(f"no option {word}{hint}")

    def _get_option_tuples(self, option_string: str) -> Any:
        # The old and the new word of an option are one option, so their beginning is its own.
        found = super()._get_option_tuples(option_string)
        return [*{id(each[0]): each for each in found}.values()]

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string)
        except CatoptraError as error:
            raise argparse.ArgumentError(action, str(error)) from error

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            names = list_names(value, action.choices)
            raise argparse.ArgumentError(action, f"no {value!r} among {names}")

    def error(self, message: str) -> NoReturn:
        """End the process with status 2 and a message of one line."""
        hint = "" if message.endswith("?") else f"; `{self.prog} --help` lists the options"
        print(f"{self.prog}: {_join_lines(message)}{hint}", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)


def _join_lines(message: str) -> str:
    return " ".join(line.strip() for line in message.splitlines())


def int_within(name: str, first: int, last: int) -> Callable[[str], int]:
    """Reader of an integer option within two limits, both included."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            _reject(f"{name} is an integer from {first} to {last}, not {text!r}")
        if not first <= value <= last:
            _reject(f"{name} is {first} to {last}, not {value}")
        return value

    return parse


parse_port = int_within("a port", 0, 65535)
# More is a typing error that a command would obey for days.
parse_count = int_within("a number", 1, 1_000_000)


def parse_float_within(text: str, *, name: str, last: float = math.inf, unit: str = "") -> float:
    """Finite number of an option, from 0 to a limit."""
    limits = "0 or more" if math.isinf(last) else f"0 to {last:g}"
    expected = f"{name} is {limits}{unit and ' ' + unit}, not {text!r}"
    try:
        value = float(text)
    except ValueError:
        _reject(expected)
    # The comparison is false for NaN, which float() accepts.
    if not 0.0 <= value <= last or math.isinf(value):
        _reject(expected)
    return value


def parse_integer(text: str) -> int:
    """Any integer, such as a seed."""
    try:
        return int(text)
    except ValueError:
        _reject(f"a seed is an integer, not {text!r}")


def _reject(message: str) -> NoReturn:
    raise argparse.ArgumentTypeError(message) from None
