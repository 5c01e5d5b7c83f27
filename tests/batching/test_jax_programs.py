"""One module alone uses what JAX does not promise to keep."""

import ast
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

import rpojax
from rpojax.batching import jax_programs
from rpojax.batching.jax_programs import Form

FOLDER = Path(rpojax.__file__).parent / "batching"
INTERNALS = {"primitive", "params", "eqns", "jaxpr", "invars", "outvars", "constvars", "aval", "source_info", "ctx"}


def uses(source: str) -> set[str]:
    """What a module uses of JAX's internals: modules that it imports, and attributes."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("jax.", "jax_")):
            found.add(node.module)
        elif isinstance(node, ast.Attribute) and node.attr in INTERNALS:
            found.add(node.attr)
    return found


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.name)
def test_only_one_module_uses_internals_of_jax(path: Path) -> None:
    assert bool(uses(path.read_text(encoding="utf-8"))) == (path.name == "jax_programs.py")


def test_names_of_primitives_are_those_of_jax() -> None:
    def function(x: jnp.ndarray) -> object:
        return jnp.sin(x), jnp.stack([x, x]), x[1:], jnp.where(x > 0.0, x, 0.0)

    forms = [
        operation.form for operation in jax_programs.pure_program(jax.make_jaxpr(function)(jnp.ones(3))).operations
    ]
    assert forms.count(Form.OTHER) == 0
    assert {Form.ELEMENTWISE, Form.ONE_OPERAND, Form.JOIN} <= set(forms)
