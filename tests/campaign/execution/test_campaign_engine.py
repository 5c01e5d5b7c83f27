"""Engine of an existing campaign."""

import pytest

from rpojax.campaign.execution.campaign_engine import check_versions
from rpojax.campaign.storage.provenance import package_versions
from rpojax.errors import RpojaxError


def test_other_package_version_is_refused() -> None:
    with pytest.raises(RpojaxError, match=r"jax: found version .*, expected 0\.1\.2, with which the campaign began"):
        check_versions(package_versions() | {"jax": "0.1.2"})
