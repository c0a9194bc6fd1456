"""Omnidirectional camera server: simulated robots, rendered frames, USARSim's protocol, ZeroMQ."""

# As in pyproject.toml. Not from the installed metadata: reading these takes 0.02 s of every start.
__version__ = "0.1.0"
