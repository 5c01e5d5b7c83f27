"""The public names of the package, grouped, with signatures and docstrings from the source."""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from typing import Any

_LONGEST_LINE = 100
"""Letters of a signature that stays in one line."""

GROUPS = {
    "Scenarios": ("load", "ScenarioFile", "Scenario", "Params", "nominal_parameters"),
    "One run": ("simulate", "initialise_run", "init", "run_key", "step", "rollout", "State", "Telemetry"),
    "Campaigns": ("run_campaign", "resume_campaign", "Campaign", "open_campaign", "Retention", "Shard", "RunRange"),
    "Reports and exports": ("write_report", "compare", "export"),
    "Analyses": (
        "gradient",
        "sensitivity",
        "tune",
        "linear_covariance",
        "worst_case",
        "estimate_probability",
        "robustness",
        "faults",
    ),
    "Flight software and plugins": ("Stages", "Plugin", "metric", "AdditionalSensor"),
    "The process": ("prepare_process", "RpojaxError"),
}
"""Heading -> names; together all of `rpojax.__all__` but the version, which a test checks."""

_HEADINGS = {"Args": "Arguments", "Attributes": "Attributes", "Raises": "Raises", "Returns": "Returns"}
"""Part of a docstring -> its heading on the page."""
_FIELDS_ELSEWHERE = {"Scenario", "Params", "State", "Telemetry", "ScenarioFile"}
"""Records with so many fields that pages of their own describe them."""


def lines() -> Iterator[str]:
    """Markdown with signature, docstring and members of each name, from the source alone."""
    import rpojax

    for heading, names in GROUPS.items():
        yield from (f"## {heading}", "")
        for name in names:
            found = getattr(rpojax, name)
            yield from (f"### `rpojax.{name}`", "")
            yield from _of_class(name, found) if isinstance(found, type) else _of_function(name, found)


def _of_function(name: str, function: Callable[..., Any]) -> Iterator[str]:
    node = _definition(function)
    assert isinstance(node, ast.FunctionDef)
    yield from ("```text", _signature(f"rpojax.{name}", node, skip=0), "```", "")
    yield from _markdown(ast.get_docstring(node) or "")


def _of_class(name: str, found: type) -> Iterator[str]:
    node = _definition(found)
    assert isinstance(node, ast.ClassDef)
    yield from _markdown(ast.get_docstring(node) or "")
    if name in _FIELDS_ELSEWHERE:
        return
    methods = [each for each in node.body if isinstance(each, ast.FunctionDef)]
    for made in (each for each in methods if each.name == "__init__"):
        yield from ("```text", _signature(f"rpojax.{name}", made, skip=1), "```", "")
    public = [(each, text) for each in methods if each.name[0] != "_" and (text := ast.get_docstring(each))]
    if public:
        yield from ("Members:", "")
        for method, text in public:
            yield from _of_member(f"{name}.{method.name}", method, text)
        yield ""


def _of_member(name: str, method: ast.FunctionDef, text: str) -> Iterator[str]:
    """Item of a list for a method or a property with its docstring."""
    kinds = {ast.unparse(each) for each in method.decorator_list}
    skip = 0 if "staticmethod" in kinds else 1
    shown = name if kinds & {"property", "cached_property"} else _signature(name, method, skip)
    first, _, more = text.partition("\n\n")
    yield f"- `{shown}`: {_plain(first)}"
    yield from (f"  {line}".rstrip() for line in (["", *_markdown(more)][:-1] if more else []))


def _definition(found: Any) -> ast.stmt:
    """The statement of the source that defines a class or a function."""
    return ast.parse(textwrap.dedent(inspect.getsource(inspect.unwrap(found)))).body[0]


def _signature(name: str, node: ast.FunctionDef, skip: int) -> str:
    """Name with parameters, without the first `skip`, and result, as the source has them; long ones one a line."""
    arguments = node.args
    arguments.args = arguments.args[skip:]  # without self
    result = "" if node.returns is None or node.name == "__init__" else f" -> {ast.unparse(node.returns)}"
    result = result.replace("'", "")
    parameters = list(_parameters(arguments))
    whole = f"{name}({', '.join(parameters)}){result}"
    if skip or len(whole) <= _LONGEST_LINE:
        return whole
    return "\n".join([f"{name}(", *(f"    {each}," for each in parameters), f"){result}"])


def _parameters(arguments: ast.arguments) -> Iterator[str]:
    """Each parameter with its type and default, and the marks between them."""
    defaults = [None] * (len(arguments.args) - len(arguments.defaults)) + list(arguments.defaults)
    for argument, default in zip(arguments.args, defaults, strict=True):
        yield ast.unparse(argument) + ("" if default is None else f" = {ast.unparse(default)}")
    if arguments.vararg or arguments.kwonlyargs:
        yield "*" if arguments.vararg is None else f"*{ast.unparse(arguments.vararg)}"
    for argument, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
        yield ast.unparse(argument) + ("" if default is None else f" = {ast.unparse(default)}")
    if arguments.kwarg is not None:
        yield f"**{ast.unparse(arguments.kwarg)}"


def _markdown(docstring: str) -> Iterator[str]:
    """A docstring with its parts as lists."""
    for part in filter(None, docstring.split("\n\n")):
        heading, _, body = part.partition(":\n")
        if heading not in _HEADINGS:
            yield from (part if part.startswith("|") else _plain(part), "")
            continue
        yield from (f"{_HEADINGS[heading]}:", "")
        for name, text in re.findall(r"^(\S[^:\n]*):((?:.|\n(?=\s))*)", textwrap.dedent(body), re.MULTILINE):
            yield f"- `{name}`: {_plain(text)}"
        yield ""


def _plain(text: str) -> str:
    """Text in one line, in which nothing but what is in backquotes is markup."""
    pieces = re.split(r"(`[^`]*`)", " ".join(text.split()))
    return "".join(each if each.startswith("`") else re.sub(r"([*<\[\]|])", r"\\\1", each) for each in pieces)
