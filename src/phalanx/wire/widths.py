"""Annotations for the widths of numbers: `U16` is an int of 16 bits, `F32` a float of 32.

Type checkers see `int` and `float`. The names are those of the field types in the byte table.
"""

from typing import Annotated

U8 = Annotated[int, "u8"]
U16 = Annotated[int, "u16"]
U32 = Annotated[int, "u32"]
U64 = Annotated[int, "u64"]
I8 = Annotated[int, "i8"]
I16 = Annotated[int, "i16"]
I32 = Annotated[int, "i32"]
I64 = Annotated[int, "i64"]
F32 = Annotated[float, "f32"]
F64 = Annotated[float, "f64"]
