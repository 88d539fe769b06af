"""A release is whole: links lead somewhere, one version, workflows that parse."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

import pinfric as pf

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob(".github/**/*.md"), *ROOT.glob("notebooks/**/*.md")]


def read_yaml(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)
    missing = [t for t in targets if "://" not in t and not (page.parent / t).exists()]
    assert not missing


def test_one_version():
    citation = read_yaml("CITATION.cff")
    assert PROJECT["version"] == pf.__version__ == citation["version"]
    assert PROJECT["license"] == citation["license"]
    assert PROJECT["urls"]["Repository"] == citation["repository-code"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    kinds = re.findall(r"^### (\w+)$", changelog, re.MULTILINE)
    assert set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert re.findall(r"^## (.*)$", changelog, re.MULTILINE)[0] == "[Unreleased]"


def test_workflows_try_what_is_supported():
    tests = read_yaml(".github/workflows/tests.yml")["jobs"]
    tried = tests["tests"]["strategy"]["matrix"]["python"]
    assert PROJECT["requires-python"] == f">={tried[0]}"
    for file in (ROOT / ".github/workflows").glob("*.yml"):
        steps = [step for job in read_yaml(file)["jobs"].values() for step in job["steps"]]
        scripts = re.findall(r"\.ci/\w+", "\n".join(step.get("run", "") for step in steps))
        assert all((ROOT / script).stat().st_mode & 0o100 for script in scripts)
        extras = re.findall(r'"\.\[([\w,]+)\]"', "\n".join(step.get("run", "") for step in steps))
        assert {e for some in extras for e in some.split(",")} <= {
            *PROJECT["optional-dependencies"],
            "docs",
        }


def test_the_smoke_set_names_tests_that_exist():
    for line in (ROOT / "tests/smoke.txt").read_text().splitlines():
        file, _, name = line.partition("::")
        assert f"def {name}" in (ROOT / file).read_text(encoding="utf-8"), line
