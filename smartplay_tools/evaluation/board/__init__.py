"""Boards: a static leaderboard made from a folder of submissions, each of them checked when the board is built.

table     what a board shows of checked submissions, as plain data
site      the pages

No claim is trusted: scores come from the rows that the check computed from records, and "verified by replay" from the
check itself. A submission that is not verified is listed with what was found, without a score.
"""
