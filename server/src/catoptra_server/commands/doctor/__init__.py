"""`catoptra-server doctor`: checks of the machine, the installation and configuration files.

`command` runs the checks and prints findings; a problem names its remedy.
`machine` needs no library, `devices` asks what may crash in a process of its own, whose side is
`__main__` and `self_test`.
"""

from __future__ import annotations
