"""The simulated robot and its eye: reads ini files, renders, serves the USARSim protocol."""
