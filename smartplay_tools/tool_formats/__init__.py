"""The tools as other programs take them: as schemas of their interfaces, or as Python functions."""
