"""A table of equals, such as the lens models, whose modules are imported at the first look-up.

A file names few of them, and to load a module takes about a millisecond. Names are known without
an import: choices, errors and membership load nothing. `values` and `items` load everything.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import TypeVar

_T = TypeVar("_T")


class LazyTable(Mapping[str, _T]):
    """Objects by name, in the order of their lines."""

    def __init__(self, package: str, lines: Mapping[str, str]) -> None:
        """Make a table.

        Args:
            package: Package of the modules.
            lines: By name, `module.attribute` in that package; several names may share an object.
        """
        self._places = {name: f"{package}.{place}" for name, place in lines.items()}

    def __getitem__(self, name: str) -> _T:
        """Object of a name, whose module is imported if it is not loaded."""
        module, _, attribute = self._places[name].rpartition(".")
        found: _T = getattr(import_module(module), attribute)
        return found

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(self._places)

    def __len__(self) -> int:
        """Number of names."""
        return len(self._places)

    def __contains__(self, name: object) -> bool:
        """Whether the table has a name."""
        return name in self._places

    def find_name(self, kind: type) -> str | None:
        """Name of a class; None for a class that the table lacks."""
        place = f"{kind.__module__}.{kind.__qualname__}"
        return next((name for name, each in self._places.items() if each == place), None)

    def find_present(self) -> list[_T]:
        """Objects of loaded modules, each once: those that an existing instance can be of."""
        names = {place: name for name, place in self._places.items()}
        return [
            self[name] for place, name in names.items() if place.rpartition(".")[0] in sys.modules
        ]

    def find_attribute(self, attribute: str) -> _T:
        """Object by its own name: `__getattr__` of a package that re-exports the table."""
        for name, place in self._places.items():
            if place.endswith(f".{attribute}"):
                return self[name]
        raise AttributeError(attribute)
