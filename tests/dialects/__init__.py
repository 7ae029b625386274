"""Servers that are as strict and as odd as the real ones, and every way in played against them.

`rules` is the table: each rule of a dialect with its source. `server` obeys it, `ways` are the players and adapters,
`page` writes the table and its matrix into the documentation, and `test_dialects` plays every pair.
"""
