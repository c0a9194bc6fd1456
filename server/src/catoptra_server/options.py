"""Options of the server, as its command line states them."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_server.config.server_file import ServerOptions
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MIB
from catoptra_server.simulation import ClockMode


@dataclass(frozen=True, slots=True)
class Options:
    """Options of the server, as the command line states them."""

    robot_files: tuple[Path, ...]
    """Robot files; INIT chooses among the robots of all of them."""
    world_file: Path
    """World file."""
    server_file: Path | None = None
    """File with UDK's sections for the server; overrides those of robot files."""
    server_options: ServerOptions = field(default_factory=ServerOptions)
    """Options that override the same ones of any file."""
    host: str = "127.0.0.1"
    """Address of all ports."""
    stream_port: int | None = None
    """Port of the ZeroMQ stream, 0 = any free one; None = 5005, or any free one if another is 0."""
    has_view: bool = True
    """Whether the live page is served."""
    view_port: int | None = None
    """Port of the live page, 0 = any free one; None = 5080, or any free one if 5080 is in use or
    another port is 0."""
    dialect: Dialect = Dialect.UT2004
    """Dialect of the control port."""
    renderer: str = "auto"
    """`auto`, `trace` or `raster`."""
    threads: int = 0
    """Threads of the trace renderer; 0 = one per processor."""
    instruction_set: str = "auto"
    """Instruction set of the trace renderer's kernel: `auto`, or a smaller one than the
    processor's, for the same bytes on several machines."""
    clock: ClockMode = ClockMode.REALTIME
    """Real time, or lockstep with the commands of clients."""
    is_strict: bool = False
    """Whether unknown keys of all sections of files are errors."""
    seed: int = 0
    """Seed of all random numbers."""
    max_error_px: float | None = None
    """Tolerance of every camera, pixels; None = that of the robot's file."""
    budget_ms: float | None = None
    """Time budget of every camera, milliseconds per frame; None = that of the robot's file."""
    memory_limit_mib: int = DEFAULT_LIMIT_BYTES // MIB
    """Memory that each camera's view may take, and the world's meshes and textures together."""
