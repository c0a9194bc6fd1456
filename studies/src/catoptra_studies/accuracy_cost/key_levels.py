"""The key steps of a study that the server measured: cost.json in, robot files out, and back.

`catoptra-server cost` writes cost.json; this side reads of it only how a step is asked for, and
adds `landmarks`. Everything else in the file passes through as it is.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError


@dataclass(frozen=True, slots=True)
class KeyLevel:
    """A step to be driven. robot_lines: what a robot file says to get it. rmse: in grey levels."""

    name: str
    renderer: str
    robot_ini: str
    rmse: float


def read_cost_json(path: Path) -> dict[str, Any]:
    """Return cost.json as it is. Raises CatoptraError if there is none."""
    try:
        study: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CatoptraError(
            f"{path}: no study to add to ({error}): let catoptra-server cost measure first"
        ) from error
    return study


def select_key_levels(results: Mapping[str, Any]) -> tuple[KeyLevel, ...]:
    """Return the key steps from coarse to exact."""
    try:
        steps = [
            KeyLevel(row["name"], row["renderer"], row["robot_lines"], row["rmse"])
            for row in results["steps"]
            if row["is_key"]
        ]
    except (KeyError, TypeError) as error:
        raise CatoptraError(f"cost.json is of another version: {error!r} is missing") from error
    return tuple(sorted(steps, key=lambda step: -step.rmse))


def write_robot_file(level: KeyLevel, base_robot: Path, path: Path) -> None:
    """Write a robot file that is another one, drawn as the step says."""
    based_on = f"[Configuration]\nBasedOn={base_robot.resolve()}\n"
    path.write_text(based_on + level.robot_ini, encoding="utf-8")


def write_localization(
    results: Mapping[str, Any], localization: Mapping[str, Any], path: Path
) -> None:
    """Write cost.json again with what was found out here."""
    text = json.dumps({**results, "landmarks": localization}, indent=2)
    path.write_text(text + "\n", encoding="utf-8")
