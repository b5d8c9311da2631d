"""The README's example of the solver in Python runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path

README = Path(__file__).parents[3] / "README.md"


def test_the_readme_example_runs(capsys) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, "README.md", "exec"), names)
    said = capsys.readouterr().out
    assert "converged" in said
    assert "no sighting can tell when common time begins" in said
    offset, sigma = (float(x) for x in re.findall(r"offset (\S+) \+- (\S+) s", said)[0])
    assert abs(offset - names["truth"].offset_s["uav2"]) < 4 * sigma
