"""`python -m stability.mutations`: put the naive form in place of each formula; a case must fail.

A catalogue that a naive form passes would prove nothing. Each mutation names the function that it
replaces, where it is looked up, and the group whose cases must notice. The lists are in
`mutants_<half>.py`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from unittest.mock import patch

from stability.catalogue import Subject, failures

# Modules that have a list MUTATIONS.
LISTS = ("stability.mutants_client", "stability.mutants_optics")


@dataclass(frozen=True, slots=True)
class Mutation:
    """A naive form in place of `target`, a dotted name; `group` is whose cases must fail."""

    name: str
    group: str
    target: str
    naive: Callable[..., Any]


def all_mutations() -> list[Mutation]:
    """Return the mutations of every list."""
    return [mutation for name in LISTS for mutation in import_module(name).MUTATIONS]


def subjects_of(group: str) -> Mapping[str, Subject]:
    """Return the subjects of a group, as its test module names them."""
    subjects: Mapping[str, Subject] = import_module(f"stability.test_{group}").SUBJECTS
    return subjects


def noticed(mutation: Mutation) -> list[str]:
    """Return the cases that fail with a mutation; none means that it went unnoticed."""
    with patch(mutation.target, mutation.naive):
        return failures(mutation.group, subjects_of(mutation.group))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print each mutation with the number of cases that notice it; 1 if one goes unnoticed."""
    parser = argparse.ArgumentParser(prog="stability.mutations", description=__doc__)
    parser.add_argument("--group", help="only this group's")
    wanted = parser.parse_args(arguments).group
    unnoticed = 0
    for mutation in all_mutations():
        if wanted in (None, mutation.group):
            found = noticed(mutation)
            unnoticed += not found
            print(f"{mutation.group:12} {mutation.name:60} {len(found):4} cases fail")
    return 1 if unnoticed else 0


if __name__ == "__main__":
    sys.exit(main())
