"""The options with which numba compiles the kernels: strict, so that every sum is rounded as in Python.

`kernel` marks a function that other kernels call. The functions that Python calls are in `entry`.
"""

from __future__ import annotations

from numba import njit

kernel = njit(nogil=True, boundscheck=False, error_model="numpy", fastmath=False)
"""Compile a function that other compiled functions call."""

inlined = njit(nogil=True, boundscheck=False, error_model="numpy", fastmath=False, forceinline=True)
"""Compile a function into those that call it. Loops over many cells need this to work on several cells at once."""

approximate = njit(nogil=True, boundscheck=False, error_model="numpy", fastmath={"contract"})
"""Compile a function whose result need not be that of Python: a product and a sum may be rounded once, together."""
