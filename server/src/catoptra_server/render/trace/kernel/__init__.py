"""The native kernel: its library, and the interface to it by ctypes."""
