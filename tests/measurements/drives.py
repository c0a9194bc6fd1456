"""Random drives over rough worlds and the arena: `make drives`, or a number of drives.

Prints what was wrong with each drive that was not right, and exits with 1 if there was one.
"""

from __future__ import annotations

import sys
from pathlib import Path

from catoptra_server.config.world_file import read_world
from helpers.configs import ROBOTS
from helpers.random_drives import NUM_WORLDS, Stage, drive_at_random, make_rough_world


def main() -> int:
    """Drive, and count the faults."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    arena: Path = ROBOTS.parent / "worlds" / "arena.ini"
    stages = [Stage.of_world(make_rough_world(number)) for number in range(NUM_WORLDS - 1)]
    stages.append(Stage.of_world(read_world(arena)[0]))
    num_faults = 0
    for seed in range(count):
        fault = drive_at_random(stages[seed % len(stages)], seed)
        if fault:
            num_faults += 1
            print(f"seed {seed}: {fault}", flush=True)
    print(f"{count} drives of 5 s over {len(stages)} worlds: {num_faults} with a fault")
    return 1 if num_faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
