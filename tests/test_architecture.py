"""ARCHITECTURE.md is true: recipes, journeys and decisions name what exists, tables are guarded.

A guard is a plain function from a table to the entries that some part of the repository
lacks: specification, vectors, configuration, dispatch. Each finds nothing in the real table, and
a dummy entry, added in memory, in every part that its recipe names.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import pytest

from catoptra_protocol.camera_conf import LENS_PARAMETERS, MIRROR_PARAMETERS
from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.mirrors import MIRRORS
from catoptra_protocol.stream.messages import request_from_bytes
from catoptra_protocol.stream.replies import REPLIES
from catoptra_protocol.stream.requests import REQUESTS
from catoptra_protocol.usarsim.commands import COMMAND_PARSERS, command_from_message
from catoptra_protocol.usarsim.grammar import Message, parse_message
from catoptra_protocol.usarsim.readings import READING_PARSERS
from catoptra_protocol.usarsim.reports import REPORT_PARSERS, report_from_message
from catoptra_server.effects import EFFECT_TYPES, WORLD_EFFECTS, EffectType
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.frames.renderers import RENDERER_FACTORIES
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.kernel.image import STAGE_MAKERS
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.sensors import SENSOR_KINDS, SensorKind
from catoptra_server.world.scene_mesh import build_scene
from catoptra_studies.effects.effect_cases import EFFECT_CASES
from helpers.configs import REPOSITORY
from helpers.robots import FakeClient, make_p2at, make_walled_world
from helpers.stream_messages import SAMPLE_REPLIES, SAMPLE_REQUESTS

ARCHITECTURE = REPOSITORY / "ARCHITECTURE.md"
SPECIFICATION = REPOSITORY / "protocol/SPEC.md"
README = REPOSITORY / "README.md"
EFFECTS_PAGE = REPOSITORY / "docs/EFFECTS.md"
CONFIGURATIONS_PAGE = REPOSITORY / "configs/README.md"
PROTOCOL = REPOSITORY / "protocol/src/catoptra_protocol"
SERVER = REPOSITORY / "server/src/catoptra_server"
TESTS = REPOSITORY / "tests"
DATA = REPOSITORY / "tests/conformance/data"
DUMMY = "dummy"
INI_KEY = re.compile(r'\.(?:get|has)_\w+\(\s*"(\w+)"')


@cache
def text_of(path: Path) -> str:
    """Contents of a file."""
    return path.read_text(encoding="utf-8")


@cache
def chapter(title: str) -> str:
    """One chapter of ARCHITECTURE.md, without its title."""
    return text_of(ARCHITECTURE).partition(f"\n## {title}\n")[2].partition("\n## ")[0]


# --- Citations of the form `frames/mailbox.py:Mailbox.put`, `sensors/<name>.py`, `configs/robots`.

CODE = re.compile(r"`([\w./<>-]+/[\w.<>-]+|[\w<>]+\.(?:py|md|toml))(?::([\w.]+))?`")
ROOTS = [
    *(REPOSITORY / each / "src" / f"catoptra_{each}" for each in ("protocol", "server", "client")),
    REPOSITORY / "studies/src/catoptra_studies",
    REPOSITORY,
]


def is_defined(name: str, source: str) -> bool:
    """Whether a dotted name is a function, class, constant or field of a module."""
    scope: Sequence[ast.stmt] = ast.parse(source).body
    for part in name.split("."):
        found = [node for node in scope if part in defined_names(node)]
        if not found:
            return False
        scope = getattr(found[0], "body", ())
    return True


def defined_names(node: ast.stmt) -> list[str]:
    """Names that a statement of a module or class defines."""
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.Assign(targets=targets):
            return [target.id for target in targets if isinstance(target, ast.Name)]
        case ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
        case _:
            return []


def find_cited(path: str) -> list[Path]:
    """Files or folders that a citation means; a `<name>` in it stands for any."""
    pattern = re.sub(r"<\w+>", "*", path)
    return [found for root in ROOTS for found in root.glob(pattern)]


def dead_citations(text: str) -> list[str]:
    """Citations of a text whose file does not exist, or does not define the name."""
    dead = []
    for path, name in CODE.findall(text):
        found = find_cited(path)
        if not found or (name and not any(is_defined(name, text_of(each)) for each in found)):
            dead.append(f"{path}:{name}")
    return dead


@pytest.mark.parametrize(
    "title", ["Layout", "Journeys", "Where a newcomer adds things", "Decisions"]
)
def test_chapter_when_read_names_files_and_names_that_exist(title: str) -> None:
    assert CODE.search(chapter(title))
    assert dead_citations(chapter(title)) == []


def test_citation_when_dead_is_found() -> None:
    alive = "`frames/mailbox.py:Mailbox`, `optics/lenses/<name>.py`, `configs/robots/p2at_omni.ini`"
    assert dead_citations(alive) == []
    dead = (
        "`frames/missing.py`, `frames/mailbox.py:Missing`, `missing/<name>.py`, "
        "`frames/mailbox.py:Mailbox.capture_s`, `landmarks/detector.py:Detector.detect`"
    )
    assert len(dead_citations(dead)) == 5


def test_recipes_when_read_have_four_columns_each() -> None:
    rows = [line for line in chapter("Where a newcomer adds things").splitlines() if "|" in line]
    assert len(rows) > 10
    assert {line.count("|") - line.count("\\|") for line in rows} == {5}


# --- Guards. Each returns entries of a table that a part of the repository does not know.


def missing_in(path: Path, entries: Iterable[str], form: str = "`{}`") -> list[str]:
    """Entries that a document does not mention, in backticks unless another form is given."""
    text = text_of(path).lower()
    return [entry for entry in entries if form.format(entry).lower() not in text]


def words_without_vector(channel: str, words: Iterable[str]) -> list[str]:
    """First words of lines that no vector of a channel contains."""
    lines = b"\n".join(path.read_bytes() for path in sorted((DATA / channel).glob("*.bytes")))
    return [word for word in words if not re.search(rf"(?i)\b{word}\b".encode(), lines)]


@dataclass(frozen=True)
class DummyCommand:
    """A command that is in its table alone."""

    WORD: ClassVar[str] = "DUMMY"

    @classmethod
    def from_message(cls, message: Message) -> DummyCommand:
        return cls()


def test_commands_are_specified_and_have_vectors() -> None:
    assert missing_in(SPECIFICATION, COMMAND_PARSERS, "{}") == []
    assert words_without_vector("commands", COMMAND_PARSERS) == []


def test_command_when_added_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(COMMAND_PARSERS, "DUMMY", DummyCommand.from_message)  # type: ignore[arg-type]
    command = command_from_message(parse_message("DUMMY"))
    assert isinstance(command, DummyCommand)
    assert missing_in(SPECIFICATION, COMMAND_PARSERS, "{}") == ["DUMMY"]
    assert words_without_vector("commands", COMMAND_PARSERS) == ["DUMMY"]
    fleet = Fleet([make_p2at()], (world := make_walled_world()), build_scene(world), seed=1)
    with pytest.raises(AssertionError, match="DummyCommand"):
        fleet.execute(FakeClient(), command, 0.0)


def test_reports_are_specified_and_have_vectors() -> None:
    assert missing_in(SPECIFICATION, REPORT_PARSERS, "{}") == []
    assert words_without_vector("reports", REPORT_PARSERS) == []


def test_report_when_added_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(REPORT_PARSERS, "DUMMY", lambda message: DUMMY)  # type: ignore[dict-item]
    assert report_from_message(parse_message("DUMMY {Time 1.0}")) == DUMMY
    assert missing_in(SPECIFICATION, REPORT_PARSERS, "{}") == ["DUMMY"]
    assert words_without_vector("reports", REPORT_PARSERS) == ["DUMMY"]


def readings_without_vector(types: Iterable[str]) -> list[str]:
    """Sensor types of which no vector of a server holds a SEN line."""
    lines = b"\n".join(path.read_bytes() for path in sorted((DATA / "reports").glob("*.bytes")))
    return [each for each in types if not re.search(rf"(?i)\{{Type {each}\}}".encode(), lines)]


# Several classes of robot files share a kind.
KINDS = [*dict.fromkeys(SENSOR_KINDS.values())]


def sensors_without_reading(kinds: Iterable[SensorKind]) -> list[str]:
    """Classes of sensors in robot files whose readings no client could parse."""
    unknown = []
    for kind in kinds:
        # A class carries UT2004's name, UDK's, or the one of its line: one of them is on the wire.
        if not any(name.startswith(known) for name in kind.readers for known in READING_PARSERS):
            unknown += list(kind.readers)
    return unknown


def keys_not_documented(folder: Path) -> list[str]:
    """Keys that modules of a folder read and the page of configurations does not name."""
    page = text_of(CONFIGURATIONS_PAGE).lower()
    read = {key for path in folder.glob("*.py") for key in INI_KEY.findall(text_of(path))}
    return sorted(key for key in read if not re.search(rf"\b{key}\b".lower(), page))


def test_keys_of_sensors_are_documented(tmp_path: Path) -> None:
    assert keys_not_documented(SERVER / "simulation/sensors") == []
    reader = 'section.get_float("MaxRange"), section.get_float("DummyKey", 1.0)'
    (tmp_path / "dummy.py").write_text(reader, encoding="utf-8")
    assert keys_not_documented(tmp_path) == ["DummyKey"]


def test_sensors_are_specified_and_have_readings_and_vectors() -> None:
    assert sensors_without_reading(KINDS) == []
    assert missing_in(SPECIFICATION, READING_PARSERS, "type {}") == []
    assert readings_without_vector(READING_PARSERS) == []


def test_sensor_when_added_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = SensorKind(DUMMY, int, lambda *parts: parts, {DUMMY: lambda item: item})  # type: ignore[arg-type, return-value]
    assert sensors_without_reading((*KINDS, kind)) == [DUMMY]
    monkeypatch.setitem(READING_PARSERS, DUMMY, lambda message: DUMMY)  # type: ignore[arg-type, return-value]
    assert sensors_without_reading((*KINDS, kind)) == []
    assert report_from_message(parse_message("SEN {Type Dummy}")) == DUMMY
    assert missing_in(SPECIFICATION, READING_PARSERS, "type {}") == [DUMMY]
    assert readings_without_vector(READING_PARSERS) == [DUMMY]


@dataclass(frozen=True)
class DummyMessage:
    """A message of the stream that is in its table alone."""

    KIND: ClassVar[str] = DUMMY

    id: int


def kinds_without_vector(kinds: Iterable[str]) -> list[str]:
    """Kinds of the stream's messages that no vector contains."""
    data = b"".join(path.read_bytes() for path in sorted((DATA / "stream").glob("*.bytes")))
    return [kind for kind in kinds if msgpack_str(kind) not in data]


def msgpack_str(text: str) -> bytes:
    """A short string as msgpack encodes it (fixstr)."""
    return bytes([0xA0 | len(text)]) + text.encode()


def kinds_without_sample(kinds: Iterable[str], samples: Iterable[Any]) -> list[str]:
    """Kinds that the tests of the codec do not send: `helpers.stream_messages` lacks a sample."""
    known = {sample.KIND for sample in samples}
    return [kind for kind in kinds if kind not in known]


@pytest.mark.parametrize("table", [REQUESTS, REPLIES])
def test_stream_messages_are_specified_and_have_vectors(table: dict[str, Any]) -> None:
    assert missing_in(SPECIFICATION, table) == []
    assert kinds_without_vector(table) == []
    assert kinds_without_sample(table, (*SAMPLE_REQUESTS, *SAMPLE_REPLIES)) == []


def test_stream_request_when_added_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(REQUESTS, DUMMY, DummyMessage)  # type: ignore[arg-type]
    assert request_from_bytes(msgpack_map(kind=DUMMY, id=7)) == DummyMessage(7)
    assert missing_in(SPECIFICATION, REQUESTS) == [DUMMY]
    assert kinds_without_vector(REQUESTS) == [DUMMY]
    assert kinds_without_sample(REQUESTS, SAMPLE_REQUESTS) == [DUMMY]


def msgpack_map(*, kind: str, id: int) -> bytes:
    """A map of a short string and a small number, as msgpack encodes them."""
    pairs = msgpack_str("kind") + msgpack_str(kind) + msgpack_str("id") + bytes([id])
    return bytes([0x82]) + pairs


def effects_without_case(names: Iterable[str]) -> list[str]:
    """Effects without a page in `make effects`."""
    # Those of worlds have their pictures in docs/EFFECTS.md: the field has no such light.
    shown = {case.effect.name for case in EFFECT_CASES} | {*WORLD_EFFECTS}
    return [name for name in names if name not in shown]


def effects_without_stage(names: Iterable[str]) -> list[str]:
    """Effects of the image that the kernel has no stage for."""
    scene = {path.stem for path in (SERVER / "effects/scene").glob("*.py")}
    stems = {name: re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower() for name in names}
    return [name for name in names if stems[name] not in scene and name not in STAGE_MAKERS]


def test_effects_are_documented_shown_and_have_stages() -> None:
    names = [*EFFECT_TYPES]
    assert missing_in(EFFECTS_PAGE, names) == []
    assert missing_in(CONFIGURATIONS_PAGE, names, "{}") == []
    assert effects_without_case(names) == []
    assert effects_without_stage(names) == []


def test_effect_when_added_is_noticed() -> None:
    names = [*EFFECT_TYPES, EffectType("DummyEffect", Vignetting).name]
    assert missing_in(EFFECTS_PAGE, names) == ["DummyEffect"]
    assert missing_in(CONFIGURATIONS_PAGE, names, "{}") == ["DummyEffect"]
    assert effects_without_case(names) == ["DummyEffect"]
    assert effects_without_stage(names) == ["DummyEffect"]


def models_without_parameters(names: Iterable[str], table: Mapping[str, object]) -> list[str]:
    """Mirrors or lenses that no CONF line can carry."""
    return [name for name in names if name not in table]


def mirrors_not_configurable(names: Iterable[str]) -> list[str]:
    """Mirrors that no robot file can name."""
    section = text_of(SERVER / "config/mirror_camera.py").lower()
    return [name for name in names if f'"{name.replace("_", "")}mirror"' not in section]


def mirrors_not_documented(names: Iterable[str]) -> list[str]:
    """Mirrors without a row of the page of configurations."""
    page = text_of(CONFIGURATIONS_PAGE).lower()
    return [name for name in names if f"`[catoptra.{name.replace('_', '')}mirror]`" not in page]


def models_without_hard_cases(names: Iterable[str]) -> list[str]:
    """Mirrors and lenses whose formulas the catalogue of hard cases does not name."""
    cases = " ".join(path.as_posix() for path in (TESTS / "stability/cases").rglob("*.json"))
    return [name for name in names if name not in cases]


def test_mirrors_are_specified_configurable_and_have_hard_cases() -> None:
    assert missing_in(SPECIFICATION, MIRRORS) == []
    assert models_without_parameters(MIRRORS, MIRROR_PARAMETERS) == []
    assert mirrors_not_configurable(MIRRORS) == []
    assert mirrors_not_documented(MIRRORS) == []
    assert models_without_hard_cases(MIRRORS) == []


def test_mirror_when_added_is_noticed() -> None:
    names = [*MIRRORS, DUMMY]
    assert missing_in(SPECIFICATION, names) == [DUMMY]
    assert models_without_parameters(names, MIRROR_PARAMETERS) == [DUMMY]
    assert mirrors_not_configurable(names) == [DUMMY]
    assert mirrors_not_documented(names) == [DUMMY]
    assert models_without_hard_cases(names) == [DUMMY]


def test_lenses_are_specified_and_have_parameters_and_hard_cases() -> None:
    assert missing_in(SPECIFICATION, LENSES) == []
    assert models_without_parameters(LENSES, LENS_PARAMETERS) == []
    assert models_without_hard_cases(LENSES) == []


def test_lens_when_added_is_noticed() -> None:
    names = [*LENSES, DUMMY]
    assert missing_in(SPECIFICATION, names) == [DUMMY]
    assert models_without_parameters(names, LENS_PARAMETERS) == [DUMMY]
    assert models_without_hard_cases(names) == [DUMMY]


# Families of equals: a folder with one module each, and the modules that their table names.
# Modules without a line are bases and tools that several of them use.
FAMILIES: dict[str, tuple[Path, set[str], set[str]]] = {
    "lenses": (
        PROTOCOL / "optics/lenses",
        {type_.__module__ for type_ in LENSES.values()},
        {"angle_polynomial", "centred_lens"},
    ),
    "mirrors": (
        PROTOCOL / "optics/mirrors",
        {type_.__module__ for type_ in MIRRORS.values()},
        {"mirror", "non_central"},
    ),
    "sensors": (
        SERVER / "simulation/sensors",
        {kind.description.__module__ for kind in KINDS},
        {"mission_package", "omni_camera", "perspective_camera", "sensor"},
    ),
    **{
        f"effects of the {folder}": (
            SERVER / "effects" / folder,
            {
                module
                for effect in EFFECT_TYPES.values()
                if f".effects.{folder}." in (module := effect.factory.__module__)
            },
            set(),
        )
        for folder in ("scene", "medium", "mirror", "sensor")
    },
}


def modules_without_line(folder: Path, listed: Iterable[str], tools: Iterable[str]) -> list[str]:
    """Modules of a family that its table does not name."""
    known = {name.rpartition(".")[2] for name in listed} | {*tools, "__init__"}
    return sorted({path.stem for path in folder.glob("*.py")} - known)


def modules_without_test(folder: Path, listed: Iterable[str]) -> list[str]:
    """Modules of a family without a test file of their name, in the mirror of the folder."""
    distribution, _, package = folder.relative_to(REPOSITORY).parts[:3]
    mirror = TESTS / distribution / folder.relative_to(REPOSITORY / distribution / "src" / package)
    stems = {name.rpartition(".")[2] for name in listed}
    return sorted(each for each in stems if not (mirror / f"test_{each}.py").is_file())


@pytest.mark.parametrize("family", FAMILIES)
def test_family_has_a_line_and_a_test_for_each_module(family: str) -> None:
    folder, listed, tools = FAMILIES[family]
    assert modules_without_line(folder, listed, tools) == []
    assert len(modules_without_line(folder, (), ())) > 1
    assert modules_without_test(folder, listed) == []
    assert modules_without_test(folder, [*listed, DUMMY]) == [DUMMY]


def test_module_when_its_line_is_forgotten_is_noticed() -> None:
    folder, listed, tools = FAMILIES["lenses"]
    forgotten = LENSES["equisolid"].__module__
    assert modules_without_line(folder, listed - {forgotten}, tools) == ["equisolid"]


def renderers_without_factory(names: Iterable[str]) -> list[str]:
    """Renderers that no function creates."""
    known = {kind.value for kind in RENDERER_FACTORIES}
    return [name for name in names if name not in known]


def renderers_without_folder(names: Iterable[str]) -> list[str]:
    """Renderers without a package of their own."""
    return [name for name in names if not (SERVER / "render" / name).is_dir()]


def test_renderer_when_added_is_noticed() -> None:
    names = [kind.value for kind in RendererKind]
    assert missing_in(README, names, "{}") == []
    assert renderers_without_factory(names) == []
    assert renderers_without_folder(names) == []
    assert missing_in(README, [*names, DUMMY], "{}") == [DUMMY]
    assert renderers_without_factory([*names, DUMMY]) == [DUMMY]
    assert renderers_without_folder([*names, DUMMY]) == [DUMMY]
