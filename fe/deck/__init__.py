"""Abaqus input decks in and out, and other programs that solve them.

`keywords` splits a deck into keywords (`expressions`: the values of its parameters; `units`: those that it
declares) and `reader` understands them, by one file a kind of keyword: `meshkeywords` and `generation`,
`instances`, `materialkeywords` (`hyperelastic` is the table of laws), `loadkeywords`, `jointkeywords`;
`naming` finds what a name means. `draft` makes a case of what they say: `meshdraft` is its mesh, `kinds` says
which elements serve, `mixed` divides mixed shapes, `joining` and `rigid` join parts, `sheets` makes layers of
shells. `soundness` refuses a case that cannot be meant, `remedies` says what to do about keywords that are
refused. `writer` writes a deck, `obstacle` what a structure in it touches. `engine` is what every program
that solves a case offers; `embedded`, `calculix` and `abaqus` are one each. `course` makes a solution of what
another program gave.
"""
