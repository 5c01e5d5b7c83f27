"""What the package changes in its process is what docs/about/performance.md names, and `runtime/` alone changes it."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import rpojax

PACKAGE = Path(rpojax.__file__).parent

SETTINGS = """
import gc, json, os, signal, sys
def settings():
    import jax, matplotlib, numpy
    return {
        **{f"config {name}": repr(value) for name, value in jax.config.values.items()},
        **{f"environment {name}": value for name, value in os.environ.items()},
        **{f"signal {each}": repr(signal.getsignal(each)) for each in (signal.SIGINT, signal.SIGTERM)},
        "collector": (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()),
        "numpy errors": numpy.geterr(),
        "figures": matplotlib.get_backend(auto_select=False),
    }
def changes(before, after):
    return {name: after.get(name) for name in {*before, *after} if before.get(name) != after.get(name)}
"""

PROCESS_WIDE = re.compile(
    r"os\.environ\[[^]]+\] = |os\.environ\.(setdefault|update|pop)|os\.environ \|=|config\.update\(|\bgc\.\w+\("
    r"|threadpool_limits\(|setNumThreads|sched_setaffinity\(|warnings\.(simplefilter|filterwarnings)|matplotlib\.use\("
    r"|rcParams\[|seterr\(|signal\.signal\(|clear_caches\(|force_host_platform_device_count"
)
"""Calls and assignments that change the whole process."""

EXCEPTIONS = {
    "vision/imaging/image_files.py": "Pillow warns of large images, for the time of opening one",
    "simulation/single_precision.py": "JAX warns of float64 that is asked for, for the time of tracing",
    "training/synthetic_data/meshes/formats/mesh_source.py": "Pillow warns of large images, while one is opened",
    "training/synthetic_data/meshes/formats/ply_elements.py": "NumPy warns of text after the numbers, which is refused",
    "scenario/trained/coverage_surface.py": "notes of a mesh are among the warnings of its mission, not said twice",
}
"""File -> why it changes a setting itself."""


def in_new_process(code: str, *imported_before: str, **environment: str) -> Any:
    """What `code` prints as JSON, in a process without the variables that the commands set."""
    own = {name: value for name, value in os.environ.items() if not name.startswith(("XLA_", "JAX_", "RPOJAX_"))}
    imports = "".join(f"import {name}\n" for name in imported_before)
    done = subprocess.run(
        [sys.executable, "-c", SETTINGS + imports + code],
        env={**own, "PYTHONPATH": str(PACKAGE.parent), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_importing_the_package_changes_nothing_and_does_not_import_jax() -> None:
    code = "before = settings()\nimport rpojax\nprint(json.dumps(changes(before, settings())))"
    assert in_new_process(code) == {}
    assert in_new_process("import rpojax\nprint(json.dumps('jax' in sys.modules))") is False


def test_public_names_enable_double_precision_and_change_nothing_else() -> None:
    code = "before = settings()\nimport rpojax\nfor name in rpojax.__all__: getattr(rpojax, name)\n"
    assert in_new_process(code + "print(json.dumps(changes(before, settings())))") == {"config jax_enable_x64": "True"}


def test_prepared_process_has_a_device_per_core_and_a_cache(tmp_path: Path) -> None:
    code = (
        "before = dict(os.environ)\nimport rpojax\nrpojax.prepare_process()\nafter = dict(os.environ)\nimport jax\n"
        "rpojax.prepare_process()\nassert dict(os.environ).items() >= after.items()\n"
        "print(json.dumps([changes(before, after), jax.device_count(), jax.config.jax_compilation_cache_dir]))"
    )
    changed, devices, folder = in_new_process(code, XDG_CACHE_HOME=str(tmp_path))
    assert devices == len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert folder == str(tmp_path / "rpojax" / "jax")
    limits = {f"JAX_PERSISTENT_CACHE_MIN_{name}" for name in ("COMPILE_TIME_SECS", "ENTRY_SIZE_BYTES")}
    assert set(changed) == {"XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR", "JAX_LOGGING_LEVEL", *limits}
    assert all(name in (PACKAGE.parent / "docs" / "about" / "performance.md").read_text() for name in changed)


def test_process_can_be_prepared_after_jax_is_imported(tmp_path: Path) -> None:
    code = (
        "import rpojax\nrpojax.prepare_process()\n"
        "print(json.dumps([jax.device_count(), jax.config.jax_compilation_cache_dir]))"
    )
    devices = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert in_new_process(code, "jax", XDG_CACHE_HOME=str(tmp_path)) == [devices, str(tmp_path / "rpojax" / "jax")]


def test_a_cache_that_the_user_has_set_stays(tmp_path: Path) -> None:
    code = (
        "import rpojax\njax.config.update('jax_compilation_cache_dir', 'mine')\nrpojax.prepare_process()\n"
        "print(json.dumps([jax.config.jax_compilation_cache_dir, 'JAX_COMPILATION_CACHE_DIR' in os.environ]))"
    )
    assert in_new_process(code, "jax", XDG_CACHE_HOME=str(tmp_path)) == ["mine", False]


def test_process_cannot_be_prepared_once_jax_has_computed() -> None:
    code = (
        "import rpojax\njax.device_count()\nbefore = dict(os.environ)\ntry: rpojax.prepare_process()\n"
        "except rpojax.RpojaxError as error: print(json.dumps([str(error), before == dict(os.environ)]))"
    )
    expected = "prepare_process: found JAX at work already, expected a call before its first computation"
    assert in_new_process(code, "jax") == [expected, True]


def test_only_the_runtime_folder_changes_the_process() -> None:
    found = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if PROCESS_WIDE.search(path.read_text()) and path.parent != PACKAGE / "runtime"
    }
    assert found == set(EXCEPTIONS)


@pytest.mark.parametrize(
    "line",
    [
        'os.environ["A"] = "1"',
        'jax.config.update("jax_enable_x64", True)',
        "gc.disable()",
        "with threadpool_limits(1):",
    ],
)
def test_changes_of_the_process_are_recognised(line: str) -> None:
    assert PROCESS_WIDE.search(line)
    assert not PROCESS_WIDE.search('value = os.environ.get("A") or os.environ["A"] == "1"')
