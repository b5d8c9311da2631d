"""What is installed of all that the project needs: each package pinned, as pinned, and under a licence that is told.

usage: python scripts/inventory.py [--list]

Asks nobody: the environment it runs in, `scripts/constraints.txt`, `pyproject.toml` and `docs/licences.md` are enough.
Packages are looked for from the project's own requirements and those of every extra on, as far as they are installed.
What only tests and documentation need has to be pinned, its licence need not be told: nobody is given it. Exit 1 where
something is amiss.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
OURS = ("all", "docs", "mutation", "fuzz", "test")
"""Extras that bring users nothing of their own."""


@dataclass(frozen=True, kw_only=True)
class Package:
    """One that is installed: `licence` as it says itself, `used` where more than tests and documentation need it."""

    name: str
    version: str
    licence: str
    used: bool


def installed(wanted: Iterable[str], *, used: bool) -> dict[str, Package]:
    """The installed packages that the requirements lead to, by name; those of other systems and extras left out."""
    found: dict[str, Package] = {}
    left = [Requirement(text) for text in wanted]
    while left:
        requirement = left.pop()
        name = canonicalize_name(requirement.name)
        extras = ("", *requirement.extras)
        if name in found or (requirement.marker and not any(requirement.marker.evaluate({"extra": e}) for e in extras)):
            continue
        try:
            known = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue
        found[name] = Package(name=name, version=known.version, licence=licence_of(known), used=used)
        below = [Requirement(text) for text in known.requires or ()]
        left += [r for r in below if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in extras)]
        for one in below:
            one.marker = None  # judged with the extras of who asks for it
    return found


def licence_of(package: metadata.Distribution) -> str:
    """What a package says of its licence, in a line; empty where it says nothing."""
    said = package.metadata.get("License-Expression") or ""
    kinds = [
        c.rpartition(" :: ")[2] for c in package.metadata.get_all("Classifier") or () if c.startswith("License ::")
    ]
    text = (package.metadata.get("License") or "").strip()
    return said or ", ".join(kinds) or text.partition("\n")[0][:60]


def pins(text: str) -> dict[str, str]:
    """Version by name of a list of constraints."""
    found = re.findall(r"^([A-Za-z0-9_.-]+)==([^\s;#]+)", text, re.MULTILINE)
    return {canonicalize_name(name): version for name, version in found}


def amiss(packages: Mapping[str, Package], pinned: Mapping[str, str], told: str) -> list[str]:
    """A sentence for everything that is not as it should be."""
    names, said = {canonicalize_name(word) for word in re.findall(r"[\w.-]+", told)}, []
    for package in packages.values():
        pin = pinned.get(package.name)
        if pin is None:
            said.append(f"{package.name} {package.version} is not pinned in scripts/constraints.txt")
        elif pin != package.version:
            said.append(f"{package.name} {package.version} is installed, {pin} is pinned")
        if package.used and package.name not in names:
            said.append(f"{package.name} ({package.licence or 'no licence told'}) is not in docs/licences.md")
    return said


def main() -> int:
    """Prints what is amiss, and with --list everything; 1 where something is."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    others = [text for name in OURS for text in extras.get(name, ()) if not text.startswith("runningfix")]
    used = [*project["dependencies"], *(text for name in extras if name not in OURS for text in extras[name])]
    packages = installed(others, used=False) | installed(used, used=True)
    if "--list" in sys.argv[1:]:
        for package in sorted(packages.values(), key=lambda p: p.name):
            print(f"{package.name:<34}{package.version:<16}{package.licence}")
    pinned = pins((ROOT / "scripts/constraints.txt").read_text())
    found = amiss(packages, pinned, (ROOT / "docs/licences.md").read_text())
    print(*sorted(found), sep="\n", end="\n" if found else "")
    print(f"{len(packages)} packages installed, {sum(p.used for p in packages.values())} of them given to users")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
