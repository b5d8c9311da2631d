"""The mutation run draws the same mutants for a seed, and asks the right tests about them."""

import pytest

pytest.importorskip("cosmic_ray", reason="the extra `mutation` is not installed")

from scripts.validation import check_mutants
from scripts.validation.check_mutants import Mutant, acts, asked_tests, changed, left_behind

FAULT = Mutant(
    room="telemetry", path="pipeline/telemetry/heights/undulation.py", operator="core/AddNot", occurrence=0, line=1
)


def test_a_mutant_is_the_file_with_one_fault():
    after = changed(FAULT)
    before = (check_mutants.ROOT / FAULT.path).read_text(encoding="utf-8")
    different = [(a, b) for a, b in zip(before.splitlines(), after.splitlines(), strict=True) if a != b]
    assert len(different) == 1
    assert "not" in different[0][1]


def test_the_files_that_name_the_module_are_asked_first():
    residuals = Mutant(
        room="solver", path="pipeline/solver/observation/residuals.py", operator="core/AddNot", occurrence=0, line=1
    )
    groups = asked_tests(residuals)
    texts = [(check_mutants.ROOT / name).read_text(encoding="utf-8") for name in groups[0]]
    assert all("residuals" in text for text in texts)
    assert not {name for group in groups[1:] for name in group} & set(groups[0])


def test_imports_are_left_alone():
    first = (check_mutants.ROOT / FAULT.path).read_text(encoding="utf-8").splitlines()
    line = next(i for i, text in enumerate(first, 1) if text.startswith(("import ", "from ")))
    assert not acts(Mutant(room="telemetry", path=FAULT.path, operator="core/AddNot", occurrence=0, line=line))


def test_the_copy_has_every_package():
    assert left_behind(str(check_mutants.ROOT), ["demo", ".git", "pipeline"]) == {"demo", ".git"}
    assert left_behind(str(check_mutants.ROOT / "pipeline"), ["demo"]) == set()
