"""Abaqus input decks in and out, and other programs that solve them.

`keywords` splits a deck into keywords, `reader` understands them, `draft` makes a case of what they say;
`soundness` refuses a case that cannot be meant. `writer` writes a deck, `obstacle` what a structure in
it touches. `hyperelastic` is the table of laws for both. `engine` is what every program that solves a case
offers; `embedded`, `calculix` and `abaqus` are one each. `course` makes a solution of what another program
gave.
"""
