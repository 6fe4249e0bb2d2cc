"""Cameras with the covariance of all their numbers, from pictures of a printed board.

Read `lens` (the fit of every lens model) and `intrinsics` (the choice of one, and what refuses bad pictures)
first; `rejectedpictures` decides which pictures are left out. Several cameras that see one board become a
rig (`rig`) in `stereo`, fitted by `bundle`. `boardfilms` does both from films of a moving board instead of
pictures. `camerafile` reads cameras that other programs calibrated. What a board is stands in
`vision.boards`.
"""
