"""Names that packages load on demand are those that type checkers see; solving loads nothing that it does not need."""

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]
PACKAGES = sorted(
    path.parent.relative_to(ROOT).as_posix().replace("/", ".")
    for room in ("calibration", "pipeline")
    for path in (ROOT / room).rglob("__init__.py")
    if "on_demand(" in path.read_text()
)
SLOW = ("numba", "pandas", "matplotlib", "rasterio", "scipy.interpolate", "scipy.optimize", "scipy.ndimage")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_name_is_found_where_type_checkers_find_it(package: str) -> None:
    module = importlib.import_module(package)
    seen: dict[str, str] = {}
    for node in ast.walk(ast.parse(Path(str(module.__file__)).read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(f"{package}."):
            seen |= {alias.asname or alias.name: node.module for alias in node.names}
    seen.pop("on_demand", None)
    assert sorted(module.__all__) == sorted(seen)
    modules = {inner.name for inner in pkgutil.iter_modules(module.__path__)}
    for name, home in seen.items():
        assert getattr(module, name) is getattr(importlib.import_module(home), name), name
        assert name not in modules, "a module of that name takes its place once it is loaded"
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        _ = module.nothing_of_the_kind


def test_there_are_such_packages() -> None:
    assert {"calibration", "pipeline.stages", "pipeline.tracking"} <= set(PACKAGES)


def test_solving_loads_nothing_slow_that_it_does_not_need() -> None:
    told = f"import sys; from pipeline import stages; stages.run_solve; print(*set({SLOW!r}) & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", told], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
