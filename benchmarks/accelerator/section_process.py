"""One section in a process of its own, `python -m benchmarks.accelerator.section_process NAME [--small]`.

It writes its entries as lines of JSON, `["entry", {...}]`, each as soon as it is measured.
"""

import importlib
import json
import sys
from collections.abc import Sequence

from benchmarks.accelerator import section_list, sizes
from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag


def main(arguments: Sequence[str]) -> None:
    """Measures the section `arguments[0]`, with small sizes if `--small` follows."""
    section = section_list.section_named(arguments[0])
    prepare_jax(cache=False)
    set_loop_fusion_flag(rendered=section.rendered)
    module = importlib.import_module(f"benchmarks.accelerator.{section.module}")
    chosen = sizes.SMALL if "--small" in arguments else sizes.ACCELERATOR
    for entry in module.measure(chosen, *section.arguments):
        print(json.dumps(["entry", entry], allow_nan=False), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
