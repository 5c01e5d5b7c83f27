"""Share of small faults that the tests find: `python tests/mutants.py --out FILE`.

A fault is planted in a copy of the project, one at a time: a sign, a factor of two, a swapped axis, an off-by-one, a
dropped term or a wrong frame in a function of the numerical packages. The tests that import its module run until the
first failure, for a limited processor time. Results are appended to the file, so that an interrupted call goes on where
it stopped. With `--planted FILE` the faults are those of another call, found again by the text of their lines, so that
two versions of the tests are judged by the same faults.
"""

import argparse
import ast
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("core", "physics", "flight", "sensors", "metrics", "analysis/statistics")
_FRAMES = {"apply": "apply_transposed", "apply_transposed": "apply", "conjugate": "normalize"}
_FAILED = 1
_WALL_LIMITS = 5.0
"""Limits of wall time, in limits of processor time."""


@dataclass(frozen=True)
class Mutant:
    """A fault: at the line of a file the text `before` becomes `after`.

    Attributes:
        kind: what is wrong
        file: from the root of the project
        line: number
        before: whole lines
        after: whole lines
    """

    kind: str
    file: str
    line: int
    before: str
    after: str


def mutants(file: Path) -> Iterator[Mutant]:
    """All faults that can be planted in a file."""
    text = file.read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    for function in ast.walk(ast.parse(text)):
        if not isinstance(function, ast.FunctionDef):
            continue
        for statement in function.body:
            if isinstance(statement, ast.FunctionDef | ast.Assert | ast.Raise):
                continue
            for node in ast.walk(statement):
                if isinstance(node, ast.expr) and not isinstance(node, ast.JoinedStr):
                    for kind, replacement in _replacements(node):
                        first, last = node.lineno - 1, node.end_lineno or node.lineno
                        before = "".join(lines[first:last])
                        end = len("".join(lines[first : last - 1])) + _column(lines[last - 1], node.end_col_offset or 0)
                        start = _column(lines[first], node.col_offset)
                        after = f"{before[:start]}{replacement}{before[end:]}"
                        yield Mutant(kind, file.relative_to(ROOT).as_posix(), node.lineno, before, after)


def _column(line: str, offset: int) -> int:
    """Place in a line of an offset in its bytes."""
    return len(line.encode()[:offset].decode())


def _replacements(node: ast.expr) -> Iterator[tuple[str, str]]:
    """Kinds of faults in place of an expression, each with its text."""
    match node:
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            other = "-" if isinstance(op, ast.Add) else "+"
            yield "sign", f"({ast.unparse(left)} {other} {ast.unparse(right)})"
            yield "dropped term", f"({ast.unparse(left)})"
        case ast.UnaryOp(op=ast.USub(), operand=ast.expr() as operand) if not isinstance(operand, ast.Constant):
            yield "sign", f"({ast.unparse(operand)})"
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            yield "factor of two", f"(2.0 * {ast.unparse(node)})"
        case ast.Constant(value=float() as value) if value not in (0.0, 1.0):
            yield "factor of two", repr(2.0 * value)
        case ast.Subscript(value=value, slice=ast.Constant(value=int() as index)) if 0 <= index < 3:
            yield "swapped axis", f"{ast.unparse(value)}[{(index + 1) % 3}]"
        case ast.Call(func=ast.Attribute() | ast.Name() as called, args=args) if len(args) == 2:
            name = called.attr if isinstance(called, ast.Attribute) else called.id
            if name in ("cross", "subtract", "arctan2", "multiply"):
                yield "swapped axis", f"{ast.unparse(called)}({ast.unparse(args[1])}, {ast.unparse(args[0])})"
            elif name in _FRAMES:
                yield "wrong frame", f"{_renamed(called, _FRAMES[name])}({', '.join(map(ast.unparse, args))})"
        case ast.Call(func=ast.Attribute(attr="conjugate"), args=[argument]):
            yield "wrong frame", f"({ast.unparse(argument)})"
        case ast.Call(func=ast.Name(id="range"), args=[*rest, last]):
            yield "off by one", f"range({', '.join([*map(ast.unparse, rest), f'{ast.unparse(last)} - 1'])})"
        case ast.Compare(left=left, ops=[ast.Lt() | ast.LtE() | ast.Gt() | ast.GtE() as op], comparators=[right]):
            other = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}[type(op)]
            yield "off by one", f"({ast.unparse(left)} {other} {ast.unparse(right)})"
        case ast.Slice():
            pass
        case ast.Constant(value=int() as value) if not isinstance(value, bool) and value > 1:
            yield "off by one", str(value - 1)


def _renamed(called: ast.Attribute | ast.Name, name: str) -> str:
    return f"{ast.unparse(called.value)}.{name}" if isinstance(called, ast.Attribute) else name


def chosen(count: int, seed: int) -> list[Mutant]:
    """Faults of all kinds and packages in turn, at random places."""
    generator = random.Random(seed)
    found: dict[tuple[str, str], list[Mutant]] = defaultdict(list)
    for package in PACKAGES:
        for file in sorted((ROOT / "rpojax" / package).rglob("*.py")):
            for mutant in mutants(file):
                if _is_program(mutant):
                    found[mutant.kind, package].append(mutant)
    kinds = sorted({kind for kind, _ in found})
    picked: list[Mutant] = []
    while len(picked) < count:
        number = len(picked)
        places = found.get((kinds[number % len(kinds)], PACKAGES[(number // len(kinds)) % len(PACKAGES)]), [])
        rest = places or list(generator.choice(sorted(found.items()))[1])
        mutant = generator.choice(rest)
        if mutant not in picked:
            picked.append(mutant)
    return picked


def _is_program(mutant: Mutant) -> bool:
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    try:
        compile(text.replace(mutant.before, mutant.after, 1), mutant.file, "exec")
    except SyntaxError:
        return False
    return mutant.before != mutant.after


def importing_tests(file: str) -> list[str]:
    """Test files that import a module of the project, or its nearest users, themselves or by helpers of the tests.

    That of the module's own name comes first, then those of its folder, small ones before large ones.
    """
    wanted = {_module_name(Path(file))}
    imports = {path: _imports(ROOT / path) for path in _python_files()}
    for _ in range(4):
        helpers = set[str]()
        for _ in range(3):
            users = [
                path for path, names in imports.items() if path.startswith("tests/") and names & (wanted | helpers)
            ]
            helpers |= {Path(path).stem for path in users if not Path(path).name.startswith(("test_", "conftest"))}
        if tests := [path for path in users if Path(path).name.startswith("test_")]:
            return sorted(tests, key=lambda path: _distance(path, file))
        wanted |= {_module_name(Path(path)) for path, names in imports.items() if names & wanted}
    return []


def _distance(test: str, file: str) -> tuple[bool, int, int]:
    """Order of a test file among those of a module's."""
    folders, own = Path(test).parts[1:-1], Path(file).parts[1:-1]
    common = next((k for k, pair in enumerate(zip(folders, own, strict=False)) if pair[0] != pair[1]), len(folders))
    named = Path(test).name == f"test_{Path(file).name}"
    return not named, -common, (ROOT / test).stat().st_size


def _python_files() -> list[str]:
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, check=True, capture_output=True, text=True)
    return [each for each in listed.stdout.splitlines() if (ROOT / each).exists()]


def _module_name(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def _imports(file: Path) -> set[str]:
    """Names of modules that a file imports, and of what it takes from them, which may be modules."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def outcome(mutant: Mutant, limit_s: float) -> tuple[str, str]:
    """Whether the tests find a fault (`found`, `missed`, `time` or `gone`), and the test that does."""
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    if text.count(mutant.before) < 1:
        return "gone", ""
    tests = importing_tests(mutant.file)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "project"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv*", "__pycache__", "results", "out"))
        at = sum(len(line) for line in text.splitlines(keepends=True)[: mutant.line - 1])
        here = text[at:].startswith(mutant.before)
        place = at if here else text.index(mutant.before)
        (copy / mutant.file).write_text(text[:place] + mutant.after + text[place + len(mutant.before) :], "utf-8")
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "--no-header", "-p", "no:cacheprovider", *tests]
        try:
            ended = subprocess.run(
                command,
                cwd=copy,
                env=os.environ | {"PYTHONPATH": str(copy)},
                capture_output=True,
                text=True,
                timeout=_WALL_LIMITS * limit_s,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (round(limit_s), round(limit_s) + 5)),
            )
        except subprocess.TimeoutExpired:
            return "time", ""
    lines = [each for each in ended.stdout.splitlines() if each.startswith(("FAILED", "ERROR"))]
    if ended.returncode < 0:
        return "time", ""
    return ("missed", "") if ended.returncode == 0 else ("found", lines[0].split(" - ")[0] if lines else "collection")


def main() -> None:
    """Plants the faults that are not in the file yet, and prints the share that was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="file of results, appended to")
    parser.add_argument("--planted", type=Path, help="results whose faults are planted again")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=60.0, help="processor time for each [s]")
    parser.add_argument("--jobs", type=int, default=1, help="faults tried at a time")
    options = parser.parse_args()
    if options.planted:
        records = [json.loads(line)["mutant"] for line in options.planted.read_text().splitlines()]
        planted = [Mutant(**record) for record in records]
    else:
        planted = chosen(options.count, options.seed)
    done = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    writing = threading.Lock()

    def judge(mutant: Mutant) -> None:
        begin = time.perf_counter()
        found, test = outcome(mutant, options.limit)
        with writing:
            done.append({"mutant": asdict(mutant), "outcome": found, "test": test})
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(done[-1]) + "\n")
            seconds = time.perf_counter() - begin
            print(f"{found:7} {mutant.kind:14} {mutant.file}:{mutant.line} {seconds:.0f} s", flush=True)

    judged_before = [Mutant(**each["mutant"]) for each in done]
    with ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(judge, [mutant for mutant in planted if mutant not in judged_before]))
    judged = [each for each in done if each["outcome"] != "gone"]
    share = sum(each["outcome"] == "found" for each in judged) / max(len(judged), 1)
    print(f"{100.0 * share:.0f} % of {len(judged)} found")


if __name__ == "__main__":
    main()
