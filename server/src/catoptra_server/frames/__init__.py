"""From what the simulation wants shown to the bytes that travel.

A `Shot` says what to draw; the drawing thread makes a `Frame` of it; `encode` makes bytes of that.
"""
