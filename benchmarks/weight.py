"""Weight of the house: lines and modules of package and tests, functions too long or with too many arguments.

python benchmarks/weight.py [ROOT]
"""

import ast
import sys
from pathlib import Path

LONGEST = 60  # lines of a function, docstring not counted
MOST_ARGUMENTS = 8


def functions(path: Path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
            a = node.args
            arguments = len(
                [n for n in (*a.posonlyargs, *a.args, *a.kwonlyargs) if n.arg not in {"self", "cls"}]
            )
            yield node.name, lines, arguments


def main() -> None:
    root = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    package = sorted((root / "src").rglob("*.py"))
    counts: dict[str, int] = {}
    long, wide = [], []
    for path in package:
        folder = path.relative_to(root / "src" / "pymantaray").parts[0]
        counts[folder] = counts.get(folder, 0) + len(path.read_text().splitlines())
        for name, lines, arguments in functions(path):
            if lines > LONGEST:
                long.append(f"{path.stem}.{name} ({lines})")
            if arguments > MOST_ARGUMENTS:
                wide.append(f"{path.stem}.{name} ({arguments})")
    tests = sorted((root / "tests").rglob("*.py"))
    for folder, lines in sorted(counts.items()):
        print(f"{folder:16} {lines:6}")
    print(f"package: {sum(counts.values())} lines, {len(package)} modules")
    print(f"tests: {sum(len(p.read_text().splitlines()) for p in tests)} lines, {len(tests)} modules")
    print(f"functions of more than {LONGEST} lines: {len(long)}: {', '.join(long)}")
    print(f"functions of more than {MOST_ARGUMENTS} arguments: {len(wide)}: {', '.join(wide)}")


main()
