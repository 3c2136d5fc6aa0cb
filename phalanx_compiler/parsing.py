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
    ast.ListComp: "write a loop that fills an array",
    ast.SetComp: "write a loop that fills an array",
    ast.DictComp: "write a loop that fills an array",
    ast.GeneratorExp: "write a loop",
    ast.List: "use an array, or a tuple",
    ast.Dict: "use an array, or a NamedTuple",
    ast.Set: "use an array, or a tuple",
    ast.Lambda: "write a kernel of its own",
    ast.FunctionDef: "write a kernel of its own, at the top of the module",
    ast.AsyncFunctionDef: "write a kernel of its own, at the top of the module",
    ast.AsyncFor: "use a plain for",
    ast.AsyncWith: "remove it: kernels have no contexts",
    ast.ClassDef: "declare a NamedTuple at the top of the module",
    ast.Try: "write a test before the operation",
    ast.With: "remove it: kernels have no contexts",
    ast.Raise: "return a number that says what is wrong",
    ast.Assert: "write a test, and return a number that says what is wrong",
    ast.JoinedStr: "remove it: kernels have no text",
    ast.NamedExpr: "write the assignment on a line of its own",
    ast.Global: "pass it as an argument",
    ast.Nonlocal: "pass it as an argument",
    ast.Delete: "remove it: memory is released at the end of the call",
    ast.Import: "write the import at the top of the module",
    ast.ImportFrom: "write the import at the top of the module",
    ast.Await: "remove it: kernels do not wait",
    ast.Yield: "return an array that is filled",
    ast.YieldFrom: "return an array that is filled",
    ast.TryStar: "write a test before the operation",
    ast.Match: "write if and elif",
    ast.Is: "write ==",
    ast.IsNot: "write !=",
    ast.MatMult: "write loops over the rows and columns",
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

    def refuse_signature(self, error: TypeError) -> SubsetError:
        """Return the error for a kernel whose signature has no types."""
        head = f"def {self.tree.name}({ast.unparse(self.tree.args)})"
        instead = "annotate it with int, float, bool, or a type of phalanx/arrays.py"
        return SubsetError(self.file, self.tree.lineno, f"{error}: {head}", instead)

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
        raise SubsetError(
            shown_path(code.co_filename), code.co_firstlineno, what, "write a function with def at the top of a module"
        )
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
        raise source.refuse(arguments, "a function inside another one", "write the kernel at the top of the module")
    if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.posonlyargs:
        raise source.refuse(source.tree.args, "parameters of another form", "use parameters with names, and defaults")
    for statement in source.tree.body:
        for node in ast.walk(statement):
            for each in (type(node), *_operators(node)):
                if each in INSTEAD:
                    raise source.refuse(node, f"{each.__name__} is not in the subset", INSTEAD[each])
            if isinstance(node, (ast.For, ast.While)) and node.orelse:
                raise source.refuse(node, "else after a loop", "use a variable that says how the loop ended")
