"""`python -m stability.mutations`: replace each formula by a mutant; a case must fail.

A catalogue that a mutant passes would prove nothing. Each mutation names the function to
replace, in the module that looks the function up, and the group whose cases must fail. The lists
are in `mutants_<half>.py`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from unittest.mock import patch

from stability.catalogue import Subject, failing_messages

# Modules that have a list MUTATIONS.
LISTS = ("stability.mutants_client", "stability.mutants_optics", "stability.mutants_cameras")


@dataclass(frozen=True, slots=True)
class Mutation:
    """Mutant that replaces `target`, a dotted name; a case of `group` must fail."""

    name: str
    group: str
    target: str
    mutant: Callable[..., Any]


def all_mutations() -> list[Mutation]:
    """Mutations of every list."""
    return [mutation for name in LISTS for mutation in import_module(name).MUTATIONS]


def subjects_of(group: str) -> Mapping[str, Subject]:
    """Subjects of a group."""
    subjects: Mapping[str, Subject] = import_module(f"stability.subjects.{group}").SUBJECTS
    return subjects


def failing_cases(mutation: Mutation) -> list[str]:
    """Messages of the cases that fail with a mutation; empty if no case detects the mutation."""
    with patch(mutation.target, mutation.mutant):
        return failing_messages(mutation.group, subjects_of(mutation.group))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the number of failing cases of each mutation; 1 if a mutation goes undetected."""
    parser = argparse.ArgumentParser(prog="stability.mutations", description=__doc__)
    parser.add_argument("--group", help="only this group's")
    selected_group = parser.parse_args(arguments).group
    undetected = 0
    for mutation in all_mutations():
        if selected_group in (None, mutation.group):
            found = failing_cases(mutation)
            undetected += not found
            print(f"{mutation.group:12} {mutation.name:60} {len(found):4} cases fail")
    return 1 if undetected else 0


if __name__ == "__main__":
    sys.exit(main())
