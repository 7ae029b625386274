"""What prompts and answers have to be, written from the documentation by somebody who had not seen the code.

From the replies and the game alone it computes what every call must be answered and what every prompt must be, to the
byte: turns whole, masked or bare, pins, summaries, answers of `recall`, pages, files, notes, tokens, prefixes, ends.
Where it and the package disagree, one of them misreads the documents. Words of errors that the documents leave open are
taken as they were given. `files`, `recalling` and `cutting` import nothing of the package, so `tests/checker.py`, which
judges records, has its answers from them.
"""
