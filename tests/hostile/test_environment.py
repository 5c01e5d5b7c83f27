"""Environments that are not as expected: each ends as the table of exit statuses says, in one line."""

import json
import os
import resource
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from case_ledger import line_problem
from hostile_classes import small_campaign
from interrupted_commands import SHORT, Ended, command, ended, run_to_end

from rpojax.campaign.storage.campaign_folder import Campaign


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished campaign; not to be changed."""
    return small_campaign(tmp_path_factory.mktemp("environment"))


def assert_refused(found: Ended, *words: str) -> None:
    """Asserts that a command ended with status 2 and one line that holds some words."""
    assert found.status == 2, found.err
    [line] = found.err.splitlines()
    assert line.startswith("rpojax: error: ")
    assert not line_problem(line.removeprefix("rpojax: error: "))
    assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("name", "value", "verb"),
    [
        ("JAX_PLATFORMS", "nonsense", "rerun"),
        ("JAX_ENABLE_X64", "banana", "resume"),
        ("JAX_DEFAULT_MATMUL_PRECISION", "pear", "resume"),
        ("XLA_FLAGS", "--xla_no_such_flag=3", "resume"),
    ],
)
def test_variables_that_jax_cannot_read_are_named(
    folder: Path, tmp_path: Path, name: str, value: str, verb: str
) -> None:
    more = ("--run-id", "0", "--out", str(tmp_path / "again")) if verb == "rerun" else ()
    assert_refused(run_to_end(verb, str(folder), *more, **{name: value}), name, value)
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize(
    "environment",
    [
        {"HOME": None, "XDG_CACHE_HOME": None},
        {"HOME": "/proc", "XDG_CACHE_HOME": None},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"PYTHONIOENCODING": "ascii"},
        {"TMPDIR": "/proc/nowhere"},
        {"COLUMNS": "40", "TERM": "dumb"},
    ],
    ids=["no home", "home that cannot be written", "C locale", "ASCII", "no temporary folder", "40 columns"],
)
def test_a_poor_environment_is_enough_to_read_a_folder(folder: Path, environment: dict[str, str | None]) -> None:
    found = run_to_end("status", str(folder), "--json", **environment)
    assert (found.status, found.err) == (0, "")
    assert json.loads(found.out)["runs"]["requested"] == 5
    assert run_to_end("status", str(folder), **environment).status == 0


def test_output_that_cannot_be_written_is_one_line(folder: Path) -> None:
    with Path("/dev/full").open("w") as full:
        found = ended(command("status", str(folder), stdout=full.fileno()))
    assert_refused(found, "standard output", "no space left")
    script = f'"$0" -m rpojax status "{folder}" 2>&1 >&-'
    closed = subprocess.run(["bash", "-c", script, os.sys.executable], capture_output=True, text=True, check=False)
    assert (closed.returncode, closed.stdout, closed.stderr) == (0, "", "")


def test_texts_of_a_user_reach_no_terminal_unescaped(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('extends = "inspection"\nname = "a\\u001b[31mb\\u202ec\\u0007"\n')
    found = run_to_end("validate", str(path))
    assert found.status in (0, 2)
    assert not {"\x1b", "\u202e", "\x07"} & set(found.out + found.err)
    assert "\\x1b[31m" in found.out + found.err


def test_a_folder_with_a_name_that_is_not_utf8_can_be_read(folder: Path, tmp_path: Path) -> None:
    link = os.fsencode(tmp_path) + b"/\xff\xfe"
    _copy(folder, tmp_path).rename(os.fsdecode(link))
    found = run_to_end("status", os.fsdecode(link))
    assert (found.status, found.err) == (0, "")


def _copy(folder: Path, place: Path) -> Path:
    return Path(shutil.copytree(folder, place / "copy"))


def campaign(out: Path, *more: str, **environment: str | None) -> Ended:
    """A small campaign in a process of its own."""
    words = ("campaign", "inspection", "--runs", "4", "--block-size", "2", "--out", str(out), "--no-report", *SHORT)
    return run_to_end(*words, *more, **environment)


@pytest.mark.slow
@pytest.mark.parametrize(
    "environment",
    [
        {"HOME": "/proc", "XDG_CACHE_HOME": None},
        {"HOME": None, "XDG_CACHE_HOME": None},
        {"TMPDIR": "/proc/nowhere"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"COLUMNS": "40"},
    ],
    ids=["home that cannot be written", "no home", "no temporary folder", "C locale", "40 columns"],
)
def test_a_campaign_runs_in_a_poor_environment(tmp_path: Path, environment: dict[str, str | None]) -> None:
    found = campaign(tmp_path / "runs", **environment)
    assert found.status in (0, 3), found.err
    assert "Traceback" not in found.err
    Campaign(tmp_path / "runs").verify()


@pytest.mark.slow
def test_a_full_disk_leaves_an_unfinished_campaign_that_a_resume_completes(tmp_path: Path) -> None:
    out = tmp_path / "runs"
    words = ("campaign", "inspection", "--runs", "4", "--block-size", "2", "--out", str(out), "--no-report", *SHORT)
    # The histories do not fit.
    limit = 12_000
    script = f"import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit})); "
    script += "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    script += "from rpojax.cli.main import main; sys.exit(main(sys.argv[1:]))"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "RPOJAX_CACHE": "off"}
    done = subprocess.run(
        [os.sys.executable, "-c", script, *words], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode in (2, 4), done.stderr
    assert "Traceback" not in done.stderr
    assert "file too large" in done.stderr
    if done.returncode == 4:
        assert run_to_end("resume", str(out)).status in (0, 3)
        Campaign(out).verify()
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != limit


@pytest.mark.slow
@pytest.mark.parametrize("spoil", [lambda path: path.write_bytes(b""), lambda path: path.write_bytes(b"x" * 1000)])
def test_damaged_caches_cost_time_and_nothing_else(tmp_path: Path, spoil: Callable[[Path], int]) -> None:
    cache = str(tmp_path / "cache")
    assert campaign(tmp_path / "one", XDG_CACHE_HOME=cache).status in (0, 3)
    files = [path for path in Path(cache).rglob("*") if path.is_file()]
    assert files
    for path in files:
        spoil(path)
    found = campaign(tmp_path / "two", XDG_CACHE_HOME=cache)
    assert found.status in (0, 3), found.err
    assert "Traceback" not in found.err
    first, second = Campaign(tmp_path / "one"), Campaign(tmp_path / "two")
    for name, values in first.metrics.items():
        assert values.tobytes() == second.metrics[name].tobytes(), name


@pytest.mark.slow
def test_two_campaigns_on_one_cache_agree(tmp_path: Path) -> None:
    words = ("campaign", "inspection", "--runs", "4", "--block-size", "2", "--no-report", *SHORT)
    cache = str(tmp_path / "cache")
    begun = [command(*words, "--out", str(tmp_path / name), XDG_CACHE_HOME=cache) for name in ("one", "two")]
    assert {ended(process).status for process in begun} <= {0, 3}
    first, second = Campaign(tmp_path / "one"), Campaign(tmp_path / "two")
    for name, values in first.metrics.items():
        assert values.tobytes() == second.metrics[name].tobytes(), name
