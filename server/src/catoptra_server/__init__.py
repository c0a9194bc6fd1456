"""Omnidirectional camera server: simulated robots, rendered frames, USARSim's protocol, ZeroMQ."""
