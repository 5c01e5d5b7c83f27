"""The package as others get it: a wheel that works outside of the checkout, one version, and how to cite it."""

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


def test_the_version_is_in_one_place() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    assert project["tool"]["hatch"]["version"]["path"] == "rpojax/version.py"
    assert "version" not in yaml.safe_load((ROOT / "CITATION.cff").read_text())


def test_every_optional_package_is_in_the_extra_that_errors_name() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {"erfa": "pyerfa", "mpl_toolkits": "basemap", "rerun": "rerun-sdk", "imageio_ffmpeg": "imageio-ffmpeg"}
    for package, extra in EXTRAS.items():
        assert any(entry.startswith(names.get(package, package)) for entry in extras[extra]), package


def test_the_citation_has_what_its_format_demands() -> None:
    content = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert content["cff-version"] == "1.2.0"
    assert content["license"] == "Apache-2.0"
    assert {"message", "title", "authors"} <= set(content)


@pytest.mark.slow
def test_a_wheel_works_outside_of_the_checkout(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", str(tmp_path), str(ROOT)]
    subprocess.run(build, check=True, timeout=600)
    [wheel] = tmp_path.glob("*.whl")
    assert wheel.name.startswith(f"rpojax-{rpojax.__version__}-")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert "rpojax/py.typed" in names
    assert "rpojax/scenario/packaged/inspection.toml" in names
    assert not any(name.startswith(("tests/", "experiments/")) for name in names)
    site = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--no-deps", "-q", "--target", str(site), str(wheel)]
    subprocess.run(install, check=True, timeout=600)

    def run(*words: str) -> str:
        # The environment's packages, and of this one the installed wheel alone.
        command = [sys.executable, "-P", "-m", "rpojax", *words]
        environment = {"PYTHONPATH": str(site), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True, timeout=1800
        )
        return done.stdout

    where = "import rpojax; print(rpojax.__file__)"
    found = subprocess.run(
        [sys.executable, "-P", "-c", where],
        cwd=tmp_path,
        env={"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.startswith(str(site))
    assert run("--version").strip() == f"rpojax {rpojax.__version__}"
    run("campaign", "inspection", "--runs", "64", "--set", "duration_s=200", "--out", "runs")
    assert (tmp_path / "runs" / "report.html").stat().st_size > 100_000
