"""Command lines called in the process of the tests."""

import pytest
from command_line_calls import Call, Outcome

from rpojax.cli import main


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    """Runs a command line in this process."""

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
