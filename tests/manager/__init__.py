"""Tests of the context manager for agents of any framework."""
