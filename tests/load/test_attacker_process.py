"""Attackers as processes: their priority, their processor and their end."""

from __future__ import annotations

import asyncio
import os

import pytest

from helpers.loopback import HOST, listening_port, wait_until
from load.attack_tools import AttackedPorts
from load.attacker_process import RunningAttackers, run_attacks

_NAMES = ("flood_drives", "storm_connections", "flood_landmark_requests")


async def test_attackers_run_at_the_lowest_priority_until_the_end_of_the_block() -> None:
    connections = 0

    def count_connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal connections
        connections += 1
        writer.close()

    async with await asyncio.start_server(count_connection, HOST, 0) as server:
        port = listening_port(server)
        async with run_attacks(AttackedPorts(port, port, port, port), _NAMES) as attackers:
            assert attackers.measure().num_processes == len(_NAMES)
            assert os.getpriority(os.PRIO_PGRP, attackers.group) == 19
            assert len(os.sched_getaffinity(attackers.group)) == 1
            await wait_until(lambda: connections > 3, "attack")
        await wait_until(lambda: not has_processes(attackers), "end of all attackers")


def has_processes(attackers: RunningAttackers) -> bool:
    """Whether any process of the group is left."""
    try:
        os.killpg(attackers.group, 0)
    except ProcessLookupError:
        return False
    return True


async def test_attack_with_an_unknown_name_fails_at_the_start() -> None:
    with pytest.raises(AssertionError, match="did not start"):
        async with run_attacks(AttackedPorts(1, 1, 1, 1), ("no_attack",)):
            pass
