"""Change a function at the places that a pattern of Python code describes.

A pattern is an expression or a statement.  It matches code of the same structure:

- A capital letter (`A`, `B`, ...) matches any expression.  The same letter matches the
  same expression again, and the replacement may use it.
- `...` as the last positional argument of a call, as the last element of a tuple or
  list, or as a block, matches all further arguments, elements or statements; `**...` in
  a dictionary matches all further items.
- Everything else must be equal: operators, constants, names, attributes, keywords.

So `max(A, ...)` with the replacement `min(A, ...)` holds for every call of max.  Names of
local variables do not belong into a pattern: a letter stands for them, and the fault
survives when they are renamed.  `A / 2 @ 3` is the third such place of the function
in the order of its text; without `@` every place is changed.
"""

import ast
import builtins
import copy
import inspect
import itertools
import pkgutil
import textwrap


class StaleFault(LookupError):
    """The function of a fault, or the place in it, no longer exists."""


def parse_pattern(text):
    """Return the expression or statement of a text as a node of a syntax tree."""
    (statement,) = ast.parse(text).body
    return statement.value if isinstance(statement, ast.Expr) else statement


def is_letter(node):
    """Return whether a node of a pattern is a capital letter."""
    return isinstance(node, ast.Name) and len(node.id) == 1 and node.id.isupper()


def is_rest(node):
    """Return whether a node of a pattern is `...`."""
    node = node.value if isinstance(node, ast.Expr) else node
    return isinstance(node, ast.Constant) and node.value is ...


def _text_of(node):
    """Return a text that is the same for a name that is read and that is assigned."""
    return ast.dump(node).replace("Store()", "Load()")


def matches(pattern, node, found):
    """Return whether a node has the structure of a pattern.

    `found` is filled with what letters, and `...`, stand for.
    """
    if isinstance(pattern, list):
        return isinstance(node, list) and _matches_list(pattern, node, found)
    if not isinstance(pattern, ast.AST):
        return pattern == node
    if is_letter(pattern) and isinstance(node, ast.expr):
        known = found.setdefault(pattern.id, node)
        return _text_of(known) == _text_of(node)
    return type(pattern) is type(node) and _matches_fields(pattern, node, found)


def _matches_fields(pattern, node, found):
    if isinstance(pattern, ast.Call) and any(map(is_rest, pattern.args)):
        return _matches_call(pattern, node, found)
    if isinstance(pattern, ast.Dict) and any(map(is_rest, pattern.values)):
        return _matches_dict(pattern, node, found)
    return all(
        matches(value, getattr(node, name), found)
        for name, value in ast.iter_fields(pattern)
        if name not in ("ctx", "kind", "type_comment")
    )


def _matches_list(pattern, nodes, found):
    if pattern and is_rest(pattern[-1]):
        first = len(pattern) - 1
        found["..."] = nodes[first:]
        pattern, nodes = pattern[:first], nodes[:first]
    return len(pattern) == len(nodes) and all(
        matches(one, node, found) for one, node in zip(pattern, nodes, strict=True)
    )


def _matches_call(pattern, call, found):
    """Match a call with `...`: keywords may stand in any order."""
    given = {keyword.arg: keyword for keyword in call.keywords}
    names = [keyword.arg for keyword in pattern.keywords]
    if not given.keys() >= set(names):
        return False
    found["keywords"] = [given[name] for name in given if name not in names]
    return (
        matches(pattern.func, call.func, found)
        and matches(pattern.args, call.args, found)
        and matches(pattern.keywords, [given[name] for name in names], found)
    )


def _matches_dict(pattern, node, found):
    """Match a dictionary with `**...`: the items of the pattern may stand anywhere."""
    rest = dict(enumerate(zip(node.keys, node.values, strict=True)))
    for key, value in zip(pattern.keys, pattern.values, strict=True):
        if is_rest(value):
            continue
        place = next(
            (i for i, (k, _) in rest.items() if k and matches(key, k, {})), None
        )
        if place is None or not matches(value, rest.pop(place)[1], found):
            return False
    found["items"] = list(rest.values())
    return True


class _Filler(ast.NodeTransformer):
    """Put into a replacement what letters and `...` stand for."""

    def __init__(self, found):
        self.found = found

    def visit_Name(self, node):
        if not is_letter(node):
            return node
        value = copy.deepcopy(self.found[node.id])
        if hasattr(value, "ctx"):
            value.ctx = node.ctx
        return value

    def visit_Constant(self, node):
        return self.found["..."] if is_rest(node) else node

    def visit_Expr(self, node):
        return self.found["..."] if is_rest(node) else self.generic_visit(node)

    def visit_Dict(self, node):
        kept = [not is_rest(value) for value in node.values]
        rest = [] if all(kept) else self.found["items"]
        node.keys = [*itertools.compress(node.keys, kept), *(key for key, _ in rest)]
        values = [self.visit(value) for value in itertools.compress(node.values, kept)]
        node.values = [*values, *(value for _, value in rest)]
        return node

    def visit_Call(self, node):
        has_rest = any(map(is_rest, node.args))
        self.generic_visit(node)
        if has_rest:
            node.keywords += self.found["keywords"]
        return node


class _Changer(ast.NodeTransformer):
    """Replace the places of a pattern: all, or the one with a number (from 1)."""

    def __init__(self, pattern, replacement, number):
        self.pattern = pattern
        self.replacement = replacement
        self.number = number
        self.places = 0

    def visit(self, node):
        found = {}
        if matches(self.pattern, node, found):
            self.places += 1
            if self.number in (0, self.places):
                return _Filler(found).visit(copy.deepcopy(self.replacement))
        return self.generic_visit(node)


def change_code(tree, place, replacement):
    """Return a syntax tree with the code of a place replaced.

    Raises `StaleFault` if no code matches the place.
    """
    text, _, ordinal = place.partition(" @ ")
    pattern, replaced, number = (
        parse_pattern(text),
        parse_pattern(replacement),
        int(ordinal or 0),
    )
    if isinstance(replaced, ast.stmt) and isinstance(pattern, ast.expr):
        pattern = ast.Expr(pattern)
    changer = _Changer(pattern, replaced, number)
    changed = changer.visit(tree)
    if changer.places < max(number, 1):
        raise StaleFault(f"{changer.places} places match: {place}")
    return changed


def has_place(tree, place):
    """Return whether a syntax tree has the code that a place describes."""
    pattern = parse_pattern(place.partition(" @ ")[0])
    return any(matches(pattern, node, {}) for node in ast.walk(tree))


def function_of(path):
    """Return the plain function behind a dotted path: without decorators.

    Raises `StaleFault` if the path does not exist.
    """
    try:
        function = pkgutil.resolve_name(path)
    except (ImportError, AttributeError):
        raise StaleFault(f"{path} does not exist") from None
    function = getattr(function, "callback", function)  # of a command
    function = getattr(function, "fget", function)  # of a property
    return inspect.unwrap(getattr(function, "__func__", function))


def tree_of(function):
    """Return the syntax tree of a function, without its decorators."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    tree.decorator_list = []
    return tree


def change_function(path, place, replacement):
    """Return a function, and the code that it has after a change of one place.

    Raises `StaleFault` if the function or the place does not exist, or if the
    replacement uses a name that the function does not know.
    """
    function = function_of(path)
    try:
        tree = change_code(tree_of(function), place, replacement)
    except StaleFault as error:
        raise StaleFault(f"{path}: {error}") from None
    module = ast.parse("from __future__ import annotations")
    module.body.append(tree)
    code = compile(ast.fix_missing_locations(module), f"<{path}>", "exec")
    known = {node.id for node in ast.walk(tree) if _is_assigned(node)}
    known |= {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    known |= function.__globals__.keys() | vars(builtins).keys()
    for node in ast.walk(parse_pattern(replacement)):
        if isinstance(node, ast.Name) and not is_letter(node) and node.id not in known:
            raise StaleFault(f"{path} does not know the name {node.id}")
    names = {}
    exec(code, function.__globals__, names)
    return function, names[tree.name].__code__


def _is_assigned(node):
    return isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
