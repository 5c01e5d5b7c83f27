"""Command lines that are printed for a user to repeat: quoted for a shell, with what the scenario's plugin needs."""

import shlex
from pathlib import Path

from rpojax.scenario.plugins.plugin_registry import FROM_PYTHON


def command_line(verb: str, *words: object, plugin: str | None) -> str:
    """Command `rpojax VERB WORDS`; `plugin` is the reference to that of the scenario, None without one."""
    text = shlex.join(["rpojax", *verb.split(), *map(_word, words)])
    return f"{text} --allow-plugin" if needs_permission(plugin) else text


def needs_permission(plugin: str | None) -> bool:
    """Whether a plugin is a file of code, which a command executes with `--allow-plugin` only."""
    return plugin is not None and plugin != FROM_PYTHON


def _word(word: object) -> str:
    """A word as text; a path that looks like an option gets its folder."""
    return f"./{word}" if isinstance(word, Path) and str(word).startswith("-") else str(word)
