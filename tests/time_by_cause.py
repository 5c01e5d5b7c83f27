"""Option `--times=FILE`: where the time of a test session goes, by cause, by file and by test.

JAX tells how long it traces, lowers and compiles, also where one of these happens inside another: an instant belongs
to the innermost. What is left of a test is running: Python, compiled programs, reading and writing files.
"""

import json
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax.monitoring
import psutil
import pytest

CAUSES = ("tracing", "lowering", "compiling", "loading", "browser", "processes", "running")
"""Causes of the time of a test; `loading` is that of programs from the cache on disk, `processes` of child processes.

The time of tracing includes that of the run-time type checks.
"""
_EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "compiling",
    "/jax/compilation_cache/cache_retrieval_time_sec": "loading",
}
_LONGEST = 25
_Interval = tuple[float, float, str]
_intervals: list[_Interval] = []


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option."""
    parser.addoption("--times", metavar="FILE", help="write the time by cause, by file and by test as JSON")


def pytest_configure(config: pytest.Config) -> None:
    """Listens in the processes that run tests."""
    if not config.getoption("--times"):
        return
    config.pluginmanager.register(_Watch(config), "time-by-cause")


def exclusive(intervals: list[_Interval]) -> dict[str, float]:
    """Seconds of each cause: of nested intervals (begin, end, cause) the inner one has the instant."""
    found: dict[str, float] = defaultdict(float)
    stack: list[_Interval] = []
    at = 0.0
    for begin, end, cause in sorted(intervals, key=lambda one: (one[0], -one[1])):
        while stack and stack[-1][1] <= begin:
            found[stack[-1][2]] += max(stack[-1][1] - at, 0.0)
            at = max(at, stack.pop()[1])
        if stack:
            found[stack[-1][2]] += max(begin - at, 0.0)
        at = max(at, begin)
        stack.append((begin, end, cause))
    while stack:
        found[stack[-1][2]] += max(stack[-1][1] - at, 0.0)
        at = max(at, stack.pop()[1])
    return dict(found)


class _Watch:
    """Collects the times of a session, in each worker those of its tests, and writes them where the session ends."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._tests: dict[str, dict[str, float]] = {}
        self._starts: list[float] = []
        jax.monitoring.register_event_duration_secs_listener(_note)
        if not hasattr(config, "workerinput"):
            self._begun = time.perf_counter()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session: pytest.Session) -> Iterator[None]:
        """Notes when the first test begins: before it are imports and collection."""
        if hasattr(self._config, "workerinput"):
            self._config.workeroutput["start_s"] = time.time() - psutil.Process().create_time()  # type: ignore[attr-defined]
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Writes the causes of a test, its fixtures included, into its last report."""
        _intervals.clear()
        self._test_begun = time.perf_counter()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(subprocess, "Popen", _timed(subprocess.Popen))
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
        """Writes the causes of a test into the report of its last part."""
        report = yield
        if call.when == "teardown":
            spent = time.perf_counter() - self._test_begun
            causes = exclusive(_intervals)
            causes["running"] = max(spent - sum(causes.values()), 0.0)
            report.user_properties.append(("times", causes))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keeps the causes of a test."""
        if report.when == "teardown":
            self._tests[report.nodeid] = dict(report.user_properties).get("times", {})

    def pytest_testnodedown(self, node: Any, error: Any) -> None:
        """Keeps the time that a worker took to its first test."""
        self._starts.append(getattr(node, "workeroutput", {}).get("start_s", 0.0))

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Prints the tables and writes the file."""
        file = Path(str(self._config.getoption("--times")))
        content = {
            "wall_s": time.perf_counter() - self._begun,
            "start_s": self._starts,
            "tests": self._tests,
        }
        file.write_text(json.dumps(content, indent=1))
        for line in tables(content):
            terminalreporter.write_line(line)


def tables(content: dict[str, Any]) -> list[str]:
    """Tables in Markdown of a session's times: by cause, by group of tests, and the longest tests."""
    tests: dict[str, dict[str, float]] = content["tests"]
    groups: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
    for nodeid, causes in tests.items():
        for cause, spent in causes.items():
            groups[nodeid.split("::")[0].removeprefix("tests/").split("/")[0]][cause] += spent
            groups["all"][cause] += spent
    lines = [
        f"{len(tests)} tests in {content['wall_s']:.0f} s; "
        f"imports and collection {' and '.join(f'{one:.0f} s' for one in content['start_s'])} in the workers",
        "",
    ]
    lines += [f"| | {' | '.join(CAUSES)} | sum [s] |", f"|---|{'---|' * (len(CAUSES) + 1)}"]
    order = sorted(groups, key=lambda one: -sum(groups[one].values()))
    lines += [_row(one, groups[one]) for one in order if sum(groups[one].values()) >= 1.0]
    longest = sorted(tests, key=lambda one: -sum(tests[one].values()))[:_LONGEST]
    return [*lines, "", *(_row(one.removeprefix("tests/"), tests[one]) for one in longest)]


def _row(name: str, causes: dict[str, float]) -> str:
    cells = [causes.get(cause, 0.0) for cause in CAUSES]
    return f"| {name} | {' | '.join(f'{one:.1f}' for one in cells)} | {sum(causes.values()):.1f} |"


def _note(event: str, duration: float, **_: Any) -> None:
    cause = _EVENTS.get(event)
    if cause is not None:
        end = time.perf_counter()
        _intervals.append((end - duration, end, cause))


def _timed(popen: type[subprocess.Popen[Any]]) -> type[subprocess.Popen[Any]]:
    """A process whose whole life counts."""

    class TimedProcess(popen):  # type: ignore[valid-type,misc]
        def __init__(self, args: Any, *rest: Any, **options: Any) -> None:
            self._begun = time.perf_counter()
            program = str(args[0] if isinstance(args, list | tuple) else args)
            self._cause = "browser" if "chrom" in program else "processes"
            super().__init__(args, *rest, **options)

        def wait(self, *args: Any, **options: Any) -> int:
            status = super().wait(*args, **options)
            _intervals.append((self._begun, time.perf_counter(), self._cause))
            return status

    return TimedProcess
