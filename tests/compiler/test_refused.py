"""What is outside the subset is refused where it stands, with what to write instead."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from harness import c_of, kernels_of, load
from phalanx_compiler.errors import SubsetError
from phalanx_compiler.parsing import INSTEAD

ROOT = Path(__file__).parents[2]
VERBS = set(
    "annotate assign call compare declare give keep loop make mark match multiply pass remove return shift store take "
    "test use write".split()
)
HEAD = """
import math
from typing import Annotated, Any, NamedTuple
import numpy as np
from phalanx.arrays import BOOLx1, F32x1, F64x1, F64x2, I64x1, I64x2, Records, U8x1, U64x1
from phalanx.bundle import bundled
from phalanx.kernel import kernel
from phalanx.wire.fields import put_u16

TABLE = np.zeros(3)
TABLES = (TABLE, 1)
MIXED = (1, 2.5)
LANE = np.uint64(5)
WORDS = {"a": 1}
NAMES = np.array(["a"])
POINT = np.array(1.0)
SWAPPED = np.zeros(3, ">i8")

class Point(NamedTuple):
    x: float
    y: float

class Other(NamedTuple):
    x: float
    y: float

class Named(NamedTuple):
    name: str

class Queue(NamedTuple):
    row: I64x1
    most: int

pack = bundled(Queue)
ROW = np.dtype([("count", "i8"), ("name", "S8"), ("part", "f8", 3)], align=True)

def plain(x: int) -> int:
    return x

@kernel
def helper(x: int, y: float = 0.5) -> int:
    return x

@kernel
def half(x: int, y: int = 0.5) -> int:
    return x

@kernel
def none(x: int) -> None:
    pass

CALLED = (none,)

@kernel
def point(p: Point) -> float:
    return p.x

@kernel
def writer(a: F64x1) -> None:
    a[0] = 1.0

@kernel
def passes(a: F64x1) -> F64x1:
    return a[1:]

@kernel
def constant() -> F64x1:
    return TABLE

"""
# A function's parameters and result; its lines, of which one is marked with >>; what is wrong, and what to write.
# fmt: off
CASES = {
    "a call of an item": ("x: int -> int", ">> return CALLED[0](x)", "a call of an item", "call the function by its name"),
    "a list": ("x: int -> int", ">> y = [x]\nreturn 0", "List is not in the subset: [x]", "an array, or a tuple"),
    "a list of targets": ("x: int -> int", ">> [y] = (x,)\nreturn 0", "List is not in the subset: [y]", "an array, or a tuple"),
    "a comprehension": ("x: int -> int", ">> return sum([k for k in range(x)])", "ListComp is not", "a loop that fills an array"),
    "a set comprehension": ("x: int -> int", ">> y = {k for k in (1, 2)}\nreturn 0", "SetComp is not", "a loop"),
    "a dict comprehension": ("x: int -> int", ">> y = {k: 1 for k in (1, 2)}\nreturn 0", "DictComp is not", "a loop"),
    "a generator": ("x: int -> int", ">> return sum(k for k in range(x))", "GeneratorExp is not", "a loop"),
    "a dict": ("x: int -> int", ">> y = {1: x}\nreturn 0", "Dict is not", "an array, or a NamedTuple"),
    "a set": ("x: int -> bool", ">> return x in {1, 2}", "Set is not in the subset: {1, 2}", "an array"),
    "a lambda": ("x: int -> int", ">> y = lambda: 1\nreturn 0", "Lambda is not", "a kernel of its own"),
    "an inner function": ("x: int -> int", ">> def f(): pass\nreturn 0", "FunctionDef is not", "at the top of the module"),
    "an inner coroutine": ("x: int -> int", ">> async def f(): pass\nreturn 0", "AsyncFunctionDef is not", "at the top"),
    "a class": ("x: int -> int", ">> class A: pass\nreturn 0", "ClassDef is not", "a NamedTuple at the top of the module"),
    "try": ("x: int -> int", ">> try:\n    x = 1\nfinally:\n    pass\nreturn 0", "Try is not", "a test before the operation"),
    "try star": ("x: int -> int", ">> try:\n    x = 1\nexcept* ValueError:\n    pass\nreturn 0", "TryStar is not", "a test before"),
    "with": ("x: int -> int", ">> with x:\n    pass\nreturn 0", "With is not", "no contexts"),
    "raise": ("x: int -> int", "if x:\n    return 1\n>> raise ValueError", "Raise is not", "return a number that says"),
    "assert": ("x: int -> int", ">> assert x > 0\nreturn 0", "Assert is not in the subset: assert x > 0", "write a test, and return a number"),
    "an f-string": ("x: int -> int", '>> y = f"{x}"\nreturn 0', "JoinedStr is not", "no text"),
    "a walrus": ("x: int -> int", ">> return (y := x) + y", "NamedExpr is not", "on a line of its own"),
    "global": ("x: int -> int", ">> global TABLE\nreturn 0", "Global is not", "an argument"),
    "del": ("x: int -> int", ">> del x\nreturn 0", "Delete is not", "released at the end of the call"),
    "import": ("x: int -> int", ">> import math\nreturn 0", "Import is not", "at the top of the module"),
    "import from": ("x: int -> int", ">> from math import pi\nreturn 0", "ImportFrom is not", "at the top of the module"),
    "yield": ("x: int -> int", ">> y = yield x\nreturn 0", "Yield is not", "an array that is filled"),
    "yield from": ("x: int -> int", ">> y = yield from x\nreturn 0", "YieldFrom is not", "an array that is filled"),
    "match": ("x: int -> int", ">> match x:\n    case 1:\n        return 1\nreturn 0", "Match is not", "if and elif"),
    "is": ("x: int -> bool", ">> return x is None", "Is is not in the subset: x is None", "=="),
    "is not": ("x: int -> bool", ">> return x is not None", "IsNot is not in the subset: x is not None", "!="),
    "a matrix product": ("a: F64x2 -> F64x2", ">> return a @ a", "MatMult is not in the subset: a @ a", "loops over"),
    "an else after for": ("x: int -> int", ">> for k in range(x):\n    x = k\nelse:\n    x = 2\nreturn x", "else after a loop", "a variable that says"),
    "an else after while": ("x: int -> int", ">> while x:\n    x = 0\nelse:\n    x = 2\nreturn x", "else after a loop", "a variable that says"),
    "text": ("x: int -> int", '>> y = "a"\nreturn x', "a str is no value: 'a'", "use numbers, arrays, tuples"),
    "an unknown name": ("x: int -> int", ">> return nobody + x", "an unknown name: nobody", "a parameter, a variable"),
    "a function as a value": ("x: int -> int", ">> y = helper\nreturn x", "a function is no value: helper", "use numbers, arrays"),
    "a dict of the module": ("x: int -> int", '>> return WORDS["a"]', "a dict is no value: WORDS", "use numbers, arrays"),
    "a number beyond 64 bits": ("x: int -> int", ">> return x + 2**63", "a number beyond 64 bits: 2 ** 63", "np.uint64()"),
    "a constant by zero": ("x: int -> int", ">> return x + 1 // 0", "cannot be computed", "another constant"),
    "a constant that overflows": ("x: int -> float", ">> return 10.0**400", "cannot be computed", "another constant"),
    "a long shift of constants": ("x: int -> int", ">> return (1 << 5000) >> 4999", "cannot be computed: 1 << 5000", "fits 64 bits"),
    "a complex constant": ("x: int -> float", ">> return (-2.0) ** 0.5", "a complex number", "use numbers, arrays"),
    "bits of a float constant": ("x: int -> int", ">> return 1.5 & 1", "cannot be computed", "another constant"),
    "an item that a constant lacks": ("x: int -> float", ">> return MIXED[2]", "no item 2 of 2: MIXED[2]", "inside the tuple"),
    "an array of text": ("x: int -> int", ">> return len(NAMES)", "<U1 is not an element type", "an array of numbers"),
    "an array without axes": ("x: int -> float", ">> return len(POINT)", "an array with 0 axes", "an array of numbers"),
    "an array in another byte order": ("x: int -> int", ">> return SWAPPED[x]", ">i8 is not an element type", "an array of numbers"),
    "a float for an int": ("x: int -> int", ">> return helper(x * 0.5)", "a float where an int belongs: helper(x * 0.5)", "x of helper; int() and float()"),
    "a float returned": ("x: float -> int", ">> return x", "a float where an int belongs", "match the annotation of the result"),
    "an int returned as bool": ("x: int -> bool", ">> return x", "an int where a bool belongs", "match the annotation of the result"),
    "nothing returned": ("x: int -> int", ">> return", "None where an int belongs", "match the annotation of the result"),
    "something returned for None": ("x: int -> None", ">> return x", "an int where None belongs", "match the annotation of the result"),
    "a parameter that changes its type": ("x: int -> float", ">> x = x * 0.5\nreturn x", "x is an int and becomes a float", "another variable"),
    "a variable of two types": ("x: int, a: F64x1 -> int", "y = x\n>> y = a\nreturn 0", "y is an int and becomes an array of float64", "another variable"),
    "a variable that is None": ("x: int -> int", ">> y = none(x)\nreturn 0", "a variable that is None: y = none(x)", "a number that says so"),
    "a variable before its value": ("x: int -> int", ">> return y\ny = x", "a variable that has no value yet: y", "an assignment before it"),
    "an augmented variable before": ("x: int -> int", ">> y += 1\nreturn y", "a variable that has no value yet", "an assignment before it"),
    "a variable of one way": ("x: int -> int", "if x:\n    y = 1\n>> return y", "y may have no value: return y", "assign it a value on each way"),
    "a variable of a loop": ("x: int -> int", "for k in range(x):\n    y = k\n>> return k", "k may have no value: return k", "each way"),
    "a variable after continue": ("x: int -> int", "for k in range(3):\n    if x:\n        continue\n    y = k\n>> return y", "y may have", "each way"),
    "a variable after break": ("x: int -> int", "while True:\n    if x:\n        break\n    y = 1\n    break\n>> return y + 1", "y may have", "each way"),
    "a variable in a condition": ("x: int -> int", "while x > 0:\n    y = 1\n    x -= 1\n>> if y > 0:\n    return 1\nreturn 0", "y may have no value: y", "each way"),
    "a variable without a value": ("x: int -> int", ">> y: int\nreturn x", "a variable without a value: y: int", "assign a value"),
    "too few values": ("x: int -> int", ">> y, z = (x,)\nreturn 0", "for 2 names", "a tuple of that length"),
    "no tuple": ("x: int -> int", ">> y, z = x\nreturn 0", "an int for 2 names", "a tuple of that length"),
    "a starred target": ("x: int -> int", ">> y, *z = (x, 1)\nreturn 0", "Starred is not in the subset", "phalanx docs reference/kernels"),
    "a star before an array": ("a: F64x1 -> float", ">> return max(*a)", "* before an array of float64", "* before a tuple"),
    "an item of a tuple": ("x: int -> int", "t = (x, 1)\n>> t[0] = 2\nreturn 0", "an assignment to a part of a tuple", "make a new tuple, or use an array"),
    "a field of a NamedTuple": ("p: Point -> None", ">> p.x = 2.0", "an assignment to a part of a tuple", "make a new tuple, or use an array"),
    "a field of a bundle": ("q: Queue -> None", ">> q.most = 2", "an assignment to a part of a Queue", "an element, or a record's field"),
    "an array of a bundle": ("q: Queue -> None", ">> q.row = q.row[1:]", "an assignment to a part of a Queue", "an element"),
    "a size": ("a: F64x1 -> None", ">> a.size = 2", "an assignment to a part of an array", "an element"),
    "a float into an array of ints": ("a: I64x1 -> None", ">> a[0] = 0.5", "a float where an int belongs: a[0] = 0.5", "a number of the array's type"),
    "an augmented array of ints": ("a: I64x1 -> None", ">> a[0] += 0.5", "a float where an int belongs", "a number of the array's type"),
    "a row of another type": ("a: I64x2, b: F64x1 -> None", ">> a[0] = b", "array of float64 with 1 axis where an int", "an array like it"),
    "an int into an array of uint64": ("a: U64x1, x: int -> None", ">> a[0] = x", "an int where an np.uint64 belongs", "a number of the array's type"),
    "a negative number into uint64": ("a: U64x1 -> None", ">> a[0] = -1", "an int where an np.uint64 belongs", "a number of the array's type"),
    "a constant that is changed": ("x: int -> None", ">> TABLE[x] = 1.0", "a constant of the module is changed: TABLE[x]", "write to a copy of it, or to an argument"),
    "a constant by another name": ("x: int -> None", "t = TABLE if x else np.zeros(3)\n>> t[0] = 1.0", "a constant of the module is changed: t[0]", "a copy of it"),
    "a constant in a tuple": ("x: int -> None", "t, _ = TABLES\n>> t[1:][0] += 1.0", "a constant of the module is changed", "a copy of it"),
    "a constant that a kernel changes": ("x: int -> None", ">> writer(passes(TABLE))", "a constant of the module is changed: writer(passes(TABLE))", "a copy"),
    "a constant that a kernel returns": ("x: int -> None", "t = passes(constant())\n>> t[0] = 1.0", "a constant of the module is changed: t[0]", "a copy"),
    "no field": ("p: Point -> float", ">> return p.z", "has no z: p.z", "a field of a bundle, record or NamedTuple"),
    "no attribute of an array": ("a: F64x1 -> F64x1", ">> return a.T", "has no T: a.T", "a field"),
    "a field of text": ("r: Annotated[Any, Records(ROW)] -> int", ">> x = r[0].name\nreturn 0", "|S8 is not an element type", "use fields that are numbers or arrays of them"),
    "an unaligned record": ("r: Annotated[Any, Records(np.dtype([('a', 'u1'), ('b', 'f8')]))] -> int", "return 0", "whose field b is not aligned; np.dtype(…, align=True)", "phalanx/arrays.py"),
    "a variable index of mixed types": ("x: int -> float", ">> return MIXED[x]", "a variable index into a tuple[int, float]", "use a constant as the index, or a tuple of one type"),
    "an item that is not there": ("x: int -> int", "t = (x, 1)\n>> return t[2]", "no item of a tuple[int, int]: t[2]", "inside the tuple"),
    "a slice of a tuple": ("x: int -> int", "t = (x, 1)\n>> y = t[:1]\nreturn 0", "no item of a tuple[int, int]: t[:1]", "inside the tuple"),
    "an index into a number": ("x: int -> int", ">> return x[0]", "an index into an int", "an index into an array"),
    "too many indices": ("a: I64x1 -> int", ">> return a[0, 1]", "2 indices into an array", "an index for each axis"),
    "a slice in steps": ("a: I64x1 -> int", ">> return len(a[::2])", "a slice that leaves gaps: a[::2]", "a loop"),
    "a column": ("a: I64x2 -> I64x1", ">> return a[:, 0]", "a slice that leaves gaps: a[:, 0]", "a loop"),
    "a block": ("a: I64x2 -> I64x2", ">> return a[:, 1:]", "a slice that leaves gaps", "a loop"),
    "a float as an index": ("a: I64x1, x: float -> int", ">> return a[x]", "a float as an index: a[x]", "a whole number; int()"),
    "a bool as an index": ("a: I64x1, x: bool -> int", ">> return a[x]", "a bool as an index: a[x]", "a whole number; int()"),
    "an array as an index": ("a: I64x1 -> int", ">> return a[a]", "array of int64 with 1 axis as an index", "a whole number"),
    "None as an index": ("a: I64x1 -> int", ">> return a[None]", "None as an index", "a whole number"),
    "a float as an end": ("a: I64x1, x: float -> int", ">> return len(a[:x])", "a float as an index", "a whole number"),
    "a power": ("x: float -> float", ">> return x**2", "Pow of a float and an int: x ** 2", "** takes constants only"),
    "arrays added": ("a: F64x1 -> F64x1", ">> return a + a", "Add of an array of float64", "numbers"),
    "bits of floats": ("x: float -> float", ">> return x & 1", "BitAnd of a float and an int", "numbers"),
    "bools added": ("x: bool -> int", ">> return x + x", "Add of two bool: x + x", "int() of both"),
    "a long shift": ("x: int -> int", ">> return x << 64", "a shift by 64: x << 64", "0 to 63"),
    "a negative shift": ("x: int -> int", ">> x >>= -1\nreturn x", "a shift by -1", "0 to 63"),
    "a narrow sum": ("a: U8x1 -> int", ">> return a[0] + 1", "Add of a narrow int: a[0] + 1", "int() of the element first"),
    "a narrow argument": ("a: U8x1 -> int", ">> return helper(a[0])", "a narrow int where an int belongs", "int() and float() convert"),
    "a narrow result": ("a: U8x1 -> int", ">> return a[0]", "a narrow int where an int belongs", "int() and float() convert"),
    "a narrow fill": ("a: U8x1 -> U8x1", ">> return np.full(3, a[0])", "a narrow int without a dtype", "write int() of it, or give a dtype"),
    "float32 and float": ("a: F32x1, x: float -> float", ">> return float(a[0] * x)", "np.float32 and float together", "np.float32() of both"),
    "float32 floored": ("a: F32x1 -> float", ">> return float(a[0] // a[1])", "FloorDiv of an np.float32", "float() of both"),
    "float32 for a float": ("a: F32x1 -> float", ">> return a[0]", "an np.float32 where a float belongs", "float() convert"),
    "uint64 and int": ("a: U64x1, x: int -> np.uint64", ">> return a[0] + x", "np.uint64 and int together", "np.uint64() of both"),
    "uint64 and a negative number": ("a: U64x1 -> np.uint64", ">> return a[0] + -1", "np.uint64 and int together", "np.uint64() of both"),
    "a constant of uint64 and int": ("x: int -> np.uint64", ">> return LANE + x", "np.uint64 and int together", "np.uint64() of both"),
    "a quotient of uint64": ("a: U64x1 -> np.uint64", ">> return a[0] / a[1]", "Div of an np.uint64", "float() of both"),
    "a negative uint64": ("a: U64x1 -> np.uint64", ">> return -a[0]", "USub of an np.uint64: -a[0]", "int() converts"),
    "a negative bool": ("x: bool -> int", ">> return -x", "USub of a bool: -x", "int() converts"),
    "bits of a float inverted": ("x: float -> int", ">> return ~x", "Invert of a float: ~x", "a number"),
    "an array as a condition": ("a: I64x1 -> int", ">> if a:\n    return 1\nreturn 0", "array of int64 with 1 axis as a condition: a", "a comparison"),
    "and of ints": ("x: int -> int", ">> return x and 1", "and, or of values that are no bool: x and 1", "bool() of each, or an if"),
    "tuples compared": ("x: int -> bool", ">> return (x, 1) == (1, x)", "a tuple[int, int] beside a tuple[int, int]", "numbers of one type"),
    "None compared": ("x: int -> bool", ">> return x == None", "an int beside None", "numbers of one type"),
    "uint64 compared": ("a: U64x1, x: int -> bool", ">> return a[0] < x", "an np.uint64 beside an int", "numbers of one type"),
    "float32 compared": ("a: F32x1, x: float -> bool", ">> return a[0] < x", "an np.float32 beside a float", "numbers of one type"),
    "membership in an array": ("a: I64x1, x: int -> bool", ">> return x in a", "membership: x in a", "in a tuple of numbers"),
    "membership in a chain": ("x: int -> bool", ">> return 0 < x in (1, 2)", "membership: 0 < x in (1, 2)", "in a tuple of numbers"),
    "two types in a choice": ("x: int, a: F64x1 -> int", ">> y = x if x else a\nreturn 0", "two types in one expression", "make both of one type, or write an if"),
    "a choice of calls for nothing": ("x: int -> None", ">> none(x) if x else none(1)", "no value, or two types", "make both of one type, or write an if"),
    "no value in a tuple": ("x: int -> int", ">> y = (none(x), 1)\nreturn 0", "no value", "the call on a line of its own"),
    "a loop over a number": ("x: int -> int", ">> for k in x:\n    pass\nreturn 0", "a loop over an int: x", "range(), an array, or a tuple of one type"),
    "a loop over mixed types": ("x: int, a: F64x1 -> int", ">> for k in (x, a):\n    pass\nreturn 0", "a loop over a tuple", "range(), an array"),
    "no end of a range": ("x: int -> int", ">> for k in range():\n    pass\nreturn 0", "0 arguments of range: range()", "one to three numbers"),
    "a range by name": ("x: int -> int", ">> for k in range(stop=x):\n    pass\nreturn 0", "0 arguments of range", "one to three numbers"),
    "a float as an end of a range": ("x: float -> int", ">> for k in range(x):\n    pass\nreturn 0", "a float as an index: x", "a whole number"),
    "a step of zero": ("x: int -> int", ">> for k in range(0, x, 0):\n    pass\nreturn 0", "a step of 0: range(0, x, 0)", "another step"),
    "a range as a value": ("x: int -> int", ">> y = range(x)\nreturn 0", "range is no kernel: range(x)", "use range() only in"),
    "a function that is no kernel": ("x: int -> int", ">> return plain(x)", "plain is no kernel: plain(x)", "mark it with @kernel if it is your own"),
    "a builtin": ("x: int -> None", ">> print(x)", "print is no kernel: print(x)", "remove it"),
    "a function of numpy": ("a: F64x1 -> float", ">> return np.sum(a)", "sum is no kernel: np.sum(a)", "write a loop over the elements"),
    "a hypotenuse": ("x: float -> float", ">> return math.hypot(x, x)", "hypot is no kernel: math.hypot(x, x)", "write math.sqrt(x * x + y * y)"),
    "a method": ("a: F64x1 -> float", ">> return a.sum()", "a call of something unknown: a.sum()", "a kernel, or a function that phalanx docs reference/kernels lists"),
    "a function with keywords": ("x: float -> int", ">> return round(number=x)", "keywords of round: round(number=x)", "pass its arguments by their places"),
    "an array to a number's function": ("a: F64x1 -> float", ">> return math.sqrt(a)", "a call with array of float64 with 1 axis", "pass one number"),
    "no number to a function": ("x: int -> float", ">> return math.sqrt()", "a call with nothing", "pass one number"),
    "an int of an array": ("a: F64x1 -> int", ">> return int(a)", "a call with array", "pass one number"),
    "one number's maximum": ("x: int -> int", ">> return max(x)", "a call with int: max(x)", "pass two or more numbers"),
    "the size of a number": ("x: int -> int", ">> return len(x)", "a call with int: len(x)", "an array or a tuple"),
    "any of numbers": ("a: F64x1 -> bool", ">> return np.any(a)", "a call with array", "pass an array of bool with one axis"),
    "a test of text": ("a: F64x1 -> bool", ">> return math.isnan(a)", "a call with array", "pass one number"),
    "abs of an array": ("a: F64x1 -> int", ">> y = abs(a)\nreturn 0", "a call with array", "pass one number"),
    "a float to eye": ("x: float -> F64x2", ">> return np.eye(x)", "a call with float: np.eye(x)", "a whole number"),
    "an int to np.floor": ("x: int -> float", ">> return np.floor(x)", "a call with int: np.floor(x)", "pass a float; float() converts"),
    "a float in a row": ("a: U8x1, x: float -> None", ">> put_u16(a, 0, x)", "a call with array of uint8", "a row of bytes, and whole numbers"),
    "no shape": ("x: int -> int", ">> y = np.zeros()\nreturn 0", "0 arguments of zeros: np.zeros()", "give a shape, and a dtype"),
    "no value to fill": ("x: int -> int", ">> y = np.full(3)\nreturn 0", "1 arguments of full: np.full(3)", "give a shape, a value, and a dtype"),
    "an order": ("x: int -> int", '>> y = np.zeros(3, order="C")\nreturn 0', "1 arguments of zeros", "give a shape, and a dtype"),
    "a float as a length": ("x: float -> int", ">> y = np.zeros(x)\nreturn 0", "no length: x", "a whole number for each axis"),
    "a dtype of text": ("x: int -> int", ">> y = np.zeros(3, 'i8')\nreturn 0", "no dtype", "np.int64, np.uint8"),
    "complex numbers": ("x: int -> int", ">> y = np.zeros(3, np.complex128)\nreturn 0", "complex128 is not an element type", "np.int64"),
    "five axes": ("x: int -> int", ">> y = np.zeros((1, 2, 3, 4, 5))\nreturn 0", "an array with 5 axes, and 1 to 4", "np.int64"),
    "a float that fills ints": ("x: int -> int", ">> y = np.full(3, 0.5, np.int64)\nreturn 0", "a float where an int belongs", "a number of the array's type"),
    "an array like a number": ("x: int -> int", ">> y = np.zeros_like(x)\nreturn 0", "an array like something else", "pass an array"),
    "too many arguments": ("x: int -> int", ">> return helper(x, 1.0, 2)", "3 arguments: helper(x, 1.0, 2)", "give 2, as helper has"),
    "no argument": ("x: int -> int", ">> return helper()", "no x: helper()", "all arguments of helper"),
    "an unknown keyword": ("x: int -> int", ">> return helper(x, z=1)", "z by name: helper(x, z=1)", "the names of helper, once each"),
    "an argument twice": ("x: int -> int", ">> return helper(x, x=1)", "x by name", "the names of helper, once each"),
    "keywords of a dict": ("x: int -> int", ">> return helper(**WORDS)", "** by name", "the names of helper"),
    "a tuple for a NamedTuple": ("x: float -> float", ">> return point((x, x))", "a tuple[float, float] where a", "p of point"),
    "another NamedTuple": ("x: float -> float", ">> return point(Other(x, x))", "where a tuple[float, float] belongs", "p of point"),
    "fields in another order": ("x: float -> float", ">> return point(Point(y=x, x=x))", "arguments in another order", "the order of the fields"),
    "too few fields": ("x: float -> float", ">> return point(Point(x))", "a tuple[float] where a tuple[float, float] belongs", "the fields of Point"),
    "a bundle that is made": ("a: I64x1 -> None", ">> q = Queue(a, 1)", "a bundle that is made in a kernel: Queue(a, 1)", "take the bundle as an argument"),
    "a kernel that calls itself": ("x: int -> int", ">> return given(x - 1) if x > 0 else 0", "given calls itself: given(x - 1)", "a loop"),
    "a parameter without a type": ("x -> int", "return 0", "x has no annotation: def given(x)", "annotate it with int, float, bool, or a type of phalanx/arrays.py"),
    "a result without a type": ("x: int", "return 0", "the result has no annotation: def given(x: int)", "annotate it with"),
    "a parameter of text": ("x: str -> int", "return 0", "x: str is not a type of kernels: def given(x: str)", "annotate it with"),
    "a parameter of any type": ("x: Any -> int", "return 0", "Any is not a type of kernels", "annotate it with"),
    "a parameter with many axes": ("a: Annotated[Any, Records(ROW, 5)] -> int", "return 0", "an array with 5 axes", "annotate it with"),
    "a NamedTuple of text": ("x: int -> int", ">> y = Named(x)\nreturn 0", "Named.name: str is not a type of kernels", "annotate its fields"),
    "more arguments": ("*x: int -> int", "return 0", "parameters of another form: *x: int", "parameters with names, and defaults"),
    "keywords only": ("*, x: int -> int", "return 0", "parameters of another form", "parameters with names"),
    "positions only": ("x: int, / -> int", "return 0", "parameters of another form", "parameters with names"),
    "a default of another type": ("x: int -> int", ">> return half(x)", "a float where an int belongs: half(x)", "y of half"),
    "a record that is returned": ("r: Annotated[Any, Records(ROW)] -> Annotated[Any, Records(ROW, 0)]", "return r[0]", "is returned: r:", "an index, or numbers"),
    "a bundle that is returned": ("q: Queue -> Queue", "return q", "a Queue is returned", "an index, or numbers"),
    "too many words": ("x: tuple[" + "int, " * 97 + "int] -> int", "return 0", "98 words of arguments", "a bundle"),
}
# fmt: on


@pytest.mark.parametrize("name", CASES)
def test_it_is_refused_with_its_place_and_what_to_write(name, tmp_path):
    signature, body, what, instead = CASES[name]
    arguments, arrow, result = signature.partition(" -> ")
    head = f"def given({arguments}){arrow}{result}:"
    lines = [*HEAD.split("\n"), "@kernel", head, *(f"    {each}" for each in body.split("\n"))]
    line = next((k for k, each in enumerate(lines, 1) if each.startswith("    >> ")), lines.index(head) + 1)
    module = load("\n".join(lines).replace("    >> ", "    ") + "\n", tmp_path)
    with pytest.raises(SubsetError) as refused:
        c_of(kernels_of(module))
    message, hint = str(refused.value).split("\n")
    assert message.startswith(f"{module.__file__}:{line}: ")
    assert what in message
    assert hint.startswith("hint: ")
    assert hint.removeprefix("hint: ").split()[0] in VERBS, "a hint says what to do"
    assert instead in hint


def test_syntax_that_no_kernel_may_use_has_a_case_each():
    shown = {case[2].split(" is not in")[0].split(" is not")[0] for case in CASES.values()}
    # `await`, `async for`, `async with` and `nonlocal` are syntax errors in a plain function at the top of a module.
    assert {each.__name__ for each in INSTEAD} - shown == {"Await", "AsyncFor", "AsyncWith", "Nonlocal"}


def test_a_kernel_inside_a_function_is_refused(tmp_path):
    text = "def make(y):\n    @kernel\n    def inner(x: int) -> int:\n        return x + y\n    return inner\n"
    module = load(HEAD + text, tmp_path)
    with pytest.raises(SubsetError, match="a function inside another one"):
        c_of([module.make(1)])


def test_a_lambda_is_refused(tmp_path):
    module = load(HEAD + "f = lambda x: x\n", tmp_path)
    with pytest.raises(SubsetError, match="<lambda> is not written with def"):
        c_of([module.f])


@pytest.mark.parametrize(
    "head, complaint",
    [
        ("def b(x)", "x has no annotation: def b(x)"),
        ("def b(x: int)", "the result has no annotation: def b(x: int)"),
        ("def b(x: list[int]) -> int", "x: list[int] is not a type of kernels: def b(x: list[int])"),
        ("def b(x: 'Unknown') -> int", "an annotation of b cannot be read: name 'Unknown' is not defined"),
    ],
)
def test_a_called_kernel_without_a_type_is_refused_where_it_stands(tmp_path, head, complaint):
    module = load(
        f"{HEAD}@kernel\ndef a(x: int) -> int:\n    return b(x)\n\n@kernel\n{head}:\n    return x\n", tmp_path
    )
    with pytest.raises(SubsetError) as refused:
        c_of([module.a])
    line = Path(module.__file__).read_text().splitlines().index(f"{head}:") + 1
    message, hint = str(refused.value).split("\n")
    assert message.startswith(f"{module.__file__}:{line}: {complaint}")
    assert hint == "hint: annotate it with int, float, bool, or a type of phalanx/arrays.py"


def test_kernels_that_call_each_other_are_refused(tmp_path):
    text = "@kernel\ndef a(x: int) -> int:\n    return b(x)\n\n@kernel\ndef b(x: int) -> int:\n    return a(x)\n"
    module = load(HEAD + text, tmp_path)
    with pytest.raises(SubsetError, match="calls itself"):
        c_of([module.a, module.b])


def test_kernels_of_one_name_in_several_modules_are_two(tmp_path):
    text = HEAD + "@kernel\ndef same(x: int) -> int:\n    return x + 1\n"
    one, other = load(text, tmp_path), load(text, tmp_path)
    one.same.__module__, other.same.__module__ = "a.b_c", "a_b.c"
    assert c_of([one.same, other.same]).count("static int64_t k_a_b_c_same_(int64_t v_x)\n") == 1


def test_the_build_prints_one_line_and_a_hint(tmp_path):
    package = tmp_path / "src" / "phalanx"
    shutil.copytree(ROOT / "src" / "phalanx", package, ignore=shutil.ignore_patterns("pages", "*kernels*.so"))
    (package / "wrong.py").write_text(
        "from .kernel import (\n    kernel,\n)\n\n\n@kernel\ndef wrong(x: int) -> int:\n    return [x]\n"
    )
    command = [sys.executable, "-m", "phalanx_compiler.generate", tmp_path / "out.c", package]
    path = f"{package.parent}:{ROOT}"
    done = subprocess.run(command, env={"PYTHONPATH": path}, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.splitlines() == [
        "error: src/phalanx/wrong.py:8: List is not in the subset: [x]",
        "hint: use an array, or a tuple",
    ]
    assert not (tmp_path / "out.c").exists()


def test_nodes_that_were_just_built_go_before_older_ones_in_the_package(tmp_path):
    """Kernels have the sizes of nodes in them: with those of an older build every call would be refused."""
    (tmp_path / "_firmware_hardened.py").write_text("raise SystemExit('just built')")
    command = [
        sys.executable,
        "-m",
        "phalanx_compiler.generate",
        tmp_path / "out.c",
        ROOT / "src" / "phalanx",
        tmp_path,
    ]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert done.stderr.strip() == "just built"
