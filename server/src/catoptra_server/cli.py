"""Command line of the server: `catoptra-server --robot FILE --world FILE` and further options."""

from __future__ import annotations

import argparse
import asyncio
import logging
import math
import re
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import cast

from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.app import ListeningAddress, serve
from catoptra_server.config.bundled_files import FileKind, find_configuration
from catoptra_server.config.server_file import (
    MAX_CONNECTIONS,
    MAX_FRAME_SKIP,
    MAX_TIMEOUT_S,
    ServerOptions,
)
from catoptra_server.descriptor_limit import raise_descriptor_limit
from catoptra_server.frames.multi_view import TileLayout, multi_view_layout
from catoptra_server.logs.log_writer import LogWriter, write_log
from catoptra_server.memory_budget import DEFAULT_LIMIT_BYTES, MAX_LIMIT_MIB, MIB
from catoptra_server.options import Options
from catoptra_server.render.renderer_kind import AUTO, INSTRUCTION_SETS, RENDERER_NAMES
from catoptra_server.simulation import ClockMode
from catoptra_server.termination import Termination
from catoptra_server.worker_thread import ThreadFailedError

log = logging.getLogger(__name__)

EXIT_FAULT = 1
EXIT_CANNOT_START = 2
# With the grace of `termination`, less than the promised second.
_FLUSH_TIMEOUT_S = 0.1
# A thread that needs the interpreter waits this long for one that computes. Under all attacks of
# tests/load Python's 5 ms let each turn of the event loop take 90 ms and 12 to 30 % of the reports
# come late, 0.1 ms 0 to 3 %; frames of an idle server take as long with either.
_SWITCH_INTERVAL_S = 0.0001
_PORT_REMEDY = (
    ". Is another server running there? --control-port 0 --image-port 0 --view 0 take free ones"
)
_MULTI_VIEW = re.compile(r"(\d+)x(\d+):(\d+)x(\d+)", re.ASCII)


def main(arguments: Sequence[str], termination: Termination) -> int:
    """Run the server.

    Args:
        arguments: words of the command line, without the program.
        termination: signals that end the process.

    Returns:
        Exit status: 0 after a signal, 2 if the server could not start, 1 after a fault.
    """
    options, level = _make_options(_build_parser().parse_args(arguments))
    raise_descriptor_limit()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    with write_log(level) as writer:
        try:
            asyncio.run(_serve_until_signal(options, termination, writer))
        except ThreadFailedError as error:
            # The log has the traceback.
            return _report(writer, error, EXIT_FAULT)
        except CatoptraError as error:
            return _report(writer, error, EXIT_CANNOT_START)
        # UnicodeError: a host name that cannot be one, such as a..b.
        except (OSError, UnicodeError) as error:
            reason = f"cannot listen: {error}{_PORT_REMEDY}"
            return _report(writer, reason, EXIT_CANNOT_START)
        except Exception:
            # Not left to the interpreter, whose print waits for standard error.
            log.critical("the server ends: a bug", exc_info=True)
            return EXIT_FAULT
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
            _print_addresses(address)

        await serve(options, announce, stop)


def _end_log(writer: LogWriter) -> None:
    log.warning("the process ends at once: its work was not stopped in time, or a second signal")
    writer.flush(_FLUSH_TIMEOUT_S)


def _report(writer: LogWriter, reason: object, status: int) -> int:
    writer.write_line(f"catoptra-server: {reason}")
    return status


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


def _build_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-server",
        description="Simulate a robot with an omnidirectional camera, in USARSim's protocol.",
    )
    add = parser.add_argument
    add("--robot", type=_parse_robot, required=True, action="append", metavar="FILE",
        help="robot ini, like USARBot.ini, or the name of a bundled one, such as p2at_omni; "
        "may be given several times")  # fmt: skip
    add("--world", type=_parse_world, required=True, metavar="FILE",
        help="world ini, or the name of a bundled one, such as four_legged_2006")  # fmt: skip
    add("--server-ini", type=Path, metavar="FILE",
        help="ini with UDK's [USARBotAPI.*]; a robot's file may have them too")  # fmt: skip
    add("--host", default="127.0.0.1", help="address to listen on (default: loopback only)")
    add("--control-port", type=_parse_port, metavar="PORT", help="default 3000; 0 = any free one")
    add("--image-port", type=_parse_port, metavar="PORT", help="default 5003; 0 = any free one")
    add("--stream-port", type=_parse_port, metavar="PORT",
        help="ZeroMQ stream (default: 5005; any free one if another port is 0)")  # fmt: skip
    view = parser.add_mutually_exclusive_group()
    view.add_argument("--view", dest="view_port", type=_parse_port, metavar="PORT",
        help="port of the live page, which shows cameras and robots in a browser (default: 5080; "
        "any free one if 5080 is in use or another port is 0)")  # fmt: skip
    view.add_argument("--no-view", dest="has_view", action="store_false",
        help="serve no live page")  # fmt: skip
    add("--image-type", type=_parse_image_type, metavar="TYPE",
        help="RAW, SUPER, GOOD (default), NORMAL, FAIR or BAD")  # fmt: skip
    add("--legacy-images", action=argparse.BooleanOptionalAction,
        help="send one frame to a new viewer before its first request")  # fmt: skip
    add("--max-connections", type=_parse_max_connections, metavar="N",
        help="connections to each of control and image port (default 64)")  # fmt: skip
    add("--handshake-timeout", dest="handshake_timeout_s", type=_parse_timeout, metavar="S",
        help="seconds for the first command or request of a connection (default 300; 0 = no "
        "limit)")  # fmt: skip
    add("--idle-timeout", dest="idle_timeout_s", type=_parse_timeout, metavar="S",
        help="seconds of silence of a viewer, or of a controller without a robot (default 600; "
        "0 = no limit)")  # fmt: skip
    add("--frame-skip", type=_parse_frame_skip, metavar="N",
        help="the image port shows at most every N-th tick of 20 ms (default 1)")  # fmt: skip
    add("--multi-view", type=_parse_multi_view, metavar="COLUMNSxROWS:WIDTHxHEIGHT",
        help="the image port shows a tile for each camera, such as 2x2:320x240")  # fmt: skip
    add("--dialect", choices=[d.value for d in Dialect], default=Dialect.UT2004.value,
        help="dialect of the control port: USARSim for UT2004 (default) or for UDK")  # fmt: skip
    add("--renderer", choices=RENDERER_NAMES, default=AUTO)
    add(
        "--threads",
        type=_parse_threads,
        default=0,
        help="threads of the trace renderer; 0 = one per processor",
    )
    add("--instruction-set", choices=INSTRUCTION_SETS, default=AUTO,
        help="instructions of the trace renderer's kernel; the same ones give the same bytes on "
        "every processor that has them (default: auto, the best of this processor)")  # fmt: skip
    add("--max-error-px", type=_parse_non_negative, metavar="PX",
        help="accuracy target of every camera: the fastest plan that displaces no outline by more; "
        "0 = the settings of the file")  # fmt: skip
    add("--budget-ms", type=_parse_non_negative, metavar="MS",
        help="time budget of every camera: the most accurate plan that takes no longer per frame; "
        "0 = no budget")  # fmt: skip
    add("--memory-limit-mib", type=_parse_memory_limit, default=DEFAULT_LIMIT_BYTES // MIB,
        metavar="MIB", help="memory of each camera's view, and of the world's meshes and textures "
        "together (default 1024); larger files are rejected")  # fmt: skip
    add("--clock", choices=[c.value for c in ClockMode], default=ClockMode.REALTIME.value,
        help="lockstep: time passes only when a client sends STEP")  # fmt: skip
    add("--seed", type=int, default=0, help="seed of all random numbers")
    add("--verbose", action="store_true", help="log every message on the wire")
    return parser


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
        instruction_set=parsed.instruction_set,
        clock=ClockMode(parsed.clock),
        seed=parsed.seed,
        max_error_px=parsed.max_error_px,
        budget_ms=parsed.budget_ms,
        memory_limit_mib=parsed.memory_limit_mib,
    )
    return options, logging.DEBUG if parsed.verbose else logging.INFO


def _make_server_options(parsed: argparse.Namespace) -> ServerOptions:
    """Options that override those of ini files: the ones given on the command line."""
    # argparse's destinations are the keys of ServerOptions; None marks an option that is absent.
    keys = ServerOptions.__annotations__
    given = {key: value for key, value in vars(parsed).items() if key in keys and value is not None}
    if "max_connections" in given:
        given["max_image_connections"] = given["max_connections"]
    # --image-port switches images on, even where a file has bEnableImageServer=false.
    return cast(ServerOptions, given | ({"has_images": True} if "image_port" in given else {}))


def _parse_robot(text: str) -> Path:
    return _find_file("robots", text)


def _parse_world(text: str) -> Path:
    return _find_file("worlds", text)


def _find_file(kind: FileKind, text: str) -> Path:
    try:
        return find_configuration(kind, text)
    except CatoptraError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _parse_port(text: str) -> int:
    port = int(text)
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"a port is 0 to 65535, not {port}")
    return port


def _parse_non_negative(text: str) -> float:
    value = float(text)
    # The comparison is false for NaN, which float() accepts.
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"a tolerance or a budget is 0 or more, not {text}")
    return value


def _parse_max_connections(text: str) -> int:
    number = int(text)
    if not 1 <= number <= MAX_CONNECTIONS:
        raise argparse.ArgumentTypeError(f"connections are 1 to {MAX_CONNECTIONS}, not {number}")
    return number


def _parse_timeout(text: str) -> float:
    timeout_s = float(text)
    # The comparison is false for NaN, which float() accepts.
    if not 0.0 <= timeout_s <= MAX_TIMEOUT_S:
        raise argparse.ArgumentTypeError(f"a time-out is 0 to {MAX_TIMEOUT_S:g} s, not {text}")
    return timeout_s


def _parse_memory_limit(text: str) -> int:
    limit_mib = int(text)
    if not 1 <= limit_mib <= MAX_LIMIT_MIB:
        raise argparse.ArgumentTypeError(f"a limit is 1 to {MAX_LIMIT_MIB} MiB, not {limit_mib}")
    return limit_mib


def _parse_frame_skip(text: str) -> int:
    skip = int(text)
    if not 1 <= skip <= MAX_FRAME_SKIP:
        raise argparse.ArgumentTypeError(f"a frame skip is 1 to {MAX_FRAME_SKIP}, not {skip}")
    return skip


def _parse_multi_view(text: str) -> TileLayout:
    match = _MULTI_VIEW.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"a multi-view has the form 2x2:320x240, not {text!r}")
    columns, rows, width, height = map(int, match.groups())
    try:
        return multi_view_layout(columns, rows, width_px=width, height_px=height)
    except DomainError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _parse_threads(text: str) -> int:
    # More than a thousand threads is a typing error that embree would obey.
    threads = int(text)
    if not 0 <= threads <= 1024:
        raise argparse.ArgumentTypeError(f"threads are 0 to 1024, not {threads}")
    return threads


def _parse_image_type(text: str) -> ImageType:
    try:
        return ImageType.from_text(text)
    except CatoptraError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
