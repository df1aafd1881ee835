"""How many small faults in the code the tests notice: mutation testing on a fixed draw.

    python -m research.mutation draw --out mutants.json
    python -m research.mutation run mutants.json --checkout DIR --out results.jsonl
    python -m research.mutation compare before.jsonl after.jsonl

`draw` chooses mutants of the checkout in which it runs, at random by a seed. A mutant is a changed
line of a function. `run` makes the change in a checkout of any commit that still has the function
and the line, runs the tests of its area until one fails, and takes the change back. A mutant whose
line is missing is counted as gone. A stopped run continues. So two commits are judged by the same
mutants, also if files were merged between them.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import json
import os
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import cache_from_source
from pathlib import Path
from typing import NamedTuple

AREAS = {
    "core": (("roadscope/core",), ("tests/core", "tests/laws/test_pose_laws.py")),
    "metrics": (
        ("roadscope/benchmarks/metrics",),
        ("tests/benchmarks/metrics", "tests/test_metrics.py"),
    ),
    "trackers": (
        (
            "roadscope/trackers/_assignment.py",
            "roadscope/trackers/_gating.py",
            "roadscope/trackers/_kalman.py",
        ),
        ("tests/trackers",),
    ),
}
"""Files that are mutated, and the tests of each area."""
NOT_DRAWN = (
    "RemoveDecorator",
    "Variable",
    "NoOp",
    "ExceptionReplacer",
    "_Bit",
    "_LShift",
    "_RShift",
)
"""Operators that change no behaviour (a kernel without its decorator), that need settings, or that
fail at once in arithmetic."""
TIMEOUT_S = 900.0


class Mutant(NamedTuple):
    """One changed line.

    function: qualified name of the innermost function or class that holds the line, or "".
    line, mutated: the text before and after. number: its place among equal lines of it.
    """

    area: str
    operator: str
    function: str
    line: str
    mutated: str
    number: int


class Site(NamedTuple):
    """Where an operator of cosmic-ray applies: its occurrence-th place in a file."""

    area: str
    path: Path
    operator: str
    occurrence: int


def drawn(root: Path, count: int, seed: int, also: Path | None = None) -> list[Mutant]:
    """Return `count` mutants of a checkout's areas, one for each line at most.

    also: another checkout, in which their lines must be, too.
    """
    sites = [
        site
        for area, (places, _) in AREAS.items()
        for path in _files(root, places)
        for site in _sites(area, path)
    ]
    random.Random(seed).shuffle(sites)
    mutants: dict[tuple[str, str, int], Mutant] = {}
    for site in sites:
        mutant = _mutant(site)
        if mutant is not None and (also is None or located(also, mutant)):
            mutants.setdefault((mutant.function, mutant.line, mutant.number), mutant)
        if len(mutants) == count:
            break
    return list(mutants.values())


def _sites(area: str, path: Path) -> Iterator[Site]:
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    nodes = list(ast_nodes(get_ast(path.read_text(encoding="utf-8"))))
    for name in sorted(operator_names()):
        if not any(word in name for word in NOT_DRAWN):
            operator = get_operator(name)()
            places = sum(len(list(operator.mutation_positions(node))) for node in nodes)
            yield from (Site(area, path, name, occurrence) for occurrence in range(places))


def _mutant(site: Site) -> Mutant | None:
    """Return the mutant of a site; None if it changes more than one line."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    code = site.path.read_text(encoding="utf-8")
    mutated = mutate_code(code, get_operator(site.operator)(), site.occurrence)
    lines = code.splitlines()
    change = None if mutated is None else _changed_line(lines, mutated.splitlines())
    if change is None:
        return None
    row, text = change
    function, first = _function_at(code, row)
    number = sum(line == lines[row] for line in lines[first:row])
    return Mutant(site.area, site.operator, function, lines[row], text, number)


def located(root: Path, mutant: Mutant) -> tuple[Path, int] | None:
    """Return the file and the row of a mutant's line in a checkout; None if it is gone."""
    for path in sorted((root / "roadscope").rglob("*.py")):
        code = path.read_text(encoding="utf-8")
        if mutant.line not in code:
            continue
        rows = [
            row
            for row, line in enumerate(code.splitlines())
            if line == mutant.line and _function_at(code, row)[0] == mutant.function
        ]
        if mutant.number < len(rows):
            return path, rows[mutant.number]
    return None


def verdict(root: Path, mutant: Mutant) -> str:
    """Return what the tests of a checkout say of a mutant: killed, timeout, survived or gone."""
    place = located(root, mutant)
    if place is None:
        return "gone"
    path, row = place
    original = path.read_text(encoding="utf-8")
    lines = original.splitlines(keepends=True)
    lines[row] = f"{mutant.mutated}\n"
    path.write_text("".join(lines), encoding="utf-8")
    tests = [test for test in AREAS[mutant.area][1] if (root / test).exists()]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    # Python tells byte code that is out of date by seconds and size alone.
    bytecode = Path(cache_from_source(str(path)))
    bytecode.unlink(missing_ok=True)
    try:
        done = subprocess.run(
            [*command, *tests],
            cwd=root,
            env={**os.environ, "PYTHONPATH": str(root)},
            capture_output=True,
            timeout=TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        return "timeout"
    finally:
        path.write_text(original, encoding="utf-8")
        bytecode.unlink(missing_ok=True)
    if done.returncode > 2:
        raise RuntimeError(f"tests cannot be run in {root}: {done.stderr.decode()}")
    return "killed" if done.returncode else "survived"


def run(root: Path, mutants: Iterable[Mutant], out: Path) -> Counter[str]:
    """Judge all mutants that `out` has no line of yet; return how many have which verdict."""
    known = _verdicts(out) if out.exists() else {}
    with out.open("a", encoding="utf-8") as file:
        for mutant in mutants:
            if mutant not in known:
                known[mutant] = verdict(root, mutant)
                file.write(json.dumps([*mutant, known[mutant]]) + "\n")
                file.flush()
    return Counter(known.values())


def _verdicts(path: Path) -> dict[Mutant, str]:
    rows = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return {Mutant(*row[:-1]): row[-1] for row in rows}


def _files(root: Path, places: Iterable[str]) -> Iterator[Path]:
    for place in places:
        path = root / place
        yield from sorted(path.rglob("*.py")) if path.is_dir() else [path]


def _changed_line(before: list[str], after: list[str]) -> tuple[int, str] | None:
    """Return the row and the new text of the only line that changed; None if others did too."""
    if len(before) != len(after):
        return None
    changed = [row for row, pair in enumerate(zip(before, after, strict=True)) if len({*pair}) > 1]
    return (changed[0], after[changed[0]]) if len(changed) == 1 else None


def _function_at(code: str, row: int) -> tuple[str, int]:
    """Return the qualified name and the first row of the innermost definition around a row."""
    name, first = "", 0
    nodes: list[ast.AST] = [ast.parse(code)]
    while nodes:
        node = nodes.pop()
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, ast.FunctionDef | ast.ClassDef):
                continue
            if child.lineno - 1 <= row < (child.end_lineno or 0):
                name, first = f"{name}.{child.name}".lstrip("."), child.lineno - 1
                nodes = [child]
                break
    return name, first


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw, run or compare."""
    parser = argparse.ArgumentParser(
        prog="python -m research.mutation",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    draw = commands.add_parser("draw")
    draw.add_argument("--count", type=int, default=300)
    draw.add_argument("--seed", type=int, default=0)
    draw.add_argument("--also", type=Path, help="checkout in which their lines must be, too")
    draw.add_argument("--out", type=Path, required=True)
    judge = commands.add_parser("run")
    judge.add_argument("mutants", type=Path)
    judge.add_argument("--checkout", type=Path, default=Path.cwd())
    judge.add_argument("--out", type=Path, required=True)
    compare = commands.add_parser("compare")
    compare.add_argument("before", type=Path)
    compare.add_argument("after", type=Path)
    options = parser.parse_args(arguments)
    if options.command == "draw":
        mutants = drawn(Path.cwd(), options.count, options.seed, options.also)
        options.out.write_text(json.dumps(mutants, indent=0) + "\n", encoding="utf-8")
        print(Counter(mutant.area for mutant in mutants))
    elif options.command == "run":
        mutants = [Mutant(*row) for row in json.loads(options.mutants.read_text(encoding="utf-8"))]
        print(run(options.checkout.resolve(), mutants, options.out))
    else:
        before, after = _verdicts(options.before), _verdicts(options.after)
        shared = [m for m in before if "gone" not in (before[m], after.get(m, "gone"))]
        for name, verdicts in (("before", before), ("after", after)):
            print(name, Counter(verdicts[mutant] for mutant in shared))
        for mutant in shared:
            if (before[mutant], after[mutant]) == ("killed", "survived"):
                print("survives now:", *difflib.ndiff([mutant.line], [mutant.mutated]), sep="\n  ")


if __name__ == "__main__":
    main()
