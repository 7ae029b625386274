"""Marks of tests that share something dear."""

import pytest

COMPILED = [pytest.mark.slow, pytest.mark.xdist_group("compiled")]
"""Tests of Crafter's compiled engine: its first use takes half a minute, so one process makes all of them."""
