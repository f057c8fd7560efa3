"""
Size of package and tests: lines, lines of code proper, modules, functions too long or with too many
arguments.

Code proper has no docstrings, imports, comments and blank lines. Keyword-only options with a
default do not count as arguments of a public function.

python benchmarks/weight.py [ROOT]
"""

import ast
import sys
import tokenize
from pathlib import Path

import numpy as np

LONGEST = 60  # lines of a function, docstring not counted
MAX_ARGUMENTS = 8


def functions(path: Path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
            a = node.args
            private = node.name.startswith("_")
            options = zip(a.kwonlyargs, a.kw_defaults, strict=True)
            counted = [n for n, default in options if private or default is None]
            arguments = [
                n for n in (*a.posonlyargs, *a.args, *counted) if n.arg not in {"self", "cls"}
            ]
            yield node.name, lines, len(arguments)


def code_proper(path: Path) -> int:
    """Number of lines with code other than docstrings and imports."""
    with tokenize.open(path) as file:
        tokens = [
            t
            for t in tokenize.generate_tokens(file.readline)
            if t.string.strip() and t.type != tokenize.COMMENT
        ]
    lines = {line for token in tokens for line in range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(ast.parse(path.read_text())):
        constant = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if constant or isinstance(node, ast.Import | ast.ImportFrom):
            lines.difference_update(range(node.lineno, node.end_lineno + 1))
    return len(lines)


def main() -> None:
    root = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    package = sorted((root / "src").rglob("*.py"))
    counts: dict[str, list[int]] = {}
    long, wide = [], []
    for path in package:
        folder = path.relative_to(root / "src" / "pymantaray").parts[0]
        count = counts.setdefault(folder, [0, 0])
        count[0] += len(path.read_text().splitlines())
        count[1] += code_proper(path)
        for name, lines, arguments in functions(path):
            if lines > LONGEST:
                long.append(f"{path.stem}.{name} ({lines})")
            if arguments > MAX_ARGUMENTS:
                wide.append(f"{path.stem}.{name} ({arguments})")
    tests = sorted((root / "tests").rglob("*.py"))
    print("folder            lines   code proper")
    for folder, (lines, code) in sorted(counts.items()):
        print(f"{folder:16} {lines:6} {code:13}")
    lines, code = np.sum(list(counts.values()), axis=0)
    print(f"package: {lines} lines, {code} of code proper, {len(package)} modules")
    print(
        f"tests: {sum(len(p.read_text().splitlines()) for p in tests)} lines, {len(tests)} modules"
    )
    print(f"functions of more than {LONGEST} lines: {len(long)}: {', '.join(long)}")
    print(f"functions of more than {MAX_ARGUMENTS} arguments: {len(wide)}: {', '.join(wide)}")


main()
