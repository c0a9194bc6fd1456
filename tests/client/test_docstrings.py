"""Docstrings of what users call: complete, with examples that call what exists."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable

import pytest

from catoptra_client.frame_sources import StreamClient
from catoptra_client.gym_environment import CatoptraEnv
from catoptra_client.robot_client import RobotClient

CLASSES = {"client": StreamClient, "robot": RobotClient, "env": CatoptraEnv}
EXAMPLE = re.compile(r"```python\n(.*?)```", re.DOTALL)


METHODS = [
    method
    for one in CLASSES.values()
    for name, method in vars(one).items()
    if inspect.isfunction(method) and not name.startswith("_")
]


def find_examples() -> list[ast.Module]:
    documented = [*CLASSES.values(), *METHODS]
    texts = [text for one in documented for text in EXAMPLE.findall(inspect.getdoc(one) or "")]
    return [ast.parse(textwrap.dedent(text)) for text in texts]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.__qualname__)
def test_method_documents_each_argument(method: Callable[..., object]) -> None:
    text = inspect.getdoc(method) or ""
    names = list(inspect.signature(method).parameters)[1:]
    inherited = "Args and errors are those of" in text
    assert text
    assert [name for name in names if f"\n    {name}: " not in text and not inherited] == []


def test_examples_call_methods_that_exist() -> None:
    called = [
        (node.value.id, node.attr)
        for example in find_examples()
        for node in ast.walk(example)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    ]
    ours = [(CLASSES[name], attribute) for name, attribute in called if name in CLASSES]
    assert len(ours) > 10
    assert [(one, attribute) for one, attribute in ours if not hasattr(one, attribute)] == []
