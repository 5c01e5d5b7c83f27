"""Settings of the test session, made before the package is imported, and fixtures of the nominal scenario."""

import gc
import os

# Before NumPy and SciPy are imported. Each worker has one core: threads of their linear algebra wait for one another
# there, and the exponential of a matrix of 6 by 6 takes a hundred times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Generator
from pathlib import Path
from typing import Any

import fast_compile_flags
import jax
import pytest
from hypothesis import settings
from memory_release import drop_programs, return_freed_memory
from runtime_type_checks import check_package
from worker_scheduling import GroupScheduling, sort_longest_group_first

PACKAGE = Path(__file__).parents[1] / "rpojax"
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "rpojax" / "jax-tests"

# Flags that the user has set are not changed.
for flag in fast_compile_flags.FLAGS:
    if flag.partition("=")[0] not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_compilation_cache_dir", str(CACHE))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

# Before the package is imported.
check_package(PACKAGE)

pytest_plugins = ["campaign_fixtures", "time_by_cause"]

settings.register_profile("rpojax", deadline=None, max_examples=20, derandomize=True, database=None)
settings.load_profile("rpojax")

from named_loops import name_loop, unnamed_loops, watch_loops  # noqa: E402

from rpojax.scenario import params as parameters  # noqa: E402  (after the hook)
from rpojax.scenario.loading import scenario_loader as scenarios  # noqa: E402
from rpojax.scenario.params import Params  # noqa: E402
from rpojax.scenario.schema import ScenarioFile  # noqa: E402
from rpojax.scenario.static_settings import Scenario, static_settings  # noqa: E402

watch_loops()
name_loop("inspection", scenarios.load("inspection"))

# Tracing creates millions of objects of which few are garbage.
gc.freeze()
gc.set_threshold(50_000, 20, 20)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sorts the tests for their distribution over workers."""
    sort_longest_group_first(items)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Gives freed memory back, and drops programs after the last test of a module and the teardown of its fixtures."""
    return_freed_memory()
    if nextitem is None or nextitem.path != item.path:
        drop_programs()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Fails a default test that has traced, with its fixtures, a closed loop that has no name."""
    result = yield
    unnamed = unnamed_loops()
    if unnamed and not any(map(item.get_closest_marker, ("slow", "traces"))):
        raise AssertionError(f"traced a loop that is none of tests/named_loops.py: {unnamed[0]}")
    return result


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> GroupScheduling:
    """Scheduler of pytest-xdist."""
    return GroupScheduling(config, log)


@pytest.fixture(scope="session")
def inspection_file() -> ScenarioFile:
    """The packaged nominal scenario as its file model."""
    return scenarios.load("inspection")


@pytest.fixture(scope="session")
def inspection(inspection_file: ScenarioFile) -> Scenario:
    """Static settings of the nominal scenario."""
    return static_settings(inspection_file)


@pytest.fixture(scope="session")
def inspection_params(inspection_file: ScenarioFile, inspection: Scenario) -> Params:
    """Params of the nominal scenario, nothing dispersed."""
    return parameters.build_params(inspection_file.model_dump(), inspection.width_px, inspection.height_px)


@pytest.fixture(scope="session")
def params() -> Params:
    """Params of a pinned copy of the nominal scenario, independent of later tuning of the packaged one."""
    file = scenarios.load(Path(__file__).parent / "pinned.toml")
    return parameters.build_params(file.model_dump(), file.camera.width_px, file.camera.height_px)
