"""The deliberate faults, which are rows of `table.tsv`.

The columns are separated by tabs:

- what is wrong, in words; empty if the row is a further patch of the fault above it;
- the dotted path of what is changed, or the name of a template of `epcontact.output`;
- the place that is changed;
- what it becomes;
- what sees it: a test, or a case and the quantity whose gate turns red, followed by
  fields of `Fault` such as `status=error`.

A place is a pattern of code in the function (see `breaking.rewrite`), a text of the
template, or one of these words, for which the next column is a Python expression:

- `value`: a constant; the expression may use `value`;
- `call`: the whole function; the expression may use `arguments`, a tuple;
- `argument NAME`, or `argument NUMBER` from 1: its value is `argument`;
- `result`: what the function returns, `result`;
- `field NAME`, `quantity NAME`, `areas`: a part of the result of a method, `value`.

The expressions may use the names in `breaking.mistakes`.
"""

import csv
import functools
import inspect
from dataclasses import replace
from pathlib import Path

from breaking import mistakes
from breaking.fault import Fault
from breaking.rewrite import StaleFault, change_function, owner_of

FOLDER = Path(__file__).parent
TEMPLATES = FOLDER.parents[1] / "epcontact/output"
WORDS = ("value", "call", "argument", "result", "field", "quantity", "areas")


# --- patches: functions of pytest's `monkeypatch`


def is_pattern(path, place):
    """Return whether a row's place is a pattern of code: not a text of a template, nor
    one of WORDS.
    """
    return not path.endswith(".jinja") and place.split()[0] not in WORDS


def patch_of(path, place, becomes):
    """Return the patch of a row, a function of pytest's `monkeypatch`.

    `path`, `place` and `becomes` are texts of the row's columns.
    """
    if is_pattern(path, place):
        return code_patch(path, place, becomes)
    if path.endswith(".jinja"):
        return template_patch(path, place, becomes)
    return behaviour_patch(path, place, becomes)


def code_patch(path, place, becomes):
    """Return the patch that changes the code of a function at a place.

    The code is exchanged inside the function, so that it is changed for all that hold
    the function. The patch raises `StaleFault` if the place does not exist.
    """

    def patch(monkeypatch):
        """Exchange the code of the function until the monkeypatch is undone."""
        function, code = change_function(path, place, becomes)
        monkeypatch.setattr(function, "__code__", code)

    return patch


def template_patch(name, place, becomes):
    """Return the patch that changes a text of a template of epcontact.output.

    All templates are replaced by the changed one; the patch raises `StaleFault` if the
    text is not in it.
    """

    def patch(monkeypatch):
        """Let jinja2 return the changed template until the monkeypatch is undone."""
        text = (TEMPLATES / name).read_text("utf-8")
        if place not in text:
            raise StaleFault(f"{name} does not hold {place}")
        changed = text.replace(place, becomes)

        def get_changed_template(environment, _):
            """Return the changed template, whatever template is asked for."""
            return environment.from_string(changed)

        monkeypatch.setattr("jinja2.Environment.get_template", get_changed_template)

    return patch


def behaviour_patch(path, place, becomes):
    """Return the patch that changes a constant, or an argument or the result of a
    function.

    `place` is one of WORDS with its name, and `becomes` a Python expression.
    """
    expression = compile(becomes, path, "eval")

    def evaluate(**names):
        """Return the value of the expression with names of breaking.mistakes and those
        given.
        """
        return eval(expression, vars(mistakes) | names)

    def patch(monkeypatch):
        """Set the changed constant or function until the monkeypatch is undone."""
        owner, name, original = owner_of(path)
        if place == "value":
            changed = evaluate(value=original)
        else:
            changed = changed_function(original, place, evaluate)
        monkeypatch.setattr(owner, name, changed)

    return patch


def changed_function(original, place, evaluate):
    """Return a function with another argument or result, as a place says.

    `evaluate` is a function that computes the row's expression from its names, given by
    keyword. Raises `StaleFault` if the function has no such argument.
    """
    word, _, name = place.partition(" ")
    signature = inspect.signature(original)
    if word == "argument":
        name = argument_name(signature, name)

    @functools.wraps(original)
    def wrong(*positional, **by_keyword):
        """Call the original function with the mistake in its argument or result."""
        bound = signature.bind(*positional, **by_keyword)
        bound.apply_defaults()
        arguments = tuple(bound.arguments.values())
        if word == "call":
            return evaluate(arguments=arguments)
        if word == "argument":
            argument = bound.arguments[name]
            bound.arguments[name] = evaluate(arguments=arguments, argument=argument)
            return original(*bound.args, **bound.kwargs)
        result = original(*bound.args, **bound.kwargs)
        if word == "result":
            return evaluate(arguments=arguments, result=result)
        value = part_of(result, word, name)
        changed = evaluate(arguments=arguments, value=value)
        return with_part(result, word, name, changed)

    return wrong


def argument_name(signature, name_or_number):
    """Return the name of an argument, which may be given by its number from 1.

    Raises `StaleFault` if the signature has no such argument.
    """
    names = list(signature.parameters)
    if name_or_number in names:
        return name_or_number
    if name_or_number.isdigit() and 0 < int(name_or_number) <= len(names):
        return names[int(name_or_number) - 1]
    raise StaleFault(f"there is no argument {name_or_number} among {', '.join(names)}")


def part_of(result, word, name):
    """Return a field of a ContactResult, or a quantity or the areas of its last load.

    `word` is "field", "quantity" or "areas", and `name` that of the field or quantity.
    """
    if word == "field":
        return result.fields[name]
    if word == "quantity":
        return result.final.quantities[name]
    return result.final.areas


def with_part(result, word, name, value):
    """Return a ContactResult with another value of what `part_of` returns."""
    if word == "field":
        return replace(result, fields={**result.fields, name: value})
    if word == "quantity":
        quantities = {**result.final.quantities, name: value}
        last = replace(result.final, quantities=quantities)
    else:
        last = replace(result.final, areas=value)
    return replace(result, steps=(*result.steps[:-1], last))


# --- reading the table


def read_faults(file):
    """Return the faults of a table, the path of a tab-separated file, as a tuple of
    Fault.

    A row without a first column is a further patch of the fault above it.
    """
    faults = []
    with file.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.reader(lines, "excel-tab", quoting=csv.QUOTE_NONE))
    for what, path, place, becomes, seen_by in rows[1:]:
        patch = patch_of(path, place, becomes)
        if what:
            faults.append(fault_of(what, path, place, patch, seen_by))
        else:
            patches = (*faults[-1].patches, patch)
            faults[-1] = replace(faults[-1], patches=patches)
    return tuple(faults)


def fault_of(what, path, place, patch, seen_by):
    """Return the fault of a row with one patch.

    `seen_by` is a test, or a case, a quantity and fields such as "status=error",
    separated by blanks.
    """
    if seen_by.startswith("tests/"):
        return Fault(what, path, place, (patch,), test=seen_by)
    case, quantity, *fields = seen_by.split()
    more = dict(field.split("=") for field in fields)
    if "surfaces" in more:
        more["surfaces"] = int(more["surfaces"])
    return Fault(what, path, place, (patch,), case=case, quantity=quantity, **more)


FAULTS = read_faults(FOLDER / "table.tsv")
