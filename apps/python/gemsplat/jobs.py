# SPDX-License-Identifier: Apache-2.0
"""Every command of the program as a function: gemsplat.jobs.export("out/scene", "scene.spz").

Keyword arguments, their defaults and meanings are the command's options. A function returns what
the command prints with --json. Where work has failed that had a result, the error has it as `result`.

progress, a function of one argument, gets the command's events while it works, dicts as those of
--progress json. If it raises an exception, the work ends as after Ctrl-C, and the exception comes out.
"""

import functools
import inspect
import json
import os
from inspect import Parameter

from . import _gemsplat

_PLACE, _KEYWORD = Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY
_KINDS = {"bool": "bool", "int": "int", "float": "float", "text": "Text"}
_PROGRESS = Parameter("progress", _KEYWORD, default=None, annotation="Optional[Callable[[dict[str, Any]], object]]")


def _plain(value):
    """What json does not know: NumPy's values, paths, and other lists."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "__fspath__"):
        return os.fspath(value)
    if hasattr(value, "__iter__"):
        return list(value)
    raise _gemsplat.UsageError(f"an argument cannot be a {type(value).__name__}")


def as_json(value):
    return json.dumps(value, default=_plain, allow_nan=False, ensure_ascii=False)


def _annotation(option):
    kind = _KINDS[option["kind"]]
    if option["choices"]:
        kind = f"Literal[{', '.join(map(repr, option['choices']))}]"
    elif option["setting"] and kind in ("int", "float"):  # or a word, such as auto
        kind = f"Union[{kind}, str]"
    if option["stands_alone"]:
        kind = f"Union[bool, {kind}]"
    if option["name"] == "set":
        kind = "Union[Mapping[str, Any], Sequence[str]]"
    elif option["several"]:
        kind = f"Union[{kind}, Sequence[{kind}]]"
    return kind if option["required"] or option["default"] is not None else f"Optional[{kind}]"


def _parameter(option, kind=_KEYWORD):
    default = tuple(option["default"]) if isinstance(option["default"], list) else option["default"]
    return Parameter(option["name"], kind, default=Parameter.empty if option["required"] else default,
                     annotation=_annotation(option))


def _described(doc, options):
    return "\n".join([inspect.cleandoc(doc), "", *(f"{o['name']}: {o['meaning']}" for o in options)])


def _check(name, keywords, parameters):
    for keyword in keywords:
        if keyword not in parameters:
            nearest = _gemsplat.nearest_word(keyword, list(parameters))
            hint = f"did you mean {nearest}?" if nearest else f"help(gemsplat.{name}) lists them"
            raise _gemsplat.UsageError(f"{name} has no keyword {keyword}; {hint}")


_VERBS = {(verb.replace("-", "_") + "_" + sub).rstrip("_"): (verb, sub, meaning, json.loads(options))
          for verb, sub, meaning, options in _gemsplat.list_verbs()}


def takes(verb, names):
    """Lets a function on arrays take options of a verb, by name, as keyword arguments."""
    chosen = [option for option in _VERBS[verb][3] if option["name"] in names.split()]

    def decorate(function):
        own = inspect.signature(function)
        parameters = [p for p in own.parameters.values() if p.kind is not Parameter.VAR_KEYWORD]
        signature = own.replace(parameters=[*parameters, *map(_parameter, chosen)])

        @functools.wraps(function)
        def call(*arguments, **keywords):
            _check(function.__qualname__.replace(".__init__", ""), keywords, list(signature.parameters))
            return function(*arguments, **keywords)

        call.__signature__ = signature
        call.__doc__ = _described(function.__doc__, chosen)
        return call

    return decorate


def _job(name, verb, sub, meaning, options):
    options = sorted(options, key=lambda option: not option["place"])
    places = [option["name"] for option in options if option["place"]]
    parameters = [_parameter(option, _PLACE if option["place"] else _KEYWORD) for option in options]
    signature = inspect.Signature([*parameters, _PROGRESS], return_annotation="Any")

    def job(*arguments, **keywords):
        _check("jobs." + name, keywords, list(signature.parameters))
        bound = signature.bind(*arguments, **keywords).arguments
        progress = keywords.pop("progress", None)
        # Keywords in the order of the call, which counts for edit.
        values = {**{place: bound[place] for place in places if place in bound}, **keywords}
        text, failure = _gemsplat.run_job(verb, sub, as_json(values), progress)
        if failure:
            error = _gemsplat.Error(failure)
            error.result = json.loads(text)
            raise error
        return json.loads(text)

    job.__name__ = job.__qualname__ = name
    job.__signature__ = signature
    command = f"gemsplat {verb} {sub}".rstrip()
    job.__doc__ = _described(f"{meaning}: `{command}`.", options)
    return job


__all__ = list(_VERBS)
globals().update({name: _job(name, *verb) for name, verb in _VERBS.items()})
