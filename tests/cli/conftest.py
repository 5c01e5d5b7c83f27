"""Command lines called in the process of the tests."""

import pytest
from command_line_calls import Call, Outcome

from rpojax.cli import main
from rpojax.runtime import sign_of_life


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs a command line in this process, without the lines that a slow machine adds to its output."""
    monkeypatch.setattr(sign_of_life, "INTERVAL_S", 600.0)

    def run(*words: object) -> Outcome:
        capsys.readouterr()
        try:
            status = main.main([str(word) for word in words])
        except SystemExit as end:
            assert isinstance(end.code, int)
            status = end.code
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run
