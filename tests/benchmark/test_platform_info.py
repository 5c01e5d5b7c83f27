"""Description of the machine of a benchmark."""

import jax

from rpojax.benchmark.platform_info import platform_info


def test_platform_info_names_backend_and_machine() -> None:
    found = platform_info()
    assert found["backend"] == jax.default_backend()
    assert found["machine"]
    assert found["peak_memory_mib"] > 100.0
