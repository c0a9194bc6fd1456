"""Command line of the server: `catoptra-server --robot FILE --world FILE` and further options."""

from __future__ import annotations

import asyncio
import errno
import logging
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial

from catoptra_protocol.errors import CatoptraError
from catoptra_server.app import ListeningAddress, serve
from catoptra_server.options import Options
from catoptra_server.runtime.faults import Termination
from catoptra_server.runtime.logs import LogWriter, write_log
from catoptra_server.runtime.memory import raise_descriptor_limit
from catoptra_server.runtime.worker_thread import ThreadFailedError
from catoptra_server.server_arguments import parse_arguments

log = logging.getLogger(__name__)

EXIT_FAULT = 1
EXIT_CANNOT_START = 2
# With the grace of `termination`, less than the promised second.
_FLUSH_TIMEOUT_S = 0.1
# A thread that needs the interpreter waits this long for one that computes. Under all attacks of
# tests/load Python's 5 ms let each turn of the event loop take 90 ms and 12 to 30 % of the reports
# come late, 0.1 ms 0 to 3 %; frames of an idle server take as long with either.
_SWITCH_INTERVAL_S = 0.0001
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
        Exit status: 0 after a signal, 2 if the server could not start, 1 after a fault.
    """
    options, level = parse_arguments(arguments)
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
            return _report(writer, _describe_listen_error(error), EXIT_CANNOT_START)
        except Exception:
            # Not left to the interpreter, whose print waits for standard error.
            log.critical("the server ends: a bug", exc_info=True)
            return EXIT_FAULT
        return 0


def _describe_listen_error(error: OSError | UnicodeError) -> str:
    """Reason for which a port cannot be opened, with its remedy."""
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
