"""Servers that run elsewhere, such as in another container: where they are, and when they answer.

Such a server must have been started as `server_process` starts its own: lockstep, raw images, the
set-up's robot and the experiment's seed. Then the records are the same.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable

from catoptra_client.robot_client import RobotClient
from catoptra_client.server_address import ServerAddress
from catoptra_protocol.errors import ConnectionLostError, DomainError

_DEFAULT_CONTROL_PORT = 3000
_DEFAULT_IMAGE_PORT = 5003
_SERVER_PATTERN = re.compile(r"(\w+)=([^\s:=]+)(?::(\d{1,5}))?(?::(\d{1,5}))?", re.ASCII)
# A container's name is known to others a moment after it starts.
_POLL_INTERVAL_S = 0.2


def parse_server_address(text: str) -> tuple[str, ServerAddress]:
    """Return the set-up and address in `sim=host`, `sim=host:3000` or `sim=host:3000:5003`."""
    found = _SERVER_PATTERN.fullmatch(text)
    if found is None:
        raise DomainError(f"a server is NAME=HOST[:CONTROL[:IMAGE]], sim=localhost, not {text!r}")
    control, image = found[3] or _DEFAULT_CONTROL_PORT, found[4] or _DEFAULT_IMAGE_PORT
    return found[1], ServerAddress(found[2], int(control), int(image))


def wait_for_server(
    address: ServerAddress,
    *,
    timeout_s: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ServerAddress:
    """Return the address once its control port greets. Raises ConnectionLostError in the end."""
    deadline_s = clock() + timeout_s
    while True:
        try:
            RobotClient.connect(address.host, address.control_port).close()
            return address
        except ConnectionLostError:
            if clock() >= deadline_s:
                raise
        sleep(_POLL_INTERVAL_S)
