"""Errors for missing optional packages."""

import pytest

from rpojax.errors import RpojaxError
from rpojax.optional_packages import MissingExtraError, require_package


def test_missing_package_error_names_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mitsuba", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'rpojax\[raytrace\]'") as error:
        require_package("mitsuba")
    assert isinstance(error.value, RpojaxError)
    assert len(str(error.value).splitlines()) == 1
