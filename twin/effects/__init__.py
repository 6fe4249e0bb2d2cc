"""Physical effects: what may be missing from a model, one file for each kind of physics.

Read `protocol` first: an effect is a name, parameters and two pure maps; `widest` is the same physics
with all its freedom, `parts` that on thirds of the finger, `amounts` puts fitted values into words, and
`labels` says how effects are named everywhere.
`library` lists all of them; `material`, `loads`, `pulls`, `shape`, `supports`, `optics`, `clocks` and
`tags` hold them. `standins` lists plain explanations that are never
named: `inwords` is what they have in common, `courses`, `acting` and `sightings` hold them.
`requirements` says what an effect may ask of the data, `ownfiles` and `origin` read a user's own effects.
"""
