"""Physical effects: what may be missing from a model, one file for each kind of physics.

Read `protocol` first: an effect is a name, parameters and two pure maps. `library` lists all of them;
`material`, `loads`, `shape`, `supports` and `optics` hold them, `baselaw` the law of the base model.
`requirements` says what an effect may ask of the data, `ownfiles` and `origin` read a user's own effects.
"""
