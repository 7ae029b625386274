"""Means with intervals, and the distributions from which they follow: pure functions over numbers."""
