"""How well each displacement is known: independent noise, and errors that many values share ("modes").

Read `noise` first: what scatters at rest, and what video compression adds. `persistence` tells how long that
lasts, `stillness` whether the finger rested at all,
`keyframes` what changes where a film is drawn anew. `variance` makes the independent
variance of every place from it. `modes` gives the shared errors by name, for example a wrong scale.
`budgeting` sums all of them up by source.
"""
