"""A calibrated finger given back to other simulators: a rod of bending and stretching sections, with a card
that says how well it is followed there.

Read `rod` first: the sections, what the pressure does to them, and where that puts the tip. `sections` makes
one of a calibrated model. `mujocochain` and `sectiontable` write it, `elasticarod` and `newtonchain` are
scripts that are exported as they stand; `simulators` lists them all. `card` judges what they say.
"""
