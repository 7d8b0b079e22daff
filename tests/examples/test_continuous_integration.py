"""The recipes for continuous integration do the same, and pytest takes the options."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
RECIPES = ROOT / "examples" / "continuous_integration"
GITHUB, GITLAB = RECIPES / "github-workflow.yml", RECIPES / "gitlab-ci.yml"
DOCKERFILE = RECIPES / "Dockerfile"


def commands(path: Path, begin: str) -> list[str]:
    """Return the shell commands of a workflow: install, compile, test."""
    return re.findall(rf"^ +{begin}((?:pip|rrins|pytest) .*)$", path.read_text(), re.MULTILINE)


def test_all_recipes_and_the_guide_take_the_same_steps() -> None:
    steps = commands(GITHUB, "- run: ")
    assert [step.split()[0] for step in steps] == ["pip", "rrins", "pytest"]
    assert commands(GITLAB, "- ") == steps
    guide = (ROOT / "docs" / "testing.md").read_text()
    assert "".join(f"$ {step}\n" for step in steps) in guide
    image = DOCKERFILE.read_text()
    tested = json.loads(re.search(r"^CMD (.*)$", image, re.MULTILINE)[1])
    assert shlex.split(steps[2].replace("--junitxml bus-tests.xml ", "")) == tested
    install = steps[0].replace("pip install wheels/", "pip install --no-cache-dir /wheels/")
    assert f"RUN {install}\n" in image
    assert f"RUN {steps[1]} --out /tmp/out" in image
    assert all("NUMBA_CPU_NAME" in path.read_text() for path in (GITHUB, GITLAB, DOCKERFILE))


def test_pytest_takes_the_options(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples" / "own_tests", tmp_path / "bus_tests")
    words = shlex.split(commands(GITHUB, "- run: ")[2])
    done = subprocess.run(
        [sys.executable, "-m", *words, "--collect-only", "-n", "0", "-q", "-p", "no:cacheprovider"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "5 tests collected" in done.stdout
