"""The promises of every effect and their test: `check_effect`, for a user's own effect above all.

Read `promises` first: one function a promise, each gives a sentence where it is broken. `specimen` is the
small finger on which they are tried.
"""
