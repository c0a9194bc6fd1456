"""Command line of the server: `catoptra-server --robot FILE --world FILE`, and its options.

The first line on standard output has the addresses: tests, studies and containers parse that line.
The interpreter is handed over within 0.1 ms (Python's default: 5).
"""

from __future__ import annotations

import argparse
import asyncio
import errno
import logging
import os
import re
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import cast

from catoptra_protocol.command_line import (
    EXIT_FAILURE,
    CommandParser,
    int_within,
    list_commands,
    parse_float_within,
    parse_integer,
    parse_port,
)
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.commands import COMMANDS
from catoptra_server.commands.server import ListeningAddress, Options, serve
from catoptra_server.config.known_names import FileKind, bundled_files, find_configuration
from catoptra_server.config.server_file import (
    MAX_CONNECTIONS,
    MAX_FRAME_SKIP,
    MAX_TIMEOUT_S,
    ServerOptions,
)
from catoptra_server.frames.multi_view import TileLayout, multi_view_layout
from catoptra_server.render.renderer_kind import AUTO, RENDERER_NAMES
from catoptra_server.runtime.faults import Termination
from catoptra_server.runtime.logs import LogWriter, write_log
from catoptra_server.runtime.memory import (
    DEFAULT_LIMIT_BYTES,
    MAX_LIMIT_MIB,
    MIB,
    raise_descriptor_limit,
)
from catoptra_server.runtime.worker_thread import ThreadFailedError
from catoptra_server.simulation.loop import ClockMode

log = logging.getLogger(__name__)
# With the grace of `termination`, less than the promised second.
_FLUSH_TIMEOUT_S = 0.1
# A thread that needs the interpreter waits this long for one that computes. Under all attacks of
# tests/load Python's 5 ms let each turn of the event loop take 90 ms and 12 to 30 % of the reports
# come late, 0.1 ms 0 to 3 %; frames of an idle server take as long with either.
_SWITCH_INTERVAL_S = 0.0001
# More than a thousand threads is a typing error that the renderer would obey.
_MAX_THREADS = 1024
_MULTI_VIEW = re.compile(r"(\d+)x(\d+):(\d+)x(\d+)", re.ASCII)
_FREE_PORTS = "--control-port 0 --image-port 0 --view 0 take free ones"
_HOST_REMEDY = (
    "--host is a name or an address of this machine: 127.0.0.1 for itself alone, 0.0.0.0 for all"
)


def main(arguments: Sequence[str], termination: Termination) -> int:
    """Run the server.

    Args:
        arguments: words of the command line, without the program.
        termination: signals that end the process.

    Returns:
        Exit status: 0 after a signal, 1 if the server could not start or after a fault.
    """
    options, level = parse_arguments(arguments)
    raise_descriptor_limit()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    with write_log(level) as writer:
        try:
            asyncio.run(_serve_until_signal(options, termination, writer))
        except ThreadFailedError as error:
            # The log has the traceback.
            return _report(writer, error)
        except CatoptraError as error:
            return _report(writer, error)
        # UnicodeError: a host name that cannot be one, such as a..b.
        except (OSError, UnicodeError) as error:
            return _report(writer, _describe_listen_error(error))
        except Exception:
            # Not left to the interpreter, whose print waits for standard error.
            log.critical("the server ends: a bug", exc_info=True)
            return EXIT_FAILURE
        return 0


async def _serve_until_signal(
    options: Options, termination: Termination, writer: LogWriter
) -> None:
    stop = asyncio.Event()
    stop_soon = partial(asyncio.get_running_loop().call_soon_threadsafe, stop.set)
    with ExitStack() as listening:

        def announce(address: ListeningAddress) -> None:
            # Before, a signal ends the process at once: there is no connection to close.
            listening.enter_context(
                termination.call_on_signal(stop_soon, flush=partial(_end_log, writer))
            )
            try:
                _print_addresses(address)
            except OSError as error:
                # Otherwise the interpreter tries once more at its end, and exits with 120.
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                raise CatoptraError(
                    f"standard output takes no line, which has the addresses: {error.strerror}"
                ) from error

        await serve(options, announce, stop)


def _end_log(writer: LogWriter) -> None:
    log.warning("the process ends at once: its work was not stopped in time, or a second signal")
    writer.flush(_FLUSH_TIMEOUT_S)


def _report(writer: LogWriter, reason: object) -> int:
    writer.write_line(f"catoptra-server: {reason}")
    return EXIT_FAILURE


def _print_addresses(address: ListeningAddress) -> None:
    """Print the addresses, for users and for programs that chose port 0.

    The first line is an interface: tests, studies and containers parse it.
    """
    image = "off" if address.image_port is None else f"{address.host}:{address.image_port}"
    print(
        f"listening control={address.host}:{address.control_port} image={image} "
        f"stream={address.host}:{address.stream_port}",
        flush=True,
    )
    if address.view_link is not None:
        print(f"live page: {address.view_link}", flush=True)


def _describe_listen_error(error: OSError | UnicodeError) -> str:
    """Reason for which a port cannot be opened, with a remedy."""
    # Errors of the resolver have numbers of their own, below zero.
    number = error.errno if isinstance(error, OSError) else None
    match number:
        case errno.EADDRINUSE:
            remedy = f"Is another server running there? {_FREE_PORTS}"
        case errno.EACCES:
            remedy = f"Ports below 1024 need privileges; {_FREE_PORTS}"
        case errno.EMFILE | errno.ENFILE:
            remedy = "The process has no free descriptors of open files: raise `ulimit -n`"
        case _:
            remedy = _HOST_REMEDY
    text = getattr(error, "strerror", None) or str(error)
    if isinstance(error, UnicodeError):
        text = f"the host is no name that can exist ({error})"
    return f"cannot listen: {text}. {remedy}"


def parse_arguments(arguments: Sequence[str]) -> tuple[Options, int]:
    """Options of the server and level of its log; ends with a message for a wrong command line."""
    parser = _build_parser()
    parsed = parser.parse_args(arguments)
    # Not argparse's `required`, whose message would name no file.
    for option, kind, values in (
        ("--robot", "robots", parsed.robot),
        ("--world", "worlds", parsed.world),
    ):
        if not values:
            names = ", ".join(path.stem for path in bundled_files(cast(FileKind, kind)))
            parser.error(
                f"{option} is missing: an ini file, or one of the bundled {kind}: {names} "
                f"(`catoptra-server list {kind}` describes them)"
            )
    return _make_options(parsed)


def _build_parser() -> CommandParser:
    parser = CommandParser(
        "catoptra-server",
        "Simulate a robot with an omnidirectional camera, in USARSim's protocol.",
        usage="catoptra-server [serve] --robot FILE --world FILE [options]\n"
        "       catoptra-server COMMAND [options]",
        epilog=list_commands("catoptra-server", COMMANDS),
    )
    parser.describe_version = _describe_version
    add = parser.add_argument
    add("--robot", type=partial(find_configuration, "robots"), action="append", metavar="FILE",
        help="robot ini, like USARBot.ini, or the name of a bundled one, such as p2at_omni; "
        "may be given several times")  # fmt: skip
    add("--world", type=partial(find_configuration, "worlds"), metavar="FILE",
        help="world ini, or the name of a bundled one, such as four_legged_2006")  # fmt: skip
    add("--server-ini", type=Path, metavar="FILE",
        help="ini with UDK's [USARBotAPI.*]; a robot's file may have them too")  # fmt: skip
    add("--strict", action="store_true",
        help="unknown keys are errors in all sections of files; else in [Catoptra.*] alone, and "
        "warnings elsewhere")  # fmt: skip
    add("--host", default="127.0.0.1", help="address to listen on, this machine's alone")
    add("--control-port", type=parse_port, metavar="PORT",
        help="control port; 0 = any free one (default: 3000)")  # fmt: skip
    add("--image-port", type=parse_port, metavar="PORT",
        help="image port; 0 = any free one (default: 5003)")  # fmt: skip
    add("--stream-port", type=parse_port, metavar="PORT",
        help="ZeroMQ stream (default: 5005; any free one if another port is 0)")  # fmt: skip
    view = parser.add_mutually_exclusive_group()
    view.add_argument("--view", dest="view_port", type=parse_port, metavar="PORT",
        help="port of the live page, which shows cameras and robots in a browser (default: 5080; "
        "any free one if 5080 is in use or another port is 0)")  # fmt: skip
    view.add_argument("--no-view", dest="has_view", action="store_false",
        help="serve no live page")  # fmt: skip
    add("--image-type", type=ImageType.from_text, metavar="TYPE",
        help="RAW, SUPER, GOOD, NORMAL, FAIR or BAD (default: GOOD)")  # fmt: skip
    add("--legacy-images", action=argparse.BooleanOptionalAction,
        help="send one frame to a new viewer before its first request")  # fmt: skip
    add("--max-connections", metavar="N",
        type=int_within("a number of connections", 1, MAX_CONNECTIONS),
        help="connections to each of control and image port (default: 64)")  # fmt: skip
    add("--max-per-address", metavar="N",
        type=int_within("a number of connections", 1, MAX_CONNECTIONS),
        help="those of one address that is not of this machine (default: 16)")  # fmt: skip
    add("--handshake-timeout", dest="handshake_timeout_s", type=_parse_timeout, metavar="S",
        help="seconds for the first command or request of a connection (default: 0, no "
        "limit)")  # fmt: skip
    add("--idle-timeout", dest="idle_timeout_s", type=_parse_timeout, metavar="S",
        help="seconds of silence of a viewer, or of a controller without a robot (default: 0, no "
        "limit)")  # fmt: skip
    add("--frame-skip", type=int_within("a frame skip", 1, MAX_FRAME_SKIP), metavar="N",
        help="the image port shows at most every N-th tick of 20 ms (default: 1)")  # fmt: skip
    add("--multi-view", type=_parse_multi_view, metavar="COLUMNSxROWS:WIDTHxHEIGHT",
        help="the image port shows a tile for each camera, such as 2x2:320x240")  # fmt: skip
    add("--dialect", choices=[d.value for d in Dialect], default=Dialect.UT2004.value,
        help="dialect of the control port: USARSim for UT2004 or for UDK")  # fmt: skip
    add("--renderer", choices=RENDERER_NAMES, default=AUTO, help="renderer of all cameras")
    add("--threads", type=int_within("a number of threads", 0, _MAX_THREADS), default=0,
        metavar="N", help="threads of the trace renderer; 0 = one per processor")  # fmt: skip
    add("--max-error-px", type=_parse_non_negative, metavar="PX",
        help="accuracy target of every camera: the fastest plan that displaces no outline by more; "
        "0 = the settings of the file (default: 0)")  # fmt: skip
    add("--budget-ms", type=_parse_non_negative, metavar="MS",
        help="time budget of every camera: the most accurate plan that takes no longer per frame; "
        "0 = no budget (default: 0)")  # fmt: skip
    add("--memory-limit-mib", type=int_within("a limit in MiB", 1, MAX_LIMIT_MIB),
        default=DEFAULT_LIMIT_BYTES // MIB, metavar="MIB",
        help="memory of each camera's view, and of the world's meshes and textures "
        "together; larger files are rejected")  # fmt: skip
    add("--clock", choices=[c.value for c in ClockMode], default=ClockMode.REALTIME.value,
        help="lockstep: time passes only when a client sends STEP")  # fmt: skip
    add("--seed", type=parse_integer, default=0, metavar="N", help="seed of all random numbers")
    add("--verbose", action="store_true", help="log every message on the wire")
    return parser


def _describe_version(distribution: str) -> str:
    from catoptra_server.commands.list import describe_version  # loads what no server needs

    return describe_version(distribution)


def _make_options(parsed: argparse.Namespace) -> tuple[Options, int]:
    options = Options(
        robot_files=tuple(parsed.robot),
        world_file=parsed.world,
        server_file=parsed.server_ini,
        server_options=_make_server_options(parsed),
        host=parsed.host,
        stream_port=parsed.stream_port,
        has_view=parsed.has_view,
        view_port=parsed.view_port,
        dialect=Dialect(parsed.dialect),
        renderer=parsed.renderer,
        threads=parsed.threads,
        clock=ClockMode(parsed.clock),
        is_strict=parsed.strict,
        seed=parsed.seed,
        max_error_px=parsed.max_error_px,
        budget_ms=parsed.budget_ms,
        memory_limit_mib=parsed.memory_limit_mib,
    )
    return options, logging.DEBUG if parsed.verbose else logging.INFO


def _make_server_options(parsed: argparse.Namespace) -> ServerOptions:
    """Options that override ini files: the ones given on the command line."""
    # argparse's destinations are the keys of ServerOptions; None marks an option that is absent.
    keys = ServerOptions.__annotations__
    given = {key: value for key, value in vars(parsed).items() if key in keys and value is not None}
    if "max_connections" in given:
        given["max_image_connections"] = given["max_connections"]
    # --image-port switches images on, even where a file has bEnableImageServer=false.
    return cast(ServerOptions, given | ({"has_images": True} if "image_port" in given else {}))


_parse_non_negative = partial(parse_float_within, name="a tolerance or a budget")
_parse_timeout = partial(parse_float_within, name="a time-out", last=MAX_TIMEOUT_S, unit="s")


def _parse_multi_view(text: str) -> TileLayout:
    match = _MULTI_VIEW.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"a multi-view has the form 2x2:320x240, not {text!r}")
    columns, rows, width_px, height_px = map(int, match.groups())
    return multi_view_layout(columns, rows, width_px=width_px, height_px=height_px)
