"""The native kernel, C11 in `src/`, and the interface to it by ctypes; README.md describes both."""
