"""Sensors of a robot's section: items of `Sensors=` (UT2004) and `AddParts=` (UDK).

The classes, by the last part of a class's name, are those of `sensors.SENSOR_KINDS`; each kind has
its own reader. Parameters are in the section of the class; defaults are those of UDK's
DefaultUSAR.ini.
"""

from __future__ import annotations

import logging

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import read_mount
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.sensor_item import SensorItem
from catoptra_server.config.unknown_names import suggest_name
from catoptra_server.simulation.robot_description import SensorDescription
from catoptra_server.simulation.sensors import SENSOR_KINDS

log = logging.getLogger(__name__)

# Names of classes extend each other: RangeScanner3D (0.923) is no misspelt RangeScanner.
_MIN_SIMILARITY = 0.925

_READERS = {name: read for kind in SENSOR_KINDS for name, read in kind.readers.items()}


def item_class(item: SectionReader) -> str:
    """Class of an item without its package, in lower case."""
    return item.get_str("ItemClass").rpartition(".")[2].lower()


def is_sensor(item: SectionReader) -> bool:
    """Whether an item's class is a sensor of _READERS."""
    return item_class(item) in _READERS


def read_sensor(file: IniFile, robot: SectionReader, struct: SectionReader) -> SensorDescription:
    """Description of an item for which `is_sensor` holds."""
    item = SensorItem(
        struct=struct,
        name=struct.get_wire_name("ItemName"),
        mount=read_mount(robot, struct),
        section=file.get_section(struct.get_str("ItemClass")),
    )
    return _READERS[item_class(struct)](item)


def report_unknown_class(item: SectionReader) -> None:
    """Log a warning for an item of an unknown class, and none for each of its keys."""
    suggestion = suggest_name(item_class(item), _READERS, _MIN_SIMILARITY)
    log.warning(
        "%s: class %s is unknown: item %s has no effect%s",
        item.where,
        item.get_str("ItemClass"),
        item.get_str("ItemName", "without a name"),
        f"; did you mean {suggestion}?" if suggestion else "",
    )
    item.ignore_all()
