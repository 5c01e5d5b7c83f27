"""The package as others get it: a wheel that works outside of the checkout, one version, and how to cite it."""

import itertools
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import rpojax
from rpojax.optional_packages import EXTRAS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CLEAN = {"PATH": "/usr/bin:/bin"}
"""Environment that knows nothing of this checkout."""


def test_the_version_is_in_one_place() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    assert project["tool"]["hatch"]["version"]["path"] == "rpojax/version.py"
    assert "version" not in yaml.safe_load((ROOT / "CITATION.cff").read_text())


def test_every_optional_package_is_in_the_extra_that_errors_name() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {"mpl_toolkits": "basemap", "rerun": "rerun-sdk", "imageio_ffmpeg": "imageio-ffmpeg"}
    for package, extra in EXTRAS.items():
        assert any(entry.startswith(names.get(package, package)) for entry in extras[extra]), package


def test_the_citation_has_what_its_format_demands() -> None:
    content = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert content["cff-version"] == "1.2.0"
    assert content["license"] == "Apache-2.0"
    assert {"message", "title", "authors"} <= set(content)


@pytest.fixture(scope="module")
def clean_environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of programs of a new virtual environment with a wheel of this package and what the wheel demands."""
    folder = tmp_path_factory.mktemp("clean")
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", str(folder), str(ROOT)]
    subprocess.run(build, check=True, timeout=600)
    [wheel] = folder.glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True, timeout=600)
    programs = folder / "venv" / "bin"
    install = [str(programs / "python"), "-m", "pip", "install", "-q", str(wheel)]
    subprocess.run(install, check=True, timeout=1800, env=CLEAN)
    return programs


def call(programs: Path, folder: Path, *command: str) -> str:
    """Standard output of a program of the clean environment, called in a folder outside of the checkout.

    Without the ray tracer, which is an extra, its commands say in one line how to install it.
    """
    environment = {**CLEAN, "PATH": f"{programs}:{CLEAN['PATH']}", "HOME": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=7200)
    if "expected: pip install 'rpojax[raytrace]'" in done.stderr:
        assert (done.returncode, command[1], len(done.stderr.splitlines())) == (2, "field", 1)
        return ""
    assert done.returncode in (0, 3), f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.mark.slow
def test_a_wheel_has_the_package_and_nothing_else(clean_environment: Path) -> None:
    [wheel] = clean_environment.parents[1].glob("*.whl")
    assert wheel.name.startswith(f"rpojax-{rpojax.__version__}-")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert "rpojax/py.typed" in names
    assert "rpojax/scenario/packaged/inspection.toml" in names
    assert not any(name.startswith(("tests/", "experiments/")) for name in names)


@pytest.mark.slow
def test_a_wheel_works_in_a_clean_environment_outside_of_the_checkout(clean_environment: Path, tmp_path: Path) -> None:
    where = call(clean_environment, tmp_path, "python", "-c", "import rpojax; print(rpojax.__file__)")
    assert Path(where.strip()).is_relative_to(clean_environment.parent)
    assert call(clean_environment, tmp_path, "rpojax", "--version").strip() == f"rpojax {rpojax.__version__}"
    call(clean_environment, tmp_path, "rpojax", "campaign", "inspection", "--runs", "64", "--out", "runs")
    assert (tmp_path / "runs" / "report.html").stat().st_size > 100_000


@pytest.mark.slow
def test_the_python_of_the_readme_runs_as_printed(clean_environment: Path, tmp_path: Path) -> None:
    (tmp_path / "readme.py").write_text("".join(fenced("python")))
    assert call(clean_environment, tmp_path, "python", "readme.py")
    assert list(tmp_path.glob("out/*/campaign.json"))


@pytest.mark.slow
def test_the_commands_of_the_readme_run_as_printed(clean_environment: Path, tmp_path: Path) -> None:
    for number, text in enumerate(fenced("toml")):
        (tmp_path / f"block_{number}.toml").write_text(text if "extends" in text else f'extends = "inspection"\n{text}')
        call(clean_environment, tmp_path, "rpojax", "validate", f"block_{number}.toml")
    commands = readme_commands()
    assert commands
    for words in commands:
        if not any(PLACEHOLDER.search(word) for word in words):
            call(clean_environment, tmp_path, *tune_shortly(words))
            continue
        verb = list(itertools.takewhile(lambda word: re.fullmatch("[a-z-]+", word), words[1:3]))
        offered = call(clean_environment, tmp_path, "rpojax", *verb, "--help")
        assert all(word in offered for word in words if word.startswith("--")), words


PLACEHOLDER = re.compile(r"\b[A-Z]{2,}")
"""What stands for a name of the reader's, in capitals."""


def fenced(language: str) -> list[str]:
    """Blocks of a language of the README."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    return [text for each, text in found if each == language]


def readme_commands() -> list[list[str]]:
    """Commands `rpojax` of the README, without the remark after them."""
    lines = [re.sub(r"\s{3,}.*", "", line) for text in fenced("") for line in text.splitlines()]
    return [line.split() for line in lines if line.startswith("rpojax ")]


def tune_shortly(words: list[str]) -> list[str]:
    """The command itself, but a tuning, which takes an hour as printed, with eight runs and two steps."""
    if words[1] != "tune":
        return words
    shorter = {"--runs": "8", "--steps": "2"}
    return [shorter.get(before, word) for before, word in zip(["", *words], words, strict=False)]
