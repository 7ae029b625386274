"""Figures of a run. They need the extra `evaluation`; `save_figure` writes PNG, SVG and PDF."""
