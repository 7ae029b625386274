"""Marks of tests that need something dear."""

import pytest

COMPILED = pytest.mark.slow
"""Tests of Crafter's compiled engine: compiling it takes half a minute, after which other processes find it on disk."""
