"""`catoptra-server doctor`: what this machine, this installation and these files can do.

Each check is a file that returns findings; each finding that is a problem says its remedy. What may
crash, such as a driver, is tried in a process of its own.
"""
