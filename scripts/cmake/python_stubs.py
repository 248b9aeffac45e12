# SPDX-License-Identifier: Apache-2.0
"""python_stubs.py FOLDER: writes __init__.pyi, jobs.pyi and compat/__init__.pyi of the module on PYTHONPATH; the build calls it.

Functions of Python say what they take. Of classes in C++, pybind11 says it in doc strings.
"""

import inspect
import re
import sys
from inspect import Parameter
from pathlib import Path

import gemsplat
import gemsplat.compat

HEADER = """# SPDX-License-Identifier: Apache-2.0
# Written by scripts/cmake/python_stubs.py.
from os import PathLike
from pathlib import Path
from typing import Any, Callable, Iterable, List, Literal, Mapping, NamedTuple, Optional, Sequence, Tuple, Union, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

Text = Union[str, PathLike[str]]
Config = Union[None, Text, Mapping[str, Any], Sequence["Config"]]
"""
OVERLOADS = {"render": [{"camera": "Camera", "return": "Picture"}, {"camera": "Iterable[Camera]", "return": "list[Picture]"}]}


def argument(parameter):
    default = "" if parameter.default is Parameter.empty else f" = {parameter.default!r}"
    stars = {Parameter.VAR_POSITIONAL: "*", Parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
    return f"{stars}{parameter.name}: {parameter.annotation}{default}".replace(": <class 'inspect._empty'>", "")


def signature_of(function, types={}):
    """"(a: int, *, b: str = 'x') -> None"."""
    signature = inspect.signature(function)
    arguments, is_starred = [], False
    for parameter in signature.parameters.values():
        if parameter.kind is Parameter.KEYWORD_ONLY and not is_starred:
            arguments.append("*")
        is_starred |= parameter.kind in (Parameter.KEYWORD_ONLY, Parameter.VAR_POSITIONAL)
        arguments.append(argument(parameter.replace(annotation=types.get(parameter.name, parameter.annotation))))
    return f"({', '.join(arguments)}) -> {types.get('return', signature.return_annotation)}"


def bound_signature(function):
    """Of pybind11, for type checkers."""
    text = re.sub(r"^\w*\((self|arg0): [\w.]+", "(self", function.__doc__.splitlines()[0])
    return re.sub(r"^\w+\(", "(", text).replace("gemsplat.", "").replace("numpy.ndarray[numpy.", "NDArray[np.")


def signature_text(function):
    return signature_of(function) if inspect.isfunction(function) else bound_signature(function)


def member(name, value):
    if isinstance(value, property):
        setter = [f"    @{name}.setter", f"    def {name}{signature_text(value.fset)}: ..."] if value.fset else []
        return ["    @property", f"    def {name}{signature_text(value.fget)}: ...", *setter]
    static = ["    @staticmethod"] if isinstance(value, staticmethod) else []
    return [*static, f"    def {name}{signature_text(getattr(value, '__func__', value))}: ..."]


def class_of(name, kind):
    if issubclass(kind, tuple):
        fields = kind.__annotations__.items()
        return [f"class {name}(NamedTuple):", *(f"    {field}: {hint.__forward_arg__}" for field, hint in fields)]
    if issubclass(kind, Exception):
        return [f"class {name}({', '.join(base.__name__ for base in kind.__bases__)}): ..."]
    shown = {key: value for key, value in vars(kind).items() if not key.startswith("_") or key in ("__len__", "__enter__", "__exit__")
             or (key == "__init__" and inspect.isfunction(value))}
    return [f"class {name}:", *(line for key, value in shown.items() for line in member(key, value))]


def stub_of(module):
    lines = [HEADER]
    for name in module.__all__:
        value = getattr(module, name)
        if inspect.isclass(value):
            lines += class_of(name, value)
        elif name in OVERLOADS and module is gemsplat:
            lines += [f"@overload\ndef {name}{signature_of(value, types)}: ..." for types in OVERLOADS[name]]
        elif callable(value):
            lines.append(f"def {name}{signature_text(value)}: ...")
        else:
            lines.append("from . import jobs" if name == "jobs" else f"{name}: str")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for file, module in {"__init__": gemsplat, "jobs": gemsplat.jobs, "compat/__init__": gemsplat.compat}.items():
        (Path(sys.argv[1]) / f"{file}.pyi").write_text(stub_of(module))
