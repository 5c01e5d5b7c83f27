"""Compiler options with a version of XLA that does not know all of them."""

import jax
import pytest

from rpojax.runtime import compiler_options


class OtherXlaVersion:
    """A lowered program whose compiler does not know one of the options."""

    def __init__(self, message: str) -> None:
        self.message = message
        self.requested: list[dict[str, object] | None] = []

    def compile(self, compiler_options: dict[str, object] | None) -> str:
        self.requested.append(dict(compiler_options) if compiler_options else None)
        if compiler_options and "xla_cpu_use_fusion_emitters" in compiler_options:
            raise jax.errors.JaxRuntimeError(self.message)
        return "program"


def test_only_options_unknown_to_xla_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_parallel_codegen_split_count=8")
    other = OtherXlaVersion("INVALID_ARGUMENT: No such compile option: 'xla_cpu_use_fusion_emitters'")
    assert compiler_options.compile_with_options(other, compiler_options.PREPARATION_OPTIONS) == "program"
    assert other.requested[-1] == {"xla_backend_optimization_level": 0}


def test_other_errors_of_the_compiler_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XLA_FLAGS", "")
    other = OtherXlaVersion("RESOURCE_EXHAUSTED: out of memory")
    with pytest.raises(jax.errors.JaxRuntimeError, match="out of memory"):
        compiler_options.compile_with_options(other, compiler_options.PREPARATION_OPTIONS)
    assert len(other.requested) == 1


@pytest.mark.parametrize(
    ("backend", "expected"),
    [("gpu", {"xla_disable_hlo_passes": "triton-softmax-rewriter"}), ("tpu", None)],
)
def test_options_of_a_cpu_are_not_for_other_backends(
    monkeypatch: pytest.MonkeyPatch, backend: str, expected: dict[str, object] | None
) -> None:
    monkeypatch.setenv("XLA_FLAGS", "")
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    lowered = OtherXlaVersion("")
    compiler_options.compile_with_options(lowered, compiler_options.PREPARATION_OPTIONS)
    assert lowered.requested == [expected]
