"""Displacements in mm from the pixels of one camera or several.

Read `views` first: what each camera recorded, and what was followed in it. `flat` places marks with one
camera in the finger's plane; `depth` says what that camera cannot see. `space` places them with several
cameras, by `world`, `clocks` and `spacemodes`. Both give a `placed`. `slips` finds marks that came off.
`projecting` goes the other way: from mm to pixels. Before all of it `gates` refuses marks that cannot be
what is stated of them, and `rigplaces` frame marks that lie elsewhere.
"""
