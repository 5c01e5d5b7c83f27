"""Code blocks of the site run as printed: files are saved, then commands and Python run one after the other."""

import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from markdown_blocks import Block, code_blocks

from rpojax.scenario.loading import scenario_loader

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path
    for path in (ROOT / "docs").rglob("*.md")
    if "made" not in path.parts and any(True for _ in code_blocks(path.read_text(encoding="utf-8")))
)
RUN = ("", "bash", "python", "toml")
"""Languages of blocks that are run, saved or checked."""
SHOWN = ("text", "bibtex")
"""Languages of blocks that a reader only reads."""

NOT_RUN = {
    r"pip |uv |python3 -m venv": "installs; tests/test_packaging.py installs the package into a new environment",
    r"rerun ": "opens a window of another program",
    r"ros2 ": "needs a ROS 2 installation",
    r"rpojax field (train|evaluate) kepler": "needs a mesh from elsewhere, and hours; tests/training have their own",
    r"rpojax detector ": "ray-traces and trains for hours; tests/training do it with few pictures",
    r"rpojax (bench|robustness|faults)|python benchmarks/|pytest benchmarks": "takes minutes; tests have small ones",
    r"rpojax probability inspection": "ten thousand runs each; tests/analysis/reliability estimate with fewer",
}
"""Beginning of a command -> why it is not run here."""
ENDLESS_PYTHON = "while True:"
"""A node that never ends; tests/interop run the example nodes as processes."""

LINKED = ("experiments", "benchmarks", "tests", "docs", "rpojax")
"""Folders of the checkout from which a reader works."""


def blocks_of(page: Path) -> list[Block]:
    """Blocks of a page that are run, saved or checked."""
    return [block for block in code_blocks(page.read_text(encoding="utf-8")) if block.language in RUN]


def commands(block: Block) -> list[str]:
    """Commands of a shell block, a line with its continuation each, without those that are not run here."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [line for line in lines if line.strip() and not any(re.match(pattern, line) for pattern in NOT_RUN)]


def name_of(page: Path) -> str:
    """Path of a page in the documentation."""
    return str(page.relative_to(ROOT / "docs"))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_language_of_every_block_is_known(page: Path) -> None:
    found = {block.language for block in code_blocks(page.read_text(encoding="utf-8"))}
    assert found <= {*RUN, *SHOWN}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_options_of_every_command_are_those_of_its_verb(page: Path) -> None:
    for block in blocks_of(page):
        for line in block.text.replace("\\\n", " ").splitlines() if block.language in ("", "bash") else []:
            found = re.match(
                r"(?:\S*/)?rpojax ([a-z-]+(?: (?:train|refine|evaluate|render|data))?)\b(.*)", line.partition(" # ")[0]
            )
            if found:
                used = set(re.findall(r"(?<=\s)--([a-z][a-z-]*)", found[2]))
                assert used <= {*options_of(found[1]), "json", "allow-plugin", "help", "version"}, line


def options_of(verb: str) -> set[str]:
    """Long options of a command, from its help."""
    sys.path.insert(0, str(ROOT / "docs"))
    from site_extensions.command_help import help_of

    return set(re.findall(r"--([a-z][a-z-]*)", help_of(verb)))


def test_every_reason_not_to_run_a_command_applies_to_one() -> None:
    lines = [line for page in PAGES for block in blocks_of(page) for line in block.text.splitlines()]
    assert [pattern for pattern in NOT_RUN if not any(re.match(pattern, line) for line in lines)] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_scenario_without_a_name_of_its_own_is_accepted(page: Path, tmp_path: Path) -> None:
    for block in blocks_of(page):
        if block.language == "toml" and block.file is None and name_of(page) != "reference/scenario.md":
            path = tmp_path / "fragment.toml"
            path.write_text(("" if "extends" in block.text else 'extends = "inspection"\n') + block.text)
            (tmp_path / "out").mkdir(exist_ok=True)
            loaded = scenario_loader.load(path).model_dump()
            for section, table in tomllib.loads(block.text).items():
                for key, value in table.items() if isinstance(table, dict) else []:
                    if isinstance(value, bool | int | float):
                        assert loaded[section][key] == value, f"{section}.{key}"


@pytest.fixture(scope="session")
def first_campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the first lesson leaves, by its own command."""
    folder = tmp_path_factory.mktemp("reader")
    lesson = (ROOT / "docs" / "tutorial" / "first_campaign.md").read_text(encoding="utf-8")
    command = next(line for line in lesson.splitlines() if line.startswith("rpojax campaign"))
    run_steps(folder, [{"shell": command}])
    return folder / "out" / "first"


RUNNABLE = [
    page
    for page in PAGES
    if any(
        block.language == "python" or (block.language in ("", "bash") and commands(block)) for block in blocks_of(page)
    )
]


@pytest.mark.slow
@pytest.mark.parametrize("page", RUNNABLE, ids=name_of)
def test_the_blocks_of_a_page_run_as_printed(page: Path, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    blocks = blocks_of(page)
    if name_of(page) != "tutorial/first_campaign.md" and any("out/first" in block.text for block in blocks):
        shutil.copytree(request.getfixturevalue("first_campaign"), tmp_path / "out" / "first")
    for folder in LINKED:
        (tmp_path / folder).symlink_to(ROOT / folder)
    steps: list[dict[str, str]] = []
    for block in blocks:
        if block.file is not None:
            (tmp_path / block.file).write_text(block.text)
        elif block.language == "python" and ENDLESS_PYTHON not in block.text:
            steps.append({"python": block.text})
        elif block.language in ("", "bash") and commands(block):
            steps.append({"shell": "\n".join(commands(block))})
    run_steps(tmp_path, steps)


def run_steps(folder: Path, steps: list[dict[str, str]]) -> None:
    """Runs blocks one after the other in a folder: shell commands, and Python in one process with one set of names."""
    shim = folder / ".bin"
    shim.mkdir()
    for name, call in (("rpojax", "-m rpojax"), ("python", "")):
        (shim / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {call} "$@"\n')
        (shim / name).chmod(0o755)
    environment = {key: value for key, value in os.environ.items() if key not in ("XLA_FLAGS", "JAX_ENABLE_X64")}
    environment |= {"PATH": f"{shim}:{os.environ['PATH']}", "PYTHONPATH": f"{ROOT}:{folder}"}
    driver = folder / ".driver.py"
    driver.write_text(inspect.getsource(_drive) + "\n_drive()\n")
    done = subprocess.run(
        [sys.executable, driver],
        cwd=folder,
        env=environment,
        input=json.dumps(steps),
        capture_output=True,
        text=True,
        check=False,
    )
    print(done.stdout, done.stderr, sep="\n")  # what a reader sees; pytest -rP shows it
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"


def _drive() -> None:
    """Body of the process that runs the steps."""
    import json
    import subprocess
    import sys

    names = {"__name__": "__main__"}
    for step in json.load(sys.stdin):
        print("STEP", step, flush=True)
        if "python" in step:
            exec(compile(step["python"], "page", "exec"), names)
        else:
            subprocess.run(["bash", "-e", "-c", step["shell"]], check=True)
