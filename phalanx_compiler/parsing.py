"""Find the source of a kernel and parse it; refuse syntax that no kernel may use."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from .errors import SubsetError, shown

INSTEAD: dict[type[ast.AST], str] = {
    ast.ListComp: "a loop that fills an array",
    ast.SetComp: "a loop that fills an array",
    ast.DictComp: "a loop that fills an array",
    ast.GeneratorExp: "a loop",
    ast.List: "an array, or a tuple",
    ast.Dict: "an array, or a NamedTuple",
    ast.Set: "an array",
    ast.Lambda: "a kernel of its own",
    ast.FunctionDef: "a kernel of its own, at the top of the module",
    ast.AsyncFunctionDef: "a kernel of its own, at the top of the module",
    ast.AsyncFor: "for",
    ast.AsyncWith: "nothing: kernels have no contexts",
    ast.ClassDef: "a NamedTuple at the top of the module",
    ast.Try: "a test before the operation",
    ast.With: "nothing: kernels have no contexts",
    ast.Raise: "return a number that says what is wrong",
    ast.Assert: "a test, and a number that says what is wrong",
    ast.JoinedStr: "nothing: kernels have no text",
    ast.NamedExpr: "an assignment on a line of its own",
    ast.Global: "an argument",
    ast.Nonlocal: "an argument",
    ast.Delete: "nothing: memory is released at the end of the call",
    ast.Import: "an import at the top of the module",
    ast.ImportFrom: "an import at the top of the module",
    ast.Await: "nothing: kernels do not wait",
    ast.Yield: "an array that is filled",
    ast.YieldFrom: "an array that is filled",
    ast.TryStar: "a test before the operation",
    ast.Match: "if and elif",
    ast.Is: "==",
    ast.IsNot: "!=",
    ast.MatMult: "loops over the rows and columns",
}


@dataclass(frozen=True, slots=True)
class Source:
    """A kernel as text: its file, its syntax tree, and the objects that its global names mean."""

    file: str
    tree: ast.FunctionDef
    names: dict[str, Any]
    function: Callable[..., Any]

    @property
    def name(self) -> str:
        """Return the kernel's name with its module's, as messages show it."""
        return f"{self.function.__module__}.{self.function.__name__}"

    def refuse(self, node: ast.AST, what: str, instead: str) -> SubsetError:
        """Return the error for an expression or statement outside the subset."""
        return SubsetError(self.file, getattr(node, "lineno", self.tree.lineno), f"{what}: {shown(node)}", instead)


def uncompiled(value: Any) -> Any:
    """Return a kernel's function, and any other value as it is."""
    return getattr(value, "py_func", value)


@cache
def _module(file: str) -> dict[int, ast.FunctionDef]:
    tree = ast.parse(Path(file).read_bytes())
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return {min([node.lineno, *(each.lineno for each in node.decorator_list)]): node for node in functions}


def forget_files() -> None:
    """Read files again, which may have changed."""
    _module.cache_clear()


def source_of(function: Callable[..., Any]) -> Source:
    """Return the parsed source of a kernel. Raises: SubsetError: it uses syntax outside the subset."""
    code = function.__code__
    body = getattr(function, "__kernel_body__", None)
    if body is not None:
        head = f"def {function.__name__}({', '.join(inspect.signature(function).parameters)}):"
        text = "\n    ".join([head, *body])
        tree: ast.stmt | None = ast.parse(text).body[0]
        ast.increment_lineno(tree, function.__kernel_line__ - 1)  # type: ignore[type-var,attr-defined]
    else:
        tree = _module(code.co_filename).get(code.co_firstlineno)
    if not isinstance(tree, ast.FunctionDef):
        what = f"{function.__name__} is not written with def"
        raise SubsetError(shown_path(code.co_filename), code.co_firstlineno, what, "a function at the top of a module")
    source = Source(shown_path(code.co_filename), tree, function.__globals__, function)
    _check(source)
    return source


def shown_path(file: str) -> str:
    """Return how messages name a file: from the working folder if it is in there."""
    path = Path(file)
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else file


def _operators(node: ast.AST) -> list[type[ast.AST]]:
    if isinstance(node, ast.Compare):
        return [type(op) for op in node.ops]
    return [type(node.op)] if isinstance(node, (ast.BinOp, ast.AugAssign)) else []


def _check(source: Source) -> None:
    arguments = source.tree.args
    if source.function.__code__.co_freevars:
        raise source.refuse(arguments, "a function inside another one", "a kernel at the top of the module")
    if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.posonlyargs:
        raise source.refuse(source.tree.args, "parameters of another form", "parameters with names, and defaults")
    for statement in source.tree.body:
        for node in ast.walk(statement):
            for each in (type(node), *_operators(node)):
                if each in INSTEAD:
                    raise source.refuse(node, f"{each.__name__} is not in the subset", INSTEAD[each])
            if isinstance(node, (ast.For, ast.While)) and node.orelse:
                raise source.refuse(node, "else after a loop", "a variable that says how the loop ended")
