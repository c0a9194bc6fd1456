"""Stream and live page as a server process opens them."""

from __future__ import annotations

import asyncio
import json
import urllib.request
from pathlib import Path

import aiohttp

import catoptra_server
from catoptra_protocol.stream.replies import SensorReports, StateReply
from catoptra_protocol.stream.requests import DriveRequest, GetStateRequest, SpawnRequest
from helpers.live_page import PageClient, read_page_link
from helpers.loopback import run_scenario
from helpers.server_process import start_server


def test_stream_of_a_server_states_release_world_and_robots(tmp_path: Path) -> None:
    with start_server(tmp_path) as server, server.connect_stream() as client:
        status = client.get_status()
    assert status.server == f"Catoptra {catoptra_server.__version__}"
    assert status.class_names == ("USARBot.OmniP2AT",)
    assert status.clock == "realtime"


def test_page_of_a_server_has_its_files_and_describes_it(tmp_path: Path) -> None:
    with start_server(tmp_path, "--view", "0") as server:
        link = read_page_link(server)
        with urllib.request.urlopen(f"{link}/") as response:
            assert b"<!DOCTYPE html>" in response.read()
        with urllib.request.urlopen(f"{link}/api/server.json") as response:
            description = json.load(response)
        plan = f"{link}/api/floor_plan.json?class=USARBot.OmniP2AT"
        with urllib.request.urlopen(plan) as response:
            assert json.load(response)["picture"]
    assert description["clock"] == "realtime"
    assert description["classes"][0]["class_name"] == "USARBot.OmniP2AT"


def test_robot_that_a_page_drives_halts_within_300_ms_and_leaves_with_the_page(
    tmp_path: Path,
) -> None:
    async def drive(link: str) -> None:
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"{link}/socket", origin=link) as watching,
        ):
            watcher = PageClient(watching)
            async with http.ws_connect(f"{link}/socket", origin=link) as websocket:
                page = PageClient(websocket, watcher.ids)
                spawn = SpawnRequest(1, "USARBot.OmniP2AT", "Mine", None, "Centre")
                assert isinstance(await page.request(spawn), SensorReports)
                await page.request(DriveRequest(2, 1.0, 1.0, False))
                start_s = time_s = await wait_for_roll(watcher)
                while (state := await get_state(watcher)) and is_rolling(state):
                    time_s = state.time_s
                # The last time at which it rolls: on a busy machine it is seen to stand later.
                assert time_s - start_s < 0.3
            while (await get_state(watcher)).robots:
                await asyncio.sleep(0)

    with start_server(tmp_path, "--view", "0") as server:
        run_scenario(drive(read_page_link(server)))


async def get_state(page: PageClient) -> StateReply:
    state = await page.request(GetStateRequest(next(page.ids), "Mine"))
    assert isinstance(state, StateReply)
    return state


def is_rolling(state: StateReply) -> bool:
    return any(state.robots[0].wheel_speeds_rad_s)


async def wait_for_roll(page: PageClient) -> float:
    """Simulation time at which the robot first rolls."""
    while not is_rolling(state := await get_state(page)):
        await asyncio.sleep(0)
    return state.time_s
