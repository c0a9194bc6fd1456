"""The command line: `catoptra-server --robot FILE --world FILE`. Only this module prints."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path

# NumPy's BLAS threads would spin beside the renderer's; set before NumPy is loaded below.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.image import ImageType
from catoptra_server.app import Listening, Options, serve
from catoptra_server.simulation import Clock
from catoptra_server.transports.tcp_image import ImageOptions

EXIT_CANNOT_START = 2
STREAM_PORT = 5005


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the server; return 0 after a clean end, 2 if it could not start."""
    options, level = _options(_parser().parse_args(arguments))
    logging.basicConfig(
        level=level, stream=sys.stderr, format="%(asctime)s %(levelname)-7s %(name)s: %(message)s"
    )
    try:
        asyncio.run(serve(options, _announce))
    except CatoptraError as error:
        print(f"catoptra-server: {error}", file=sys.stderr)
        return EXIT_CANNOT_START
    except OSError as error:
        print(f"catoptra-server: cannot listen: {error}{_port_remedy(options)}", file=sys.stderr)
        return EXIT_CANNOT_START
    return 0


def _announce(listening: Listening) -> None:
    """Print where to connect, for people and for programs that chose port 0."""
    print(
        f"listening control={listening.host}:{listening.control_port} "
        f"image={listening.host}:{listening.image_port} "
        f"stream={listening.host}:{listening.stream_port}",
        flush=True,
    )


def _port_remedy(options: Options) -> str:
    return (
        f". Is another server running on {options.host}, port {options.control_port}, "
        f"{options.image_port} or {options.stream_port}? "
        "--control-port 0 --image-port 0 take free ones"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-server",
        description="Simulate a robot with an omnidirectional camera, in USARSim's protocol.",
    )
    add = parser.add_argument
    add("--robot", type=Path, required=True, action="append", metavar="FILE",
        help="robot ini, like USARBot.ini; may be given several times")  # fmt: skip
    add("--world", type=Path, required=True, metavar="FILE", help="world ini")
    add("--host", default="127.0.0.1", help="address to listen on (default: loopback only)")
    add("--control-port", type=_port, default=3000, metavar="PORT", help="0 = any free one")
    add("--image-port", type=_port, default=5003, metavar="PORT", help="0 = any free one")
    add("--stream-port", type=_port, metavar="PORT",
        help="of the ZeroMQ stream (default: 5005, any free one if another port is 0)")  # fmt: skip
    add("--image-type", type=_image_type, default=ImageType.GOOD, metavar="TYPE",
        help="RAW, SUPER, GOOD (default), NORMAL, FAIR or BAD")  # fmt: skip
    add("--legacy-images", action="store_true", help="send one frame unasked on connecting")
    add("--dialect", choices=[d.value for d in Dialect], default=Dialect.UT2004.value,
        help="of the control port: USARSim for UT2004 (default) or for UDK")  # fmt: skip
    add("--renderer", choices=["auto", "trace", "raster"], default="auto")
    add("--threads", type=_threads, default=0, help="of the trace renderer; 0 = one a processor")
    add("--clock", choices=[c.value for c in Clock], default=Clock.REALTIME.value,
        help="lockstep: time passes only when a client sends STEP")  # fmt: skip
    add("--seed", type=int, default=0, help="of all random numbers")
    add("--verbose", action="store_true", help="log every message on the wire")
    return parser


def _options(parsed: argparse.Namespace) -> tuple[Options, int]:
    options = Options(
        robots=tuple(parsed.robot),
        world=parsed.world,
        host=parsed.host,
        control_port=parsed.control_port,
        image_port=parsed.image_port,
        stream_port=_stream_port(parsed),
        images=ImageOptions(parsed.image_type, legacy=parsed.legacy_images),
        dialect=Dialect(parsed.dialect),
        renderer=parsed.renderer,
        threads=parsed.threads,
        clock=Clock(parsed.clock),
        seed=parsed.seed,
    )
    return options, logging.DEBUG if parsed.verbose else logging.INFO


def _stream_port(parsed: argparse.Namespace) -> int:
    """Return the port asked for; who wants any free port elsewhere wants one here too."""
    if parsed.stream_port is not None:
        return int(parsed.stream_port)
    return STREAM_PORT if parsed.control_port and parsed.image_port else 0


def _port(text: str) -> int:
    port = int(text)
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"a port is 0 to 65535, not {port}")
    return port


def _threads(text: str) -> int:
    threads = int(text)
    if not 0 <= threads <= 1024:
        raise argparse.ArgumentTypeError(f"threads are 0 to 1024, not {threads}")
    return threads


def _image_type(text: str) -> ImageType:
    try:
        return ImageType.from_text(text)
    except CatoptraError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


if __name__ == "__main__":
    sys.exit(main())
