"""What the package offers is loaded when it is first asked for, and then is what it says."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

import pytest

import calibration


def test_every_name_is_there_and_none_is_a_modules():
    modules = {module.name for module in pkgutil.iter_modules(calibration.__path__)}
    for name in calibration.__all__:
        assert getattr(calibration, name).__class__.__name__ != "module"
        assert name not in modules, "a module of that name takes its place once it is loaded"
    with pytest.raises(AttributeError, match="'calibration' has no attribute 'calibarte'"):
        _ = calibration.calibarte


def test_what_is_not_asked_for_is_not_loaded():
    code = "import sys, calibration.foundation.arrays; print('cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
