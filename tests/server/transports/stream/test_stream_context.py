"""What clients share: the set of connected ones."""

from __future__ import annotations

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_server.serve.stream.peer import StreamPeer
from catoptra_server.serve.stream.router import Outbox, SendResult
from helpers.fake_simulation import FakeSimulation, create_fake_context
from helpers.loopback import run_scenario


def test_clients_are_those_between_connection_and_disconnection() -> None:
    async def scenario() -> None:
        context = create_fake_context(FakeSimulation())
        outbox = Outbox(
            lambda _: SendResult.SENT, on_blocked=lambda: None, on_overflow=lambda: None
        )
        first, second = (StreamPeer(outbox, context, encode=bytes_from_message) for _ in "ab")
        assert context.clients == {first, second}
        first.disconnect()
        first.disconnect()
        assert context.clients == {second}

    run_scenario(scenario())
