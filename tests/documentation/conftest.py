"""Fixtures of the tests of the documentation site."""

from pathlib import Path

import pytest
from build_site import build


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site without the files of the gallery."""
    out = tmp_path_factory.mktemp("site") / "html"
    built = build(out, "--without-gallery")
    assert built.returncode == 0, built.stdout + built.stderr
    return out
