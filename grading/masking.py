"""A copy of the library without what is asked: masked bodies raise, checks and course tools are left out."""

import ast
import shutil
from collections.abc import Iterable
from pathlib import Path

from dualnav_lite.config import UnusableInput

PACKAGE = "dualnav_lite"
LEFT_OUT = ("__pycache__", "*.pyc", "parts.py", "course.py", "exercises.py", "check")
# Given cells import it; in grading nothing is checked by the student's side.
CHECK_STUB = '''"""Checks are not part of grading."""

LESSONS = {}


def check(*arguments, **options):
    """Nothing: the scorer asks its own questions."""
'''
DATA = ("stress_tests/scenarios",)  # what the library reads beside itself


def masked_copy(package: Path, symbols: dict[str, str], out: Path) -> Path:
    """A folder with the library as the sandbox sees it.

    Args:
        package: the library's folder.
        symbols: exercise by `module:function` or `module:Class.method`, such as `rollout:gae`.
        out: folder to make; it will hold `dualnav_lite/` and the scenarios.

    Returns:
        `out`.

    Raises:
        UnusableInput: a symbol that the library does not have.
    """
    copy = out / PACKAGE
    shutil.copytree(package, copy, ignore=shutil.ignore_patterns(*LEFT_OUT))
    (copy / "check").mkdir()
    (copy / "check" / "__init__.py").write_text(CHECK_STUB, encoding="utf-8")
    for name in DATA:
        if (package.parent / name).is_dir():
            shutil.copytree(package.parent / name, out / name)
    by_module: dict[str, dict[str, str]] = {}
    for symbol, exercise in symbols.items():
        module, _, function = symbol.partition(":")
        by_module.setdefault(module, {})[function] = exercise
    for module, functions in by_module.items():
        path = copy / (module.replace(".", "/") + ".py")
        if not path.is_file():
            raise UnusableInput(f"rubric: mask names a module that the library does not have: {module}")
        text = path.read_text(encoding="utf-8")
        path.write_text(masked(text, functions, module), encoding="utf-8")
    for path in [out, *out.rglob("*")]:  # read by a user that is neither we nor of our group
        path.chmod(0o755 if path.is_dir() else 0o644)
    return out


def masked(source: str, functions: dict[str, str], module: str) -> str:
    """A module's text with the bodies of functions replaced, docstrings too, since those may tell the formula.

    >>> print(masked("def f(x):\\n    '''Twice.'''\\n    return 2 * x", {"f": "twice"}, "m"))
    def f(x):
        raise NotImplementedError("exercise twice")
    """
    found = {}
    for node in ast.parse(source).body:
        inner = node.body if isinstance(node, ast.ClassDef) else [node]
        prefix = f"{node.name}." if isinstance(node, ast.ClassDef) else ""
        for one in inner:
            if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef) and prefix + one.name in functions:
                found[prefix + one.name] = one
    missing = sorted(set(functions) - set(found))
    if missing:
        raise UnusableInput(f"rubric: mask names what the library does not have: {module}:{missing[0]}")
    lines = source.splitlines()
    for name, node in sorted(found.items(), key=lambda item: -item[1].lineno):
        first, last = node.body[0], node.body[-1]
        margin = " " * first.col_offset
        if first.lineno == node.lineno:
            raise UnusableInput(f"rubric: {module}:{name} is written on one line and cannot be masked")
        lines[first.lineno - 1 : last.end_lineno] = [f'{margin}raise NotImplementedError("exercise {functions[name]}")']
    return "\n".join(lines) + ("\n" if source.endswith("\n") else "")


def tainted_kernels(package: Path, symbols: Iterable[str]) -> set[str]:
    """Kernel modules whose compiled code holds something masked: the masked ones and all that import them."""
    tainted = {symbol.partition(":")[0].partition(".")[2] for symbol in symbols if symbol.startswith("kernels.")}
    texts = {path.stem: path.read_text(encoding="utf-8") for path in (package / "kernels").glob("*.py")}
    imports = {name: _kernels_imported(text) for name, text in texts.items()}
    while more := {name for name, others in imports.items() if others & tainted} - tainted:
        tainted |= more
    return tainted


def _kernels_imported(text: str) -> set[str]:
    """Kernel modules that a module imports, wherever in it and in whichever way."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {one.name.rpartition(".")[2] for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {(node.module or "").rpartition(".")[2]} | {one.name for one in node.names}
    return found
