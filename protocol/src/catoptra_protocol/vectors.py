"""The alias of a vector of three numbers, shared by both protocols, the server and the client.

A plain tuple rather than an array: messages are compared, hashed and printed, never computed with.
"""

from __future__ import annotations

Vector3 = tuple[float, float, float]
