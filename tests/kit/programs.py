"""Write random well-typed programs of the subset, whose numbers stay far inside 64 bits."""

from __future__ import annotations

import random

HEAD = """from typing import NamedTuple
import math
import numpy as np
from phalanx.arrays import BOOLx1, F64x1, F64x2, I64x1, U8x1
from phalanx.kernel import kernel

K, R, T = 37, -0.75, (3, -4, 5)
TABLE = np.array([2, -3, 5, 7])


class Pair(NamedTuple):
    n: int
    r: float


@kernel
def note(a: I64x1, x: int) -> int:
    a[0] = (a[0] * 31 + x) % 10007
    return a[0] - 5000


@kernel
def halves(x: float, n: int = 3) -> tuple[int, float]:
    for _ in range(n):
        x = x * 0.5 + 1.0
    return int(bounded(x)), x


@kernel
def bounded(x: float) -> float:
    return max(-1e6, min(x, 1e6)) if not math.isnan(x) else 0.0


@kernel
def paired(n: int, r: float) -> Pair:
    return Pair(n % 1000, r)


"""
SIGNATURE = "(i: int, j: int, x: float, y: float, b: bool, a: I64x1, f: F64x1, g: F64x2, u: U8x1, c: BOOLx1)"
RESULT = "tuple[int, int, float, float, bool]"
# Every whole number is cut to so many, so that no product leaves 64 bits.
CUT = 100_003


class Program:
    """Draws one function."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._loops = 0
        self.lines = ["    m, n, s = 1, 2, 0.5", f"    i, j = i % {CUT}, j % {CUT}"]
        for _ in range(self._random.randrange(2, 8)):
            self.statement(1)
        self.lines.append("    return i, m, x, s, b")

    def pick(self, *options):
        return self._random.choice(options)

    def chance(self, percent: int) -> bool:
        return self._random.randrange(100) < percent

    # --- expressions ---

    def whole(self, depth: int = 0) -> str:
        if depth > 3 or self.chance(25):
            return self.pick(
                "i", "j", "m", "n", "K", "T[1]", "0", "1", "-1", "7", str(self._random.randrange(-300, 300))
            )
        one, other = depth + 1, depth + 1
        kind = self.pick(*range(20))
        if kind < 5:
            return f"(({self.whole(one)} {self.pick('+', '-', '*')} {self.whole(other)}) % {CUT})"
        if kind == 5:
            return f"({self.whole(one)} {self.pick('//', '%')} ({self.whole(other)} | 1))"
        if kind == 6:
            return f"({self.whole(one)} {self.pick('&', '|', '^')} {self.whole(other)})"
        if kind == 7:
            return f"(({self.whole(one)} {self.pick('<<', '>>')} ({self.whole(other)} & 15)) % {CUT})"
        if kind == 8:
            return f"{self.pick('-', '~', '+')}({self.whole(one)})"
        if kind == 9:
            return f"({self.whole(one)} if {self.truth(one)} else {self.whole(other)})"
        if kind == 10:
            return f"{self.pick('min', 'max')}({self.whole(one)}, {self.whole(other)})"
        if kind == 11:
            return f"a[{self.index(one)}]"
        if kind == 12:
            return f"int(u[{self.index(one)}])"
        if kind == 13:
            return f"note(a, {self.whole(one)})"
        if kind == 14:
            return f"{self.pick('abs', 'int', 'round')}({self.whole(one)})"
        if kind == 15:
            return f"{self.pick('int', 'round', 'math.floor', 'math.ceil')}(bounded({self.real(one)}))"
        if kind == 16:
            return f"(T[({self.whole(one)}) % 3] + TABLE[({self.whole(one)}) % 4])"
        if kind == 17:
            return f"halves({self.real(one)}{self.pick('', ', 1', ', n=2')})[0]"
        if kind == 18:
            return f"paired({self.whole(one)}, {self.real(one)}).n"
        return f"int({self.truth(one)})"

    def real(self, depth: int = 0) -> str:
        if depth > 3 or self.chance(25):
            return self.pick(
                "x", "y", "s", "R", "0.5", "-0.0", "1e-3", "3.0", "1e17", str(self._random.uniform(-50, 50))
            )
        one = depth + 1
        kind = self.pick(*range(12))
        if kind < 4:
            return f"({self.real(one)} {self.pick('+', '-', '*')} {self.pick(self.real, self.whole)(one)})"
        if kind == 4:
            return f"({self.real(one)} / (abs({self.real(one)}) + 0.25))"
        if kind == 5:
            return f"({self.real(one)} {self.pick('//', '%')} (abs({self.real(one)}) + 0.25))"
        if kind == 6:
            return f"({self.real(one)} if {self.truth(one)} else {self.real(one)})"
        if kind == 7:
            return f"float({self.pick('min', 'max')}({self.real(one)}, {self.pick(self.real, self.whole)(one)}))"
        if kind == 8:
            return self.pick(f"f[{self.index(one)}]", f"g[{self.index(one)} % 2, {self.index(one)} % 3]")
        if kind == 9:
            return f"{self.pick('-', 'abs', 'float')}({self.real(one)})"
        if kind == 10:
            return self.pick(f"halves({self.real(one)})[1]", f"paired({self.whole(one)}, {self.real(one)}).r")
        return f"math.sqrt(abs({self.real(one)}))"

    def truth(self, depth: int = 0) -> str:
        if depth > 3 or self.chance(15):
            return self.pick("b", "True", "False", f"c[{self.index(3)}]")
        one = depth + 1
        kind = self.pick(*range(9))
        sign = self.pick("<", "<=", ">", ">=", "==", "!=")
        if kind < 3:
            return f"({self.whole(one)} {sign} {self.pick(self.whole, self.real)(one)})"
        if kind == 3:
            return f"({self.real(one)} {sign} {self.real(one)})"
        if kind == 4:
            return f"({self.truth(one)} {self.pick('and', 'or')} {self.truth(one)})"
        if kind == 5:
            return f"(not {self.truth(one)})"
        if kind == 6:
            return f"({self.whole(one)} {sign} {self.whole(one)} {self.pick('<', '==', '>=')} {self.whole(one)})"
        if kind == 7:
            return f"({self.whole(one)} {self.pick('in', 'not in')} ({self.whole(one)}, {self.whole(one)}, 1))"
        return f"({self.truth(one)} {self.pick('&', '|', '^')} {self.truth(one)})"

    def index(self, depth: int) -> str:
        return self.pick("0", "1", "-1", "5", f"({self.whole(min(depth + 1, 3))}) % 6")

    # --- statements ---

    def statement(self, depth: int, *, in_loop: bool = False) -> None:
        kind = self.pick(*range(20))
        write = lambda text: self.lines.append("    " * depth + text)
        if kind < 3:
            write(f"{self.pick('i', 'j', 'm')} = {self.whole()}")
        elif kind < 5:
            write(f"{self.pick('x', 'y', 's')} = float({self.pick(self.real, self.whole)()})")
        elif kind == 5:
            write(f"b = {self.truth()}")
        elif kind == 6:
            write(f"{self.pick('i', 'j')} {self.pick('+=', '-=', '^=', '|=')} {self.whole(2)}")
            write(f"i, j = i % {CUT}, j % {CUT}")
        elif kind == 7:
            write(f"{self.pick('x', 'y')} {self.pick('+=', '-=', '*=')} {self.real(2)}")
        elif kind == 8:
            write(f"a[{self.index(1)}] = {self.whole(1)}")
        elif kind == 9:
            write(f"a[{self.index(2)}] {self.pick('+=', '-=', '^=', '&=', '//=')} {self.whole(2)} | 1")
            write(f"a[0] %= {CUT}")
        elif kind == 10:
            write(f"f[{self.index(1)}] {self.pick('=', '+=', '*=')} {self.real(1)}")
        elif kind == 11:
            write(f"u[{self.index(1)}] = ({self.whole(1)}) & 255")
        elif kind == 12:
            write(
                self.pick(
                    "i, j = j, i",
                    "x, y, s = y, s, x",
                    f"m, x = halves({self.real(2)})",
                    f"m, s = paired({self.whole(2)}, x)",
                )
            )
        elif kind == 13:
            write(f"a[{self.index(2)}], i, a[{self.index(2)}] = {self.whole(2)}, {self.whole(2)}, {self.whole(2)}")
        elif kind == 14:
            low = self.pick("", "1", "-3", f"({self.whole(3)}) % 9 - 4")
            high = self.pick("", "-1", "4", f"({self.whole(3)}) % 9 - 4")
            write(f"for r in {self.pick('f', 'a')}[{low}:{high}]:")
            write("    s += r")
            write(self.pick(f"f[{low}:{high}] = {self.real(3)}", "f[1:4] = f[2:5]", "g[1] = g[0]", "c[:3] = b", "pass"))
        elif kind == 15:
            write(f"if {self.truth()}:")
            self.block(depth + 1, in_loop=in_loop)
            if self.chance(50):
                write("else:")
                self.block(depth + 1, in_loop=in_loop)
        elif kind in (16, 17) and depth < 4:
            k = f"k{self._loops}"
            self._loops += 1
            over = self.pick(
                f"range(({self.whole(3)}) % 5)",
                f"range(({self.whole(3)}) % 5, -3, -2)",
                "T",
                "(i, m, 2)",
                "a",
                "range(1, 7, 3)",
            )
            write(f"for {k} in {over}:")
            write(f"    {self.pick('i', 'j', 'm')} = ({k} + {self.whole(3)}) % {CUT}")
            self.block(depth + 1, in_loop=True)
        elif kind == 18 and depth < 3:
            left = f"left{self._loops}"
            self._loops += 1
            write(f"{left} = {self.pick(3, 5)}")
            write(f"while {left} > 0 and {self.truth()}:")
            write(f"    {left} -= 1")
            self.block(depth + 1, in_loop=True)
        elif in_loop:
            write(f"if {self.truth(2)}:")
            write(f"    {self.pick('break', 'continue')}")
        else:
            write(f"if {self.truth(2)}:")
            write("    return i, m, x, s, b")

    def block(self, depth: int, *, in_loop: bool = False) -> None:
        for _ in range(self.pick(1, 1, 2, 3)):
            self.statement(depth, in_loop=in_loop)


def functions(seed: int, count: int) -> str:
    """Return the text of a module with random kernels `f0` and so on."""
    made = [f"@kernel\ndef f{k}{SIGNATURE} -> {RESULT}:\n" + "\n".join(Program(seed + k).lines) for k in range(count)]
    return HEAD + "\n\n\n".join(made) + "\n"
