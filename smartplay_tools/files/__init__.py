"""JSON Lines files: appended line by line, read while they grow, and dated in a file beside them."""
