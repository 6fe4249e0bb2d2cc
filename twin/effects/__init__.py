"""Physical effects: what may be missing from a model, one file for each kind of physics.

Read `protocol` first: an effect is a name, parameters and two pure maps. `library` lists all of them:
`material`, `loads`, `inertia`, `forces`, `shape`, `supports`, `measurement` (camera and clock) and
`markerslip` hold them. `families` are their widest laws, amplitudes on a fixed basis; `mechanism` has their
classes; `labels` is the grammar of their names, and `phrases` puts fitted values into words. `standins` lists
plain explanations that are never named as a cause: `standin` is their base class; `standinpressure`,
`standinforces` and `standinmotions` hold them. `requirements` says what an effect may ask of the data,
`ownfiles` and `origin` read a user's own effects; `opendimensions` is that of a body's dimensions which a
project leaves open.
"""
