"""Mutations of the control port in the UT2004 dialect, and what notices each of them.

Each changes one thing that a client depends on. The first group shows in the text of one line, the
second one in a motion, a unit, the time or the reply to a command.
"""

from __future__ import annotations

import math
import re

from conformance.line_mutations import (
    Connect,
    drop,
    move_block_first,
    of_commands,
    of_replies,
    reorder_ranges,
    scale,
    split_items,
    substitute,
    swap_sides,
    where,
)
from conformance.mutation import Mutation

_DEGREES = math.degrees(1.0)


def _mutation(name: str, connect: Connect, *noticed_by: str) -> Mutation:
    return Mutation(name, "control", connect, noticed_by)


def _count_one_more(line: str) -> str:
    return re.sub(r"(?<=StartPoses )\d+", lambda found: str(int(found[0]) + 1), line)


def _add_camera_reading(line: str) -> str:
    return line + "SEN {Time 1.0000} {Type Camera} \r\n"


def _drop_lower_case(line: str) -> str:
    word = line.strip().partition("{")[0].partition(" ")[0]
    return line if word == word.upper() else ""


TEXT_MUTATIONS = (
    _mutation(
        "STA without View",
        of_replies(where("STA", substitute(r" \{View [^}]*\}", ""))),
        "ut2004_status",
    ),
    _mutation(
        "STA with LightIntensity 0.0",
        of_replies(where("STA", substitute(r"(LightIntensity \d+)", r"\1.0"))),
        "status",
    ),
    _mutation(
        "STA in another order",
        of_replies(where("STA", lambda line: move_block_first(line, "Time"))),
        "ut2004_status",
    ),
    _mutation(
        "STA with false",
        of_replies(where("STA", substitute("Toggle False", "Toggle false"))),
        "status",
    ),
    _mutation("no greeting", of_replies(where(r"NFO \{Gametype", drop)), "greeting"),
    _mutation(
        "lines above 4096 bytes",
        of_replies(where("SEN", substitute("\r\n", f" {{Padding {'x' * 4096}}}\r\n"))),
        "line_format",
    ),
    _mutation(
        "double blank between blocks", of_replies(substitute(r"\} \{", "}  {")), "line_format"
    ),
    _mutation("no blank between blocks", of_replies(substitute(r"\} \{", "}{")), "line_format"),
    _mutation(
        "comma decimals",
        of_replies(where("SEN|STA", substitute(r"(?<=\d)\.(?=\d)", ","))),
        "number_format",
    ),
    _mutation(
        "empty GEO",
        of_replies(where("GEO", substitute(r"(\{Type [^}]*\}).*(?=\r)", r"\1"))),
        "robot_configuration",
        "sensor_configuration",
    ),
    _mutation("no answer to GETGEO", of_commands(where("GETGEO", drop)), "robot_configuration"),
    _mutation("no answer to GETCONF", of_commands(where("GETCONF", drop)), "robot_configuration"),
    _mutation("lower case not understood", of_commands(_drop_lower_case), "spelling"),
    _mutation("INIT without Name dropped", of_commands(where(r"INIT(?!.*\{Name )", drop)), "spawn"),
    _mutation("StartPoses with a wrong count", of_replies(_count_one_more), "start_poses"),
    _mutation(
        "StartPoses with blanks between vectors",
        of_replies(where(r"NFO \{StartPoses", substitute(r"(?<=\d) (?=-?\d)", ", "))),
        "start_poses",
    ),
    _mutation(
        "sonars one line each",
        of_replies(where(r"SEN .*\{Type Sonar\}", split_items)),
        "sensor_fields",
    ),
    _mutation(
        "Sonar without Time",
        of_replies(where(r"SEN .*\{Type Sonar\}", substitute(r" \{Time [^}]*\}", ""))),
        "sensor_fields",
    ),
    _mutation(
        "GEO in separate blocks",
        of_replies(where("GEO", substitute(r" (Location|Orientation|Mount) ", r"} {\1 "))),
        "sensor_configuration",
    ),
    _mutation(
        "CONF with Panning", of_replies(substitute("{Paning ", "{Panning ")), "sensor_configuration"
    ),
    _mutation(
        "SEN lines of type Camera", of_replies(where("STA", _add_camera_reading)), "sensor_fields"
    ),
    _mutation(
        "exponents", of_replies(where("SEN", scale("Pose", (1.0,), "%.3e"))), "number_format"
    ),
    _mutation("LF instead of CR LF", of_replies(substitute("\r", "")), "line_format"),
)

MEANING_MUTATIONS = (
    _mutation("no DRIVE", of_commands(where("DRIVE", drop)), "drive_forward"),
    _mutation(
        "DRIVE 57 times slower",
        of_commands(where("DRIVE", scale("Left|Right", (1.0 / _DEGREES,)))),
        "drive_forward",
    ),
    _mutation(
        "Left and Right swapped",
        of_commands(where("DRIVE", swap_sides)),
        "drive_curve",
        "drive_pivot",
    ),
    _mutation(
        "scan reversed", of_replies(reorder_ranges(lambda ranges: ranges[::-1])), "scan_turn"
    ),
    _mutation("no scan at all", of_replies(where("SEN .*RangeScanner", drop)), "sensors_report"),
    _mutation(
        "Rotation of INIT ignored", of_commands(substitute(r"\{Rotation [^}]*\}", "")), "spawn_pose"
    ),
    _mutation(
        "Normalized ignored",
        of_commands(substitute(r"\{Normalized [^}]*\}", "")),
        "drive_normalized",
    ),
    _mutation("RES dropped", of_replies(where("RES", drop)), "set_unknown"),
    _mutation("RES always OK", of_replies(substitute("Status Failed", "Status OK")), "set_unknown"),
    _mutation(
        "Location of INIT ignored",
        of_commands(where("INIT.*Rotation", scale("Location", (0.0,)))),
        "spawn_pose",
    ),
    _mutation(
        "standing ignored", of_commands(where(r"DRIVE \{Left 0\} \{Right 0\}", drop)), "drive_stop"
    ),
)

CONTROL_MUTATIONS: tuple[Mutation, ...] = (
    *TEXT_MUTATIONS,
    *MEANING_MUTATIONS,
)
