"""The documented example of the solver in Python runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[3] / "docs/python.md"


def test_the_documented_example_runs(capsys) -> None:
    *_, code = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, "python.md", "exec"), names)
    said = capsys.readouterr().out
    assert "converged" in said
    assert "no sighting can tell when common time begins" in said
    offset, sigma = (float(x) for x in re.findall(r"offset (\S+) \+- (\S+) s", said)[0])
    assert abs(offset - names["truth"].offset_s["uav2"]) < 4 * sigma
