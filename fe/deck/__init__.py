"""Abaqus input decks in and out, and other programs that solve them.

`keywords` splits a deck into keyword blocks, `draft` collects what they say, `reader` makes a case of it;
`writer` writes one. `engine` is what every solver offers, with the built-in one; `calculix` and `abaqus`
run other programs.
"""
