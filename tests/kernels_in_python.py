"""Kernels as the plain Python they were written in, to compare with what numba made of them."""

from types import ModuleType


def in_python(monkeypatch, *modules: ModuleType) -> None:
    """Until the test ends, every kernel that these modules define is its Python function, wherever they use it."""
    own = {module.__name__ for module in modules}
    for module in modules:
        for name, kernel in list(vars(module).items()):
            python = getattr(kernel, "py_func", None)
            if python is not None and python.__module__ in own:
                monkeypatch.setattr(module, name, python)
