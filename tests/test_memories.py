"""
Memories of a process: every cache and every table that modules fill is in this list, with the
reason why it cannot return the result of an earlier input.
"""

import ast

from sources import PACKAGE, nodes_of

CACHES = {"cache", "lru_cache"}
SOURCE = "of this package's own files, which a process reads once"
PURE = "a function of numbers and texts"
MEMORIES = {
    "apps/atlas/blocks.py: _whole": "synthetic oceans only, by name and time",
    "apps/atlas/links.py: _ends": PURE + "; its arrays are read-only",
    "apps/plan/evaluate.py: evaluator_of": "by the plan's fingerprint, of its files, too",
    "apps/service/ranging_service.py: __init__": "of one object, by the time in its own water",
    "apps/study/figures/register.py: _REGISTER": "figures by name, which imported modules add",
    "apps/study/mission.py: medium_of_run": "of one run, by the time in its own water",
    "apps/study/references.py: _references": SOURCE,
    "apps/sweep/stages.py: LATEST": "by the stage's key, with the content of its files",
    "cli/printing.py: _flags": "options of commands, the same in each process",
    "cli/main.py: tree": "commands of applications, the same in each process",
    "compile/kernel.py: _digest": SOURCE,
    "compile/linking.py: known": "compiled functions, of code that a process loads once",
    "compile/linking.py: loaded": "compiled functions, of code that a process loads once",
    "compile/linking.py: packers": "by the types of arguments",
    "apps/authors/holds.py: counted_steps": PURE,
    "config/door/fleet.py: _read": "by the stamps of the files, which change with their content",
    "config/common.py: _may_lack": "of the fields of a class",
    "config/meanings.py: _texts": "of the source of a module, which is in memory",
    "entry_points.py: _loaded": "imported modules, which a process loads once",
    "entry_points.py: _source_hash": "of the source at the import of the module",
    "entry_points.py: extensions": "packages that are installed when a process starts",
    "evaluation/consistency.py: _quadrature": PURE + " without arguments",
    "geometry/frames.py: ellipsoid": PURE + " without arguments",
    "geometry/splines.py: _cached_spline": "by the bytes of the points",
    "installation.py: code_version": SOURCE,
    "messages.py: warn_not_cached": "says a line once",
    "messages.py: warn_once": "says a line once",
    "ocean/synthetic/__init__.py: _kept_ocean": "by name and time; callers get a copy",
    "ocean/window.py: _largest_rectangle": PURE,
    "pages/page.py: packed": PURE,
    "pages/page.py: page_template": SOURCE,
    "records/base.py: _columns": "of the fields of a class",
    "records/stops.py: _DEFERRED": "counts blocks that run now",
    "records/stops.py: requested": "stop requests, after which the process ends",
    "records/stops.py: unfinished": "files that are written now",
    "sensing/other_packages.py: _columns": "of the fields of a class",
}


def name_of(node):
    """Last name of an expression, such as ``cache`` of ``functools.cache``."""
    node = node.func if isinstance(node, ast.Call) else node
    return getattr(node, "attr", getattr(node, "id", ""))


def is_container(value):
    """True for an empty container, or a call that makes one."""
    empty = isinstance(value, ast.Dict | ast.List | ast.Set) and not (
        value.keys if isinstance(value, ast.Dict) else value.elts
    )
    made = isinstance(value, ast.Call) and ast.unparse(value.func).partition("[")[0] in {
        "dict",
        "list",
        "set",
        "defaultdict",
        "OrderedDict",
        "WeakKeyDictionary",
        "WeakValueDictionary",
    }
    return empty or (made and not value.args and not value.keywords)


def memories(nodes):
    """
    Names of cached functions, of module and class attributes that begin empty or contain caches,
    and globals.
    """
    caches = [one for one in nodes if isinstance(one, ast.Call) and name_of(one.func) in CACHES]
    for node in nodes:
        if isinstance(node, ast.Global):
            yield from node.names
        if isinstance(node, ast.FunctionDef):
            if any(name_of(one) in CACHES for one in node.decorator_list):
                yield node.name
            if any(node.body[0].lineno <= one.lineno <= node.end_lineno for one in caches):
                yield node.name
        if isinstance(node, ast.Module | ast.ClassDef):
            for one in node.body:
                if isinstance(one, ast.Assign | ast.AnnAssign) and (
                    is_container(one.value) or any(call in caches for call in ast.walk(one))
                ):
                    target = one.target if isinstance(one, ast.AnnAssign) else one.targets[0]
                    yield ast.unparse(target)


def test_every_memory_of_a_process_has_a_reason():
    found = {
        f"{file.relative_to(PACKAGE).as_posix()}: {name}"
        for file in PACKAGE.rglob("*.py")
        for name in memories(nodes_of(file))
    }
    assert found == set(MEMORIES)
