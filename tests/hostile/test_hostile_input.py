"""Hostile input of all classes ends in success or in one line of the package's errors, in bounded time and memory."""

import logging
from pathlib import Path

import pytest
from hostile_classes import SHARES, run_all

DEFAULT, ALL = 800, 100_000
"""Cases of the default run, and of the slow one."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("count", "first_seed"), [(DEFAULT, 1), pytest.param(ALL, 1000, marks=pytest.mark.slow)], ids=["default", "all"]
)
def test_every_case_is_accepted_or_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], count: int, first_seed: int
) -> None:
    monkeypatch.chdir(tmp_path)
    logging.disable()  # pytest records what libraries log
    try:
        ledger = run_all(count, tmp_path, first_seed)
    finally:
        logging.disable(logging.NOTSET)
    with capsys.disabled():
        print("\n" + "\n".join([*ledger.lines(), *ledger.coverage()]))
    assert ledger.faults == []
    assert ledger.total >= 0.99 * count
    assert set(ledger.ends) == set(SHARES)
    # A generator whose cases are all refused, or all accepted, does not look at what lies between.
    unlike = {kind for kind, ends in ledger.ends.items() if len(ends) < 2}
    assert unlike <= {"command line", "report"}
