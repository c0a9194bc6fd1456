"""`catoptra-server doctor`: checks of the machine, the installation and configuration files.

Each check is a module that yields findings; a finding that is a problem names its remedy. A check
that may crash, such as one that loads a graphics driver, runs in a process of its own
(`subprocess_check`). To add a check, write its module and a line in `doctor_cli`.
"""

from __future__ import annotations
