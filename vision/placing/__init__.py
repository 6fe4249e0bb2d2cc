"""Pixels become displacements in mm.

`views` says what each camera recorded and what was followed in it. `flat` places marks with one camera in
the finger's plane (`depth`: what it cannot see); `space` with several (`world`, `clocks`, `spacemodes`).
Both give a `placed`. `slips` finds marks that came off.
"""
