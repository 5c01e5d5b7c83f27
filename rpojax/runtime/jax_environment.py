"""What JAX and XLA read once from the environment: host devices, cache folder, compiler flags, cores."""

import os
import re
import sys
from collections.abc import Set
from pathlib import Path

from rpojax.errors import RpojaxError
from rpojax.runtime.xla_flags import check_flags

_DEVICE_FLAG = "--xla_force_host_platform_device_count"

_BACKEND_OPTIONS_FLAG = "--xla_backend_extra_options"
LOOP_FUSION_FLAG = (
    f"{_BACKEND_OPTIONS_FLAG}=xla_cpu_use_multi_output_fusion=true,xla_cpu_small_while_loop_byte_threshold=2000000"
)
"""Flag that lets XLA fuse computations with several results, and compile small loops as one function."""


_JAX_DEFAULTS = {
    "JAX_COMPILATION_CACHE_DIR": None,
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": 1.0,
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": 0,
}
"""Settings of JAX where nobody has set them."""

_is_prepared = _is_set_up = False


def prepare_process(*, cache: bool = True, rendered: bool = False) -> None:
    """Prepares this Python process for JAX as the command line does; call it before the first computation.

    Sets environment variables, except those that the user has set: one host device for each core of a CPU and, unless
    most runs have rendered cameras, compiler flags that make the closed loop ten times as fast (both in XLA_FLAGS),
    and, with `cache`, the folder of compiled programs (JAX_COMPILATION_CACHE_DIR and two limits). A later call has no
    effect.

    Args:
        cache: whether to keep compiled programs in the user's cache folder, unless RPOJAX_CACHE=off
        rendered: whether most runs have rendered cameras

    Raises:
        RpojaxError: JAX has computed already.
    """
    global _is_prepared
    if _is_prepared:
        return
    if _has_begun():
        raise RpojaxError("prepare_process: found JAX at work already, expected a call before its first computation")
    prepare_jax(cache)
    set_loop_fusion_flag(rendered)
    _is_prepared = True


def prepare_jax(cache: bool) -> None:
    """Sets what JAX reads when it begins: one host device per core and, with `cache`, the cache folders.

    Without effect if JAX has begun already. Variables that the user has set are not changed.

    Raises:
        RpojaxError: XLA does not know a flag in XLA_FLAGS.
    """
    global _is_set_up
    if _has_begun():
        return
    hide_compiler_log()
    os.environ.setdefault("JAX_LOGGING_LEVEL", "CRITICAL")
    flags = os.environ.get("XLA_FLAGS", "")
    check_flags(flags)
    if _DEVICE_FLAG not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {_DEVICE_FLAG}={available_cores()}".strip()
    _is_set_up = True
    folder = _cache_folder() if cache and os.environ.get("RPOJAX_CACHE") != "off" else None
    if folder is not None:
        _set_default("JAX_COMPILATION_CACHE_DIR", str(folder))
        _set_default("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", 0)
        _set_default("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", -1)


def _has_begun() -> bool:
    """Whether JAX has read the flags: with its first device, not when it is imported."""
    bridge = sys.modules.get("jax._src.xla_bridge")
    # A version of JAX that does not tell is taken for one that has not: flags that come too late have no effect.
    return bridge is not None and getattr(bridge, "backends_are_initialized", lambda: False)()


def _set_default(name: str, value: str | int) -> None:
    """Sets a variable that JAX reads when imported, and where that is too late its setting, unless the user has."""
    if name in os.environ:
        return
    jax = sys.modules.get("jax")
    if jax is not None:
        if getattr(jax.config, name.lower()) != _JAX_DEFAULTS[name]:
            return
        jax.config.update(name.lower(), value)
    os.environ[name] = str(value)


def hide_compiler_log() -> None:
    """Keeps the log of XLA off the terminal, unless the user has set its level; without effect once JAX is imported.

    It has an alarm with advice to file a bug where a compilation takes minutes, as gradients of long runs do. XLA's
    errors are raised too, and progress is shown by this package.
    """
    if "jax" not in sys.modules:
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def set_loop_fusion_flag(rendered: bool) -> None:
    """Sets `LOOP_FUSION_FLAG`, which makes the closed loop ten times as fast, but rendered images twice as slow.

    Call it before the first computation. XLA ignores options that it does not know; a flag that the user has set is not
    changed.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if not rendered and _BACKEND_OPTIONS_FLAG not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {LOOP_FUSION_FLAG}".strip()


def is_slow() -> bool:
    """Whether JAX computes on a CPU, and nobody has set it up for the closed loop, neither this module nor the user."""
    if _is_set_up or _BACKEND_OPTIONS_FLAG in os.environ.get("XLA_FLAGS", ""):
        return False
    return _has_begun() and sys.modules["jax"].default_backend() == "cpu"


def environment_without_loop_fusion() -> dict[str, str]:
    """Environment of this process, for another one without `LOOP_FUSION_FLAG`."""
    return {**os.environ, "XLA_FLAGS": os.environ.get("XLA_FLAGS", "").replace(LOOP_FUSION_FLAG, "")}


def environment_with_devices(count: int) -> dict[str, str]:
    """Environment of this process, for another one with `count` host devices."""
    flags = re.sub(rf"{_DEVICE_FLAG}=\S*", "", os.environ.get("XLA_FLAGS", ""))
    return {**os.environ, "XLA_FLAGS": f"{flags} {_DEVICE_FLAG}={count}".strip()}


def bind_to_cores(cores: Set[int]) -> None:
    """Binds this process to some cores, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)


def available_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cache_folder() -> Path | None:
    """Folder for compiled programs, created if missing; None if it is not writable."""
    try:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rpojax" / "jax"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return None
    return folder if os.access(folder, os.W_OK | os.X_OK) else None
