"""Servers that run elsewhere, such as in another container: parsing and waiting for addresses.

Such a server must have been started like those of `run_server`: lockstep, raw images, the
set-up's robot and the experiment's seed. Then the logs of its drives are the same.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable

from catoptra_client.control_connection import ServerAddress
from catoptra_client.robot_client import RobotClient
from catoptra_protocol.errors import ConnectionLostError, DomainError

_DEFAULT_CONTROL_PORT = 3000
_DEFAULT_IMAGE_PORT = 5003
_SERVER_PATTERN = re.compile(r"(\w+)=([^\s:=]+)(?::(\d{1,5}))?(?::(\d{1,5}))?", re.ASCII)
# A container's name resolves a moment after its start, so early attempts fail at once.
_POLL_INTERVAL_S = 0.2


def parse_server_address(text: str) -> tuple[str, ServerAddress]:
    """Parse `sim=host`, `sim=host:3000` or `sim=host:3000:5003`.

    Returns:
        The name of the set-up and the address.

    Raises:
        DomainError: The text has another form.
    """
    match = _SERVER_PATTERN.fullmatch(text)
    if match is None:
        raise DomainError(f"a server is NAME=HOST[:CONTROL[:IMAGE]], sim=localhost, not {text!r}")
    control, image = match[3] or _DEFAULT_CONTROL_PORT, match[4] or _DEFAULT_IMAGE_PORT
    return match[1], ServerAddress(match[2], int(control), int(image))


def wait_for_server(
    address: ServerAddress,
    *,
    timeout_s: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ServerAddress:
    """Wait until a server's control port accepts a connection and sends its greeting.

    Args:
        address: Server to wait for.
        timeout_s: Longest wait.
        clock: Source of the time in seconds.
        sleep: Function that pauses for a number of seconds.

    Returns:
        The address as given.

    Raises:
        ConnectionLostError: The server did not accept a connection in time.
    """
    deadline_s = clock() + timeout_s
    while True:
        try:
            # Waits for the greeting: a proxy may accept before the server behind listens.
            RobotClient.connect(address.host, address.control_port).close()
            return address
        except ConnectionLostError:
            if clock() >= deadline_s:
                raise
        sleep(_POLL_INTERVAL_S)
