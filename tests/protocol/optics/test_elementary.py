"""Elementary functions against 50 digits, and products of matrices against NumPy's."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import mpmath
import numpy as np
import pytest

from catoptra_protocol.optics import elementary
from catoptra_protocol.optics.elementary import Floats
from helpers.configs import REPOSITORY

RANDOM = np.random.default_rng(1)
TURNS = np.arange(-40, 40) * (0.25 * math.pi)
ANGLES = np.concatenate((RANDOM.uniform(-7, 7, 500), RANDOM.uniform(-1e6, 1e6, 500), TURNS))
TINY = np.ldexp(RANDOM.uniform(-1, 1, 200), RANDOM.integers(-300, 1, 200))
LARGE = np.ldexp(RANDOM.uniform(-1, 1, 200), RANDOM.integers(0, 300, 200))
SINES = np.concatenate((RANDOM.uniform(-1, 1, 500), 1 - np.ldexp(1.0, -np.arange(1, 53)), TINY))
POSITIVE = np.concatenate((RANDOM.uniform(0, 3, 500), np.abs(LARGE), np.abs(TINY), [1.0, 0.5]))
# Arguments, and the largest error in units of the last place, of the table in `elementary.py`.
FUNCTIONS: dict[str, tuple[Floats, Callable[..., mpmath.mpf], float]] = {
    "sin": (np.concatenate((ANGLES, TINY)), mpmath.sin, 1.0),
    "cos": (np.concatenate((ANGLES, TINY)), mpmath.cos, 1.0),
    "tan": (np.concatenate((ANGLES, TINY)), mpmath.tan, 3.0),
    "arctan": (np.concatenate((RANDOM.uniform(-4, 4, 500), TINY, LARGE)), mpmath.atan, 2.0),
    "arcsin": (SINES, mpmath.asin, 3.0),
    "arccos": (SINES, mpmath.acos, 3.0),
    "exp": (np.concatenate((RANDOM.uniform(-700, 700, 500), TINY)), mpmath.exp, 1.0),
    "ln": (POSITIVE, mpmath.log, 1.0),
}


def errors_in_ulps(found: Floats, expected: list[mpmath.mpf]) -> Floats:
    """Errors in units of the last place of the results."""
    units = np.spacing(np.abs(found))
    pairs = zip(found.tolist(), expected, units.tolist(), strict=True)
    return np.array([float(abs(mpmath.mpf(f) - e) / u) for f, e, u in pairs])


@pytest.fixture(autouse=True)
def digits() -> Iterator[None]:
    with mpmath.workdps(50):
        yield


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_has_its_stated_error(name: str) -> None:
    arguments, reference, limit = FUNCTIONS[name]
    found = getattr(elementary, name)(arguments)
    expected = [reference(mpmath.mpf(x)) for x in arguments.tolist()]
    is_normal = np.abs(found) > 1e-300
    assert errors_in_ulps(found, expected)[is_normal].max() <= limit


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_of_a_float_has_the_bits_of_the_array(name: str) -> None:
    arguments = np.concatenate((FUNCTIONS[name][0], [0.0] if name == "ln" else [0.0, -0.0]))
    function = getattr(elementary, name)
    alone = np.array([function(x) for x in arguments.tolist()])
    assert alone.tobytes() == function(arguments).tobytes()


@pytest.mark.parametrize("exponent", [1 / 2.4, 2.4, -0.7])
def test_power_has_its_stated_error(exponent: float) -> None:
    bases = RANDOM.uniform(1e-3, 1.0, 500)
    expected = [mpmath.mpf(x) ** mpmath.mpf(exponent) for x in bases.tolist()]
    errors = errors_in_ulps(elementary.power(bases, exponent), expected)
    assert (errors <= 1.0 + np.abs(exponent * np.log(bases))).all()


def test_power_of_zero_is_zero() -> None:
    assert elementary.power(np.array([0.0]), 0.4) == 0.0


def test_hypot_and_arctan2_have_their_stated_errors_at_any_size() -> None:
    sizes = RANDOM.integers(-300, 300, 500)
    y, x = (np.ldexp(RANDOM.normal(size=500), sizes) for _ in range(2))
    pairs = [(mpmath.mpf(a), mpmath.mpf(b)) for a, b in zip(y.tolist(), x.tolist(), strict=True)]
    for name, reference, limit in (
        ("hypot", lambda a, b: mpmath.sqrt(a * a + b * b), 1.1),
        ("arctan2", mpmath.atan2, 2.0),
    ):
        function = getattr(elementary, name)
        found = function(y, x)
        assert errors_in_ulps(found, [reference(a, b) for a, b in pairs]).max() <= limit
        alone = [function(a, b) for a, b in zip(y.tolist(), x.tolist(), strict=True)]
        assert alone == found.tolist()


@np.errstate(invalid="ignore", over="ignore")
def test_special_values_are_those_of_numpy() -> None:
    special = np.array([0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, math.nan])
    y, x = np.meshgrid(special, special)
    for name in ("arctan2", "hypot"):
        found, expected = getattr(elementary, name)(y, x), getattr(np, name)(y, x)
        known = ~(np.isnan(x) | np.isnan(y))
        np.testing.assert_array_equal(found[known], expected[known])
        np.testing.assert_array_equal(np.signbit(found[known]), np.signbit(expected[known]))
    for name in ("sin", "arctan", "exp", "tan"):
        np.testing.assert_array_equal(
            getattr(elementary, name)(special[[0, 1, 6]]), getattr(np, name)(special[[0, 1, 6]])
        )
    np.testing.assert_array_equal(elementary.exp(special[4:6]), [math.inf, 0.0])
    logarithms = elementary.ln(np.array([0.0, -1.0, math.inf, math.nan]))
    np.testing.assert_array_equal(logarithms, [-math.inf, math.nan, math.inf, math.nan])


@pytest.mark.parametrize(
    ("left", "right"),
    [((3, 3), (3, 3)), ((3,), (3, 3)), ((3, 3), (3,)), ((5, 3), (3, 3)), ((3,), (3, 6)),
     ((4, 3, 3), (4, 3, 3)), ((4, 1, 3), (4, 3, 1)), ((7, 20), (20, 3)), ((20,), (20,)),
     ((3, 1, 3), (3, 3, 1)), ((1, 6, 3), (4, 3, 3)), ((6, 12), (12,))],
)  # fmt: skip
def test_product_is_that_of_numpy(left: tuple[int, ...], right: tuple[int, ...]) -> None:
    a, b = RANDOM.normal(size=left), RANDOM.normal(size=right)
    found = elementary.matmul(a, b)
    np.testing.assert_allclose(found, a @ b, rtol=1e-13, atol=1e-13)
    assert np.shape(found) == np.shape(a @ b)


@pytest.mark.parametrize("subscripts", ["ni,ni->n", "nij,nj->ni", "kei,kci->kec", "ki,kij->jk"])
def test_sum_over_an_index_is_that_of_numpy(subscripts: str) -> None:
    sizes = {"n": 5, "i": 3, "j": 3, "k": 4, "e": 3, "c": 2}
    names = subscripts.partition("->")[0].split(",")
    a, b = (RANDOM.normal(size=[sizes[letter] for letter in letters]) for letters in names)
    expected = np.einsum(subscripts, a, b)
    np.testing.assert_allclose(elementary.einsum(subscripts, a, b), expected, atol=1e-13)


def test_systems_are_solved() -> None:
    matrices = RANDOM.normal(size=(50, 3, 3))
    matrices[0] = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    solutions = RANDOM.normal(size=(50, 3, 2))
    found = elementary.solve_linear(matrices, matrices @ solutions)
    np.testing.assert_allclose(found, solutions, rtol=1e-9, atol=1e-9)


def test_interpolation_is_that_of_numpy() -> None:
    knots, values = np.sort(RANDOM.normal(size=9)), RANDOM.normal(size=9)
    x = np.concatenate((RANDOM.uniform(-4.0, 4.0, 200), knots))
    found = elementary.interpolate_linear(x, knots, values)
    np.testing.assert_allclose(found, np.interp(x, knots, values), atol=1e-14)


# Libraries' functions whose last bits depend on the processor.
FORBIDDEN = re.compile(
    r"\bnp\.(sin|cos|tan|exp|exp2|expm1|log|log2|log10|log1p|power|float_power|arctan2?|arcsin"
    r"|arccos|hypot|cbrt|sinh|cosh|tanh|interp|geomspace|logspace|dot|einsum|matmul|inner"
    r"|tensordot|vdot|convolve|correlate)\b|\bmath\.(sin|cos|tan|exp|exp2|expm1|log|log2|log10"
    r"|log1p|pow|asin|acos|atan|atan2|hypot|dist|cbrt|sinh|cosh|tanh)\b"
    r"|np\.linalg\.(?!norm\b)|np\.polynomial\.(?!polynomial\.polyval)|\.(standard_)?normal\("
)
REMAINING = re.compile(r"(?<=[*,] )`([\w./]+)`")


def test_no_other_module_calls_a_function_whose_last_bits_depend_on_the_processor() -> None:
    listed = REMAINING.findall(elementary.__doc__ or "")
    assert len(listed) > 5
    found = set()
    for package in ("protocol/src/catoptra_protocol", "server/src/catoptra_server"):
        for path in (REPOSITORY / package).rglob("*.py"):
            name = path.relative_to(REPOSITORY / package).as_posix()
            if name != "optics/elementary.py" and calls_library(path):
                found.add(next((one for one in listed if name.startswith(one)), name))
    assert found == set(listed)


def calls_library(path: Path) -> bool:
    """Whether a module calls such a function, or multiplies arrays by `@`."""
    text = path.read_text(encoding="utf-8")
    nodes = [*ast.walk(ast.parse(text))]
    # Of poses, whose product is one of ours.
    arrays = [
        node
        for node in nodes
        if isinstance(node, ast.BinOp)
        and isinstance(node.op, ast.MatMult)
        and re.search(r"\.rotation|\.T\b|normals|corners", ast.unparse(node))
        and "Pose(" not in ast.unparse(node)
    ]
    code = "\n".join(line.partition("#")[0] for line in text.splitlines())
    return bool(FORBIDDEN.search(code) or arrays)
