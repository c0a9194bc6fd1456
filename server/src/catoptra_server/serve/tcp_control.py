"""Server of the control port (TCP 3000): one connection is one robot.

A connection is a client of the simulation: commands are posted in order, and while the client's
queue is full the connection is not read. Reports come from the simulation's thread.
"""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from functools import partial

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.command_results import STATUS_FAILED, STATUS_OK
from catoptra_protocol.usarsim.commands import Command, StepCommand, Stepper
from catoptra_protocol.usarsim.control_connection import ControlServer
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.reports import CommandResult, Greeting, InitResult, Report
from catoptra_server.serve.limits import (
    DISCONNECT_ABOVE_BYTES,
    DROP_PERIODIC_ABOVE_BYTES,
    LoopAccount,
    LoopCalls,
)
from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.tcp_server import TcpConnection, TcpServer, serve_tcp
from catoptra_server.simulation.events import (
    ClientDisconnected,
    CommandReceived,
    ResetRequested,
    SimulationEvent,
    StepRequested,
    StepResult,
)

log = logging.getLogger(__name__)
_PostEvent = Callable[[SimulationEvent], bool]
# Commands in one read of a client that waits for the replies, such as SET, DRIVE and STEP.
_MAX_DIALOGUE_COMMANDS = 4
# Time of the loop for one read and for handing over one command, beside parser and replies, whose
# time is measured.
_READ_S = 1e-4
_POST_S = 2e-5
# Reports that are repeated in the next cycle.
_PERIODIC_WORDS = ("SEN", "STA", "MISSTA")
# Time for the work of a client that has closed its sending side: replies to the last commands.
_END_GRACE_S = 5.0


def serve_control(
    host: str,
    port: int,
    *,
    greeting: Greeting,
    post: _PostEvent,
    dialect: Dialect = Dialect.UT2004,
    limits: ConnectionLimits | None = None,
) -> AbstractAsyncContextManager[TcpServer]:
    """Serve controllers of robots until the block ends.

    Args:
        host: Host name or address of the interface.
        port: TCP port; 0 = a free one.
        greeting: First line on each connection.
        post: Hands an event to the simulation; thread-safe. False if the queue of the event's
            client is full.
        dialect: Dialect of the reports.
        limits: Number of connections and time-outs; None for the defaults.

    Raises:
        OSError: The port is not available.
    """
    limits = limits or ConnectionLimits()
    loop_calls = LoopCalls()

    async def handle_connection(connection: TcpConnection) -> None:
        protocol = ControlServer(dialect)
        client = _ControlPeer(
            connection,
            protocol,
            post=post,
            account=limits.loop_share.open_account(connection.address),
            loop_calls=loop_calls,
        )
        log.info("controller %s connected", connection.address)
        try:
            connection.write(protocol.send(greeting))
            await client.serve()
        finally:
            # Whatever ended the connection, also an exception: the robot must not stay in the
            # world.
            post(ClientDisconnected(client))
            log.info("controller %s disconnected", connection.address)

    return serve_tcp(
        host,
        port,
        handle_connection,
        name="control",
        first_bytes=re.compile(rb"[\t-~]"),
        limits=limits,
        end_grace_s=_END_GRACE_S,
    )


class _ControlPeer:
    """One connection as a client of the simulation."""

    def __init__(
        self,
        connection: TcpConnection,
        protocol: ControlServer,
        *,
        post: _PostEvent,
        account: LoopAccount,
        loop_calls: LoopCalls,
    ) -> None:
        self._loop_calls = loop_calls
        self._connection = connection
        self._protocol = protocol
        self._post = post
        self._account = account
        self._has_room = asyncio.Event()
        # Whether the client waited for the replies at the time of its last input.
        self._is_dialogue = True
        self._is_stepper = False

    def deliver(self, reports: Sequence[Report]) -> None:
        """Send reports; from any thread, as all methods of a simulation's client."""
        self._loop_calls.call(partial(self._send, tuple(reports)))

    def finish_init(self, result: InitResult) -> None:
        """Send a rejection, or where the robot was put; its client may be silent."""
        if not result.failure:
            self._loop_calls.call(self._allow_silence)
        self.deliver([result])

    def disconnect(self, reason: str) -> None:
        """End the connection after the reports so far."""
        log.warning("%s disconnected: %s", self._connection.address, reason)
        self._loop_calls.call(self._connection.close)

    def resume_reading(self) -> None:
        """Continue to post commands."""
        self._loop_calls.call(self._has_room.set)

    async def serve(self) -> None:
        """Hand the client's commands to the simulation until nothing more comes."""
        while data := await self._connection.read():
            log.debug("from %s: %r", self._connection.address, data)
            begin_s = time.thread_time()
            commands = self._protocol.receive(data)
            parse_s = time.thread_time() - begin_s
            for command in commands:
                self._connection.has_handshake = True
                if isinstance(command, Stepper):
                    self._is_stepper = True
                    continue
                await self._post_in_turn(self._make_event(command))
            self._is_dialogue = (
                len(commands) <= _MAX_DIALOGUE_COMMANDS and not self._connection.has_more_input
            )
            cost_s = _READ_S + _POST_S * len(commands) + parse_s
            self._account.charge(cost_s, is_dialogue=self._is_dialogue)
            await self._account.wait()
        await self._finish()

    def _make_event(self, command: Command) -> CommandReceived | StepRequested:
        if isinstance(command, StepCommand):
            return StepRequested(
                self, command.time_s, self._reply_step, is_declared=self._is_stepper
            )
        return CommandReceived(self, command)

    async def _post_in_turn(self, event: SimulationEvent) -> None:
        """Post an event, and wait while the client's queue is full: nothing is read meanwhile."""
        if not self._post(event):
            self._has_room.clear()
            await self._has_room.wait()

    async def _finish(self) -> None:
        """Wait until the commands so far are executed and the replies are sent.

        A client may close the sending side right behind a last query, and read the reply.
        """
        is_finished = asyncio.Event()

        def finish() -> None:
            self._loop_calls.call(is_finished.set)

        # Behind the queued commands; the connection is cancelled if this takes too long.
        await self._post_in_turn(ResetRequested(self, finish, is_last=True))
        await is_finished.wait()

    def _reply_step(self, result: StepResult) -> None:
        status = STATUS_FAILED if result.failure else STATUS_OK
        self.deliver([*result.readings, CommandResult(result.time_s, "Step", "Clock", status)])

    def _allow_silence(self) -> None:
        # One command may drive a robot for an hour. TCP notices a client that has vanished.
        self._connection.has_robot = True

    def _send(self, reports: Sequence[Report]) -> None:
        unsent = self._connection.num_unsent_bytes
        if self._connection.is_closing:
            return
        if unsent > DISCONNECT_ABOVE_BYTES:
            address = self._connection.address
            log.warning("%s reads nothing: disconnected, %d bytes unsent", address, unsent)
            self._connection.abort()
            return
        is_periodic = all(report.WORD in _PERIODIC_WORDS for report in reports)
        if unsent > DROP_PERIODIC_ABOVE_BYTES and is_periodic:
            return
        # Replies are the client's use of the loop; periodic reports are the server's.
        with (
            nullcontext()
            if is_periodic
            else self._account.charge_block(is_dialogue=self._is_dialogue)
        ):
            # One write for all: clients that read line by line from one segment lose least so.
            data = b"".join(map(self._encode, reports))
            self._connection.write(data)
        log.debug("to %s: %r", self._connection.address, data)

    def _encode(self, report: Report) -> bytes:
        """Bytes of a report; empty for an invalid one, so that the others are sent."""
        try:
            return self._protocol.send(report)
        except LocalProtocolError as error:
            log.error("not sent to %s: %s", self._connection.address, error)
            return b""
