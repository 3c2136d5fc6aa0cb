"""The kernel compiler: typed Python in, C99 out. docs/reference/kernels.md lists the subset.

`parsing` finds a kernel and parses it, `typed` gives each expression a type, `statements` writes its C, `unit` puts all
kernels into one translation unit. It runs when the package is built, and once for each controller that a user writes.
"""
