"""Translated loops do what Python does, and what cannot be translated is refused with its line."""

import ast

import numpy as np
import pytest

from native.translate import Program, UntranslatableError, is_parallel, read_unit

HEAD = "import math\nfrom typing import NamedTuple\nimport numpy as np\nHALF, TWO = 0.5, 2\n"
LOOPS = (
    HEAD
    + '''
class Pair(NamedTuple):
    """Two."""

    rows: Floats2
    count: int

@compiled
def _square(x: float) -> float:
    return x * x

@compiled
def summed(pair: Pair, out: Floats2) -> tuple[float, int]:
    """Doc."""
    rows, count = pair
    total, turns = 0.0, 0
    for i in range(len(rows) - 1, -1, -1):
        if i == count:
            continue
        for j in range(rows.shape[1]):
            out[i, j] = _square(rows[i, j]) + HALF
        total += rows[i, 0] if i > 0 else -rows[i, 0]
        turns += 1 if 0 < i <= TWO else 0
    out[count] = -1.0
    return total, turns

@compiled
def made(n: int, value: float) -> tuple[Floats, Ints, Floats]:
    a, b = np.full((n, 2), value), np.full(n, -1)
    for k in range(n // 2):
        b[k], b[n - 1 - k] = k, k + 1
    a[1:3] = 7.0
    part = a[n - 2 :]
    part[0, 1] = max(1, value)
    return a, b, a[0].copy()

@compiled
def bounded(x: Floats1, low: float) -> float:
    best: float = np.inf
    for i in range(len(x)):
        if not x[i] > low:
            return -1.0
        best = min(best, math.sqrt(x[i]) / TWO)
    return best
'''
)


def plain():
    places = {"compiled": lambda f: f, "Floats": None, "Ints": None, "Floats1": None, "Floats2": None}
    exec(LOOPS, places)
    return places


def test_loops_do_what_python_does(translated):
    native, python = translated(LOOPS), plain()
    rows = np.random.default_rng(0).normal(size=(5, 4))
    outs = []
    for function in (native("summed"), python["summed"]):
        out = np.zeros((5, 4))
        outs.append((*function((rows, 3), out), out))
    assert outs[0][0] == pytest.approx(outs[1][0], rel=1e-14)
    assert outs[0][1] == outs[1][1] == 2
    np.testing.assert_allclose(outs[0][2], outs[1][2], rtol=1e-14)
    for mine, theirs in zip(native("made")(6, 3.0), python["made"](6, 3.0), strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert mine.dtype == theirs.dtype
    for x in (np.array([4.0, 9.0]), np.array([4.0, np.nan]), np.array([4.0, np.inf]), np.zeros(0)):
        assert native("bounded")(x, 1.0) == python["bounded"](x, 1.0)


def test_arrays_that_are_not_contiguous_are_read_and_written(translated):
    summed = translated(LOOPS)("summed")
    rows, whole = np.random.default_rng(1).normal(size=(4, 5)).T, np.zeros((5, 8))
    summed((rows, 3), whole[:, ::2])
    np.testing.assert_allclose(whole[0, ::2], rows[0] ** 2 + 0.5)
    assert not whole[:, 1::2].any()
    frozen = rows.copy()
    frozen.setflags(write=False)
    summed((frozen, 3), np.zeros((5, 4)))


def test_wrong_arguments_are_type_errors(translated):
    native = translated(LOOPS)
    rows, out = np.zeros((5, 4)), np.zeros((5, 4))
    for given in (
        (rows, out),
        ((rows[0], 1), out),
        ((rows.astype(np.float32), 1), out),
        ((rows, 1),),
        ((rows, "1"), out),
    ):
        with pytest.raises(TypeError):
            native("summed")(*given)
    with pytest.raises(MemoryError):
        native("made")(10**15, 0.0)


@pytest.mark.parametrize(("body", "words"), [
    ("return [x]", "List is not translated"), ("return unknown(x)", "unknown is not a compiled function"),
    ("for y in x:\n        pass", "only loops over ranges"), ("return x[0] @ x[1]", "MatMult"),
    ("return x[::2]", "slice with a step"), ("i = 1.5\n    for i in range(3):\n        pass", "i counts a loop"),
    ("return nothing", "nothing is not known"), ("return x[-1]", "an index of type i: (-1)"),
])  # fmt: skip
def test_what_cannot_be_translated_is_refused_with_its_line(tmp_path, body, words):
    path = tmp_path / "loops.py"
    path.write_text(f"@compiled\ndef wrong(x: Floats1) -> float:\n    {body}\n")
    with pytest.raises(UntranslatableError, match=words.replace("(", r"\(").replace(")", r"\)")) as caught:
        Program({"loops": read_unit(path)}).exported()
    assert "loops" in str(caught.value)


@pytest.mark.parametrize(("body", "parallel"), [
    ("a[i] = b[i] + c[j, i]", True), ("s += a[i] * b[i]", True), ("a[i] = a[i - 1]", False), ("a[i] = a[0]", False),
    ("a[i, j] = b[i, j]", False), ("a[0] += b[i]", False), ("a[i] = f(b)", False), ("a[k[i]] = b[i]", False),
])  # fmt: skip
def test_only_loops_whose_turns_are_apart_are_said_to_be(body, parallel):
    loop = ast.parse(f"for i in range(n):\n    {body}").body[0]
    assert is_parallel(loop) is parallel
