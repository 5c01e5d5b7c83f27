"""Modules of the commands: their import starts no backend of JAX, whose flags a command sets before it computes."""

import subprocess
import sys

from rpojax.cli.main import COMMANDS
from rpojax.cli.options.arguments import Group


def test_no_command_starts_a_backend_by_its_import() -> None:
    works = {
        each.work.partition(":")[0]
        for command in COMMANDS.values()
        for each in (command.commands.values() if isinstance(command, Group) else [command])
    }
    code = (
        "import importlib, jax._src.xla_bridge as bridge\n"
        f"for name in {sorted(works)!r}:\n"
        "    importlib.import_module(f'rpojax.cli.commands.{name}')\n"
        "    assert not bridge.backends_are_initialized(), name\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-500:]
