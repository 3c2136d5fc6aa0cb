"""Violated checks of compiled kernels: their names in C, and their messages in Python.

A violation crosses from C as a number with two values (`struct fault` in runtime.h). The enum of the names is part of
the generated C, so both sides have one table.
"""

from __future__ import annotations

MESSAGES = {
    "BAD_INDEX": "index {0} is outside an array of {1}",
    "BAD_SHAPE": "an array of length {0}, expected {1}",
    "BAD_SIZE": "an array cannot have length {0}; the largest is {1}",
    "BAD_DIVISOR": "a division by zero",
    "BAD_NUMBER": "NaN, infinite, or beyond 64 bits: no int can hold it",
    "BAD_SCRATCH": "scratch memory: {0} bytes where {1} are allowed",
    "BAD_END": "the kernel ends without a return",
    "BAD_CAPACITY": "returned {0} bytes, which no state may have",
    "BAD_LENGTH": "returned length {0} of a row of {1} bytes",
    "BAD_OUTPUTS": "returned length {0} of a row of {1} bytes: no valid outputs end there",
    "BAD_LINK": "no controller has the number {0}",
}
# Added to the number of a violation in a user's file.
IN_OWN = 64
# Stands for an exception that Python raised while compiled code called it.
RAISED = 255


def enum() -> str:
    """Return the C enum of all violations."""
    return f"enum {{ {', '.join(MESSAGES)}, IN_OWN = {IN_OWN} }};"


def message(number: int, index: int, size: int) -> str:
    """Return the message of a violation, which may be one in a user's file."""
    return list(MESSAGES.values())[number % IN_OWN].format(index, size)
