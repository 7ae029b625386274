"""Files of records and rows: JSON Lines that grow while they are read, the times of their lines, and a full disk."""
