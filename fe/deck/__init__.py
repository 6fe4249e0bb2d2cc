"""Reader of Abaqus input decks: a deck in, a case out.

`keywords` splits a deck into keywords (`expressions`: the values of its parameters; `units`: the units that
it declares). `reader` interprets them, by one file a kind of keyword: `meshkeywords` and `generation`,
`instances`, `materialkeywords` (`hyperelastic` is the table of laws), `loadkeywords`, `jointkeywords`;
`setnames` resolves names of sets. `draft` makes a case of all that was read: `meshdraft` is its mesh,
`elementtypes` maps element types, `joints` joins parts, `sheets` turns shells into layers. `soundness`
refuses a case with an unsound mesh or supports.
"""
