"""Pictures as observations: what a picture is, its PNG file, and the rules by which providers count its tokens.

A record holds a picture's sha256, width and height, never its bytes, so the same pixels have to become the same bytes
everywhere: the PNG writer (`png`) is our own.
"""

from smartplay_tools.pictures.picture import NO_PICTURES, Picture, is_picture, picture_part
from smartplay_tools.pictures.token_rules import DEFAULT_RULE, RULES, PictureRule

__all__ = ["DEFAULT_RULE", "NO_PICTURES", "RULES", "Picture", "PictureRule", "is_picture", "picture_part"]
