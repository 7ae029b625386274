"""The options with which numba compiles the kernels: strict, so that every sum is rounded as in Python.

`kernel` marks a function that other kernels call. The functions that Python calls are in `entry`.
"""

from __future__ import annotations

from numba import njit

kernel = njit(nogil=True, boundscheck=False, error_model="numpy", fastmath=False)
"""Compile a function that other compiled functions call."""

inlined = njit(nogil=True, boundscheck=False, error_model="numpy", fastmath=False, forceinline=True)
"""Compile a function into those that call it, for what is called often.

A loop over many cells then works on several at once, and the references to arrays are not counted at every call.
"""

approximate = njit(nogil=True, boundscheck=False, error_model="numpy", fastmath={"contract"})
"""Compile a function whose result need not be that of Python: a product and a sum may be rounded once, together."""
