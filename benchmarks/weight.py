"""
Size and order of package and tests.

Per shelf: modules, lines, lines of code proper (without docstrings, imports, comments and blank
lines), and statements (without docstrings). Then functions that are too long or have too many
arguments (keyword-only options with a default do not count in a public function), parameters typed
as sections of a configuration outside `config`, command-line options in texts outside commands,
lines above 100 columns, and assignments of several values in one statement. Last, the words (with
a letter or digit, so without the bars of tables) and pages of the documentation: README and docs,
of which the decision records are outside the contents of the site.

python benchmarks/weight.py [ROOT]
"""

import ast
import re
import sys
import tokenize
from pathlib import Path

import numpy as np

LONGEST = 60  # lines of a function, docstring not counted
MAX_ARGUMENTS = 8
COLUMNS = 100


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


def statements(path: Path) -> int:
    """Number of statements other than docstrings."""
    return sum(
        isinstance(node, ast.stmt)
        and not (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        )
        for node in ast.walk(ast.parse(path.read_text()))
    )


def shelf(path: Path) -> str:
    """Folder of a module: an application, a folder of the package, or its top."""
    parts = path.parts[:-1]
    return "/".join(parts[:2] if parts[:1] == ("apps",) else parts[:1]) or "(top)"


def section_names(config: Path) -> set[str]:
    """Names of sections and configurations."""
    name = re.compile(r"(Section|Config|RangeModel|Belief)$")
    names = {
        node.name
        for path in config.rglob("*.py")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef) and name.search(node.name)
    }
    return (names | {"AnyBelief", "AnyRangeModel"}) - {"RangeModel"}


def parameters_of(tree: ast.Module, names: set[str]) -> int:
    """Number of parameters whose annotation has one of the names."""
    return sum(
        bool(set(re.findall(r"\w+", ast.unparse(argument.annotation))) & names)
        for argument in ast.walk(tree)
        if isinstance(argument, ast.arg) and argument.annotation is not None
    )


def options_of(tree: ast.Module) -> int:
    """Number of texts, docstrings excepted, that name an option such as --out."""
    described = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    return sum(
        isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in described
        and " " in node.value
        and bool(re.search(r"(?<![\w-])--[a-z]", node.value))
        for node in ast.walk(tree)
    )


def paired(tree: ast.Module) -> int:
    """Number of assignments of a tuple of values to a tuple of names."""
    return sum(
        isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Tuple)
        and isinstance(node.value, ast.Tuple)
        for node in ast.walk(tree)
    )


def of_command(path: Path) -> bool:
    """True for modules of the command line."""
    return path.parts[0] == "cli" or path.stem.endswith("command")


def print_size(root: Path) -> None:
    """Print modules and lines per shelf, and of the tests."""
    package = root / "src" / "pymantaray"
    counts: dict[str, list[int]] = {}
    for file in sorted(package.rglob("*.py")):
        count = counts.setdefault(shelf(file.relative_to(package)), [0, 0, 0, 0])
        count[0] += 1
        count[1] += len(file.read_text().splitlines())
        count[2] += code_proper(file)
        count[3] += statements(file)
    print("shelf             modules   lines   code proper   statements")
    for folder, (modules, lines, code, count) in sorted(counts.items()):
        print(f"{folder:16} {modules:8} {lines:7} {code:13} {count:12}")
    modules, lines, code, count = np.sum(list(counts.values()), axis=0)
    print(f"package: {modules} modules, {lines} lines, {code} of code proper, {count} statements")
    tests = sorted((root / "tests").rglob("*.py"))
    lines = sum(len(path.read_text().splitlines()) for path in tests)
    print(f"tests: {len(tests)} modules, {lines} lines")


def print_order(package: Path) -> None:
    """Print what the habits forbid, with its numbers."""
    names = section_names(package / "config")
    numbers = dict.fromkeys(("sections", "options", "columns", "pairs"), 0)
    long = []
    wide = []
    for file in sorted(package.rglob("*.py")):
        path = file.relative_to(package)
        text = file.read_text()
        tree = ast.parse(text)
        numbers["sections"] += 0 if path.parts[0] == "config" else parameters_of(tree, names)
        numbers["options"] += 0 if of_command(path) else options_of(tree)
        numbers["columns"] += sum(len(line) > COLUMNS for line in text.splitlines())
        numbers["pairs"] += paired(tree)
        for name, lines, arguments in functions(file):
            if lines > LONGEST:
                long.append(f"{path.stem}.{name} ({lines})")
            if arguments > MAX_ARGUMENTS:
                wide.append(f"{path.stem}.{name} ({arguments})")
    print(f"functions of more than {LONGEST} lines: {len(long)}: {', '.join(long)}")
    print(f"functions of more than {MAX_ARGUMENTS} arguments: {len(wide)}: {', '.join(wide)}")
    print(f"parameters typed as sections outside config: {numbers['sections']}")
    print(f"texts with options outside commands: {numbers['options']}")
    print(f"lines above {COLUMNS} columns: {numbers['columns']}")
    print(f"assignments of several values: {numbers['pairs']}")


def print_documentation(root: Path) -> None:
    """Print words and pages of the documentation, and how many of them are decision records."""
    docs = root / "docs"
    words = {
        page: len(re.findall(r"\S*\w\S*", page.read_text(encoding="utf-8")))
        for page in (root / "README.md", *sorted(docs.rglob("*.md")))
    }
    records = [page for page in words if page.is_relative_to(docs / "design")]
    in_records = sum(words[page] for page in records)
    print(
        f"documentation: {sum(words.values())} words; {len(words) - len(records)} pages with"
        f" {sum(words.values()) - in_records}, {len(records)} decision records with {in_records}"
    )


def main() -> None:
    root = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    print_size(root)
    print_order(root / "src" / "pymantaray")
    print_documentation(root)


main()
