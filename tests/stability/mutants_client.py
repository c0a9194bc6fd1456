"""Naive forms of the client's formulas: localisation and landmarks."""

from __future__ import annotations

from stability.mutations import Mutation

MUTATIONS: list[Mutation] = []
