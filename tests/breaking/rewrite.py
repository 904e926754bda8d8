"""Change a function at the places that a pattern of Python code describes.

A pattern is an expression or a statement.  It matches code of the same structure:

- A capital letter (`A`, `B`, ...) matches any expression.  The same letter matches the
  same expression again, and the replacement may use it.
- `...` as the last positional argument of a call, as the last element of a tuple or
  list, or as a block, matches all further arguments, elements or statements; `**...` in
  a dictionary matches all further items.
- Everything else must be equal: operators, constants, names, attributes, keywords.

For example, `max(A, ...)` becomes `min(A, ...)`: every call of max is changed.  A
pattern should not name local variables.  A letter stands for them, so that the fault
survives when they are renamed.  `A / 2 @ 3` is the third such place of the function, in
the order of its text; without `@` every place is changed.
"""

import ast
import builtins
import copy
import inspect
import pkgutil
import textwrap


class StaleFault(LookupError):
    """The function of a fault, or the place in it, no longer exists."""


def parse_pattern(text):
    """Return the expression or statement of a Python text as a node of a syntax tree
    (ast).

    Raises SyntaxError if the text is not Python, and ValueError if it has several
    statements.
    """
    (statement,) = ast.parse(text).body
    if isinstance(statement, ast.Expr):
        return statement.value
    return statement


def parse_place(place):
    """Return the pattern of a place as a node of a syntax tree, and its number from 1.

    The number is 0 for every place; a text such as "A / 2 @ 3" means the third.
    """
    text, _, number = place.partition(" @ ")
    return parse_pattern(text), int(number or 0)


def is_letter(node):
    """Return whether a node of a pattern is a capital letter."""
    return isinstance(node, ast.Name) and len(node.id) == 1 and node.id.isupper()


def is_rest(node):
    """Return whether a node of a pattern is `...`, or a statement of it."""
    if isinstance(node, ast.Expr):
        node = node.value
    return isinstance(node, ast.Constant) and node.value is ...


def ends_with_rest(nodes):
    """Return whether the last node of a list is `...`; False for an empty list."""
    return bool(nodes) and is_rest(nodes[-1])


def text_of(node):
    """Return a text of a node that is the same for a name that is read and that is
    assigned.
    """
    return ast.dump(node).replace("Store()", "Load()")


# --- matching
#
# `found` is a dictionary.  It is filled with what the letters stand for, and with the
# nodes of `...` as "rest", the further keywords of a call as "keywords", and the items
# of `**...` as "items".


def matches(pattern, node, found):
    """Return whether a node of a syntax tree has the structure of a pattern.

    Both are nodes, lists of nodes or their plain values. `found` is a dictionary that
    is filled in place with the node of each capital letter, and with what `...` stands
    for.
    """
    if isinstance(pattern, list):
        return isinstance(node, list) and _matches_list(pattern, node, found)
    if not isinstance(pattern, ast.AST):
        return pattern == node
    if is_letter(pattern) and isinstance(node, ast.expr):
        expected = found.setdefault(pattern.id, node)
        return text_of(expected) == text_of(node)
    return type(pattern) is type(node) and _matches_fields(pattern, node, found)


def _matches_fields(pattern, node, found):
    """Return whether two nodes of one type have equal fields, and fill `found` in
    place.

    Calls and dictionaries whose pattern ends with `...` are compared more loosely.
    """
    if isinstance(pattern, ast.Call) and ends_with_rest(pattern.args):
        return _matches_call(pattern, node, found)
    if isinstance(pattern, ast.Dict) and ends_with_rest(pattern.values):
        return _matches_dict(pattern, node, found)
    return all(
        matches(value, getattr(node, name), found)
        for name, value in ast.iter_fields(pattern)
        if name not in ("ctx", "kind", "type_comment")
    )


def _matches_list(pattern, nodes, found):
    """Return whether two lists of nodes match one by one, and fill `found` in place.

    If the pattern ends with `...`, all further nodes become found["rest"].
    """
    if ends_with_rest(pattern):
        pattern = pattern[:-1]
        found["rest"] = nodes[len(pattern) :]
        nodes = nodes[: len(pattern)]
    if len(pattern) != len(nodes):
        return False
    return all(matches(*pair, found) for pair in zip(pattern, nodes, strict=True))


def _matches_call(pattern, call, found):
    """Return whether a call matches a pattern that ends with `...`, and fill `found` in
    place.

    Keywords may stand in any order; further ones become found["keywords"].
    """
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
    """Return whether a dictionary matches a pattern that ends with `**...`, and fill
    `found` in place.

    The items of the pattern may stand anywhere; all others, as pairs of nodes, become
    found["items"].
    """
    items = [item for item in zip(node.keys, node.values, strict=True) if item[0]]
    unpacked = [
        item for item in zip(node.keys, node.values, strict=True) if not item[0]
    ]
    for key, value in zip(pattern.keys[:-1], pattern.values[:-1], strict=True):
        same = [item for item in items if text_of(item[0]) == text_of(key)]
        if not same or not matches(value, same[0][1], found):
            return False
        items.remove(same[0])
    found["items"] = items + unpacked
    return True


# --- changing


class _Filler(ast.NodeTransformer):
    """Put into a replacement, a syntax tree, what letters and `...` stand for."""

    def __init__(self, found):
        """Take the dictionary that `matches` has filled."""
        self.found = found

    def visit_Name(self, node):
        """Return the node of a capital letter instead of the letter, or other names as
        they are.
        """
        if not is_letter(node):
            return node
        value = copy.deepcopy(self.found[node.id])
        if hasattr(value, "ctx"):
            value.ctx = node.ctx
        return value

    def visit_Constant(self, node):
        """Return the nodes of `...`, or other constants as they are."""
        if is_rest(node):
            return self.found["rest"]
        return node

    def visit_Expr(self, node):
        """Return the statements of `...`, or another expression with its letters
        replaced.
        """
        if is_rest(node):
            return self.found["rest"]
        return self.generic_visit(node)

    def visit_Dict(self, node):
        """Return a dictionary with its letters replaced and the items of `**...`
        appended.
        """
        has_rest = ends_with_rest(node.values)
        if has_rest:
            node.keys.pop()
            node.values.pop()
        self.generic_visit(node)
        if has_rest:
            node.keys += [key for key, _ in self.found["items"]]
            node.values += [value for _, value in self.found["items"]]
        return node

    def visit_Call(self, node):
        """Return a call with its letters replaced and the further keywords of `...`
        appended.
        """
        has_rest = ends_with_rest(node.args)
        self.generic_visit(node)
        if has_rest:
            node.keywords += self.found["keywords"]
        return node


class _Changer(ast.NodeTransformer):
    """Replace the places of a pattern: all, or the one with a number from 1.

    `places` counts the places that match.
    """

    def __init__(self, pattern, replacement, number):
        """Take pattern and replacement as nodes, and the number of the place, 0 for
        all.
        """
        self.pattern = pattern
        self.replacement = replacement
        self.number = number
        self.places = 0

    def visit(self, node):
        """Return the replacement if a node is a place to change, else the node with its
        children visited.
        """
        found = {}
        if matches(self.pattern, node, found):
            self.places += 1
            if self.number in (0, self.places):
                return _Filler(found).visit(copy.deepcopy(self.replacement))
        return self.generic_visit(node)


def change_code(tree, place, becomes):
    """Return a syntax tree with the code of a place replaced.

    `place` and `becomes` are texts of a row of the table. Raises `StaleFault` if no
    code matches the place, or fewer places than its number.
    """
    pattern, number = parse_place(place)
    replacement = parse_pattern(becomes)
    if isinstance(replacement, ast.stmt) and isinstance(pattern, ast.expr):
        pattern = ast.Expr(pattern)
    changer = _Changer(pattern, replacement, number)
    changed = changer.visit(tree)
    if changer.places < max(number, 1):
        raise StaleFault(f"{changer.places} places match: {place}")
    return changed


def has_place(tree, place):
    """Return whether a syntax tree has the code that a place, a text of the table,
    describes.
    """
    pattern, _ = parse_place(place)
    return any(matches(pattern, node, {}) for node in ast.walk(tree))


def owner_of(path):
    """Return the module or class of a dotted path, a name in it, and its value.

    Raises `StaleFault` if the path does not exist.
    """
    owner_path, _, name = path.rpartition(".")
    try:
        owner = pkgutil.resolve_name(owner_path)
        return owner, name, getattr(owner, name)
    except (ImportError, AttributeError):
        raise StaleFault(f"{path} does not exist") from None


def function_of(path):
    """Return the plain function behind a dotted path: of a command, property or method,
    and without decorators.

    Raises `StaleFault` if the path does not exist.
    """
    _, _, function = owner_of(path)
    function = getattr(function, "callback", function)  # of a command
    function = getattr(function, "fget", function)  # of a property
    return inspect.unwrap(getattr(function, "__func__", function))


def tree_of(function):
    """Return the syntax tree of a function, without its decorators."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    tree.decorator_list = []
    return tree


def change_function(path, place, becomes):
    """Return a function, and the code object that it has after a change of one place.

    `path`, `place` and `becomes` are texts of a row of the table. Raises `StaleFault`
    if the function or the place does not exist, or if the replacement uses a name that
    the function does not know.
    """
    function = function_of(path)
    try:
        tree = change_code(tree_of(function), place, becomes)
    except StaleFault as error:
        raise StaleFault(f"{path}: {error}") from None
    unknown = names_in(parse_pattern(becomes)) - names_known_to(function, tree)
    if unknown:
        raise StaleFault(f"{path} does not know the name {', '.join(unknown)}")
    module = ast.parse("from __future__ import annotations")
    module.body.append(tree)
    code = compile(ast.fix_missing_locations(module), f"<{path}>", "exec")
    names = {}
    exec(code, function.__globals__, names)
    return function, names[tree.name].__code__


def names_in(replacement):
    """Return the names in a replacement, a node, that are no letters, as a set."""
    nodes = [node for node in ast.walk(replacement) if isinstance(node, ast.Name)]
    return {node.id for node in nodes if not is_letter(node)}


def names_known_to(function, tree):
    """Return the set of global and local names that the code of a function can use.

    `tree` is the syntax tree of the function.
    """
    names = function.__globals__.keys() | vars(builtins).keys()
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.alias):
            names.add(node.asname or node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names
